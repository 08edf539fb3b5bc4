"""Low stiffness of the threads until they are straight."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.mechanism import AbstractThreadCompliance, Description
from pamjax.parameter import Scalar, parameter


class ThreadCrimp(AbstractThreadCompliance):
    """Crimp that load pulls out: ε = c (1 − e^(−T/Tc)), in addition to the stretch of the straight thread.

        c   crimp   1   strain at which all threads are straight
        Tc  load    N   load of all threads together at which 63 % of the crimp is pulled out

    Smooth, explicit in the load, and saturating: a toe region in the stress-strain curve. Neutral: c = 0.
    Neglects: friction between filaments (the first loading gives more strain than later ones).
    Source: the compliance form of a geometric crimp: the excess length of a wave that tension flattens
    (physics after Kastelic, Palley & Baer, J. Biomech. 13, 887, 1980); derived here in this form.
    """

    id: ClassVar[str] = "thread_crimp"
    about: ClassVar[Description] = Description(
        title="low initial stiffness of crimped threads",
        equation="strain = T / (n E A) + c (1 - exp(-T / Tc))",
        signature="The diameter increases quickly at low pressure, and slowly at higher pressure. The force"
        " loss occurs at low pressure, and does not increase later. Compared with a straight line from"
        " lowest to highest pressure, the diameter is too large at low pressure.",
        neglects="friction between filaments, a first loading with a larger strain than later ones",
        confusable=("braid_elasticity", "contact_pressure", "thread_slip", "diameter_offset"),
        experiment="Measure the diameter at rest length below a fifth of full pressure. Or make a tensile"
        " test of one thread.",
        source="Kastelic, Palley & Baer 1980; compliance form derived here",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 3), *list_powers("length", 3), "pressure length")
    )

    crimp: Scalar = parameter(
        "1", show="%", low=0.0, high=0.03, neutral=0.0, about="strain at which all threads are straight",
        source="0.25 to 0.65 % in Kevlar-49 fabric (Zhu et al. 2013), more in loose sleeves", default=0.0,
    )  # fmt: skip
    load: Scalar = parameter(
        "N", low=1.0, high=1e5, scale="log",
        about="load of all threads at which 63 % of the crimp is pulled out",
        source="from a twentieth of the working load to all of it", default=500.0,
    )  # fmt: skip

    def strain(self, load: Scalar) -> Array:
        return -self.crimp * jnp.expm1(-load / self.load)
