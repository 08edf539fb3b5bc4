"""Threads are soft until they are straight."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.mechanism import AbstractYielding, Description
from pamjax.parameter import Scalar, parameter


class ThreadCrimp(AbstractYielding):
    """Crimp that is pulled out: ε = c (1 − e^(−T/Tc)), added to the stretch of the straight thread.

        c   crimp   1   strain once every thread is straight
        Tc  load    N   load of all threads together at which 63 % of the crimp is out

    Smooth, explicit in the load, and saturating: a toe region in the stress-strain curve. Neutral:
    c = 0. What it leaves out: friction between filaments (the first loading is larger than the next).
    Source: the compliance form of a geometric crimp; the excess length of a wave that tension flattens
    (physics after Kastelic, Palley & Baer, J. Biomech. 13, 887, 1980); derived here in this form.
    """

    id: ClassVar[str] = "thread_crimp"
    about: ClassVar[Description] = Description(
        title="threads are soft until they are straight",
        equation="strain = T / (n E A) + c (1 - exp(-T / Tc))",
        signature="Diameter jumps at low pressure and then stiffens; force is lost early and then no more."
        " Against a straight line through the ends, diameter is too large at low pressure.",
        leaves_out="friction between filaments; the first loading is larger than later ones",
        confusable=("braid_elasticity", "contact_pressure", "thread_slip", "diameter_offset"),
        experiment="Diameter at rest length below a fifth of full pressure, or a tensile test of one thread.",
        source="Kastelic, Palley & Baer 1980; compliance form derived here",
    )

    crimp: Scalar = parameter(
        "1", show="%", low=0.0, high=0.03, neutral=0.0, about="strain once every thread is straight",
        source="0.25 to 0.65 % in Kevlar-49 fabric (Zhu et al. 2013), more in loose sleeves", default=0.0,
    )  # fmt: skip
    load: Scalar = parameter(
        "N", low=1.0, high=1e5, scale="log", about="load of all threads at which 63 % of the crimp is out",
        source="a twentieth to all of the working load", default=500.0,
    )  # fmt: skip

    def strain(self, load: Scalar) -> Array:
        return -self.crimp * jnp.expm1(-load / self.load)
