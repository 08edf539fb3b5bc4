"""Threshold pressure below which the bladder does not press on the braid."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractPressureLoss, Description, Past, Samples
from pamjax.parameter import Scalar, parameter

#: Minimum difference between the cosine of the braid angle and `fill`.
_MIN_WIDTH_GAP = 1e-3

#: Pressure, Pa, below which a reading counts as zero.
MIN_CONTACT_PRESSURE = 1e-3


class ContactPressure(AbstractPressureLoss):
    """A dead band: only the pressure above a threshold acts on the braid,

        P → P − Pc [1 + (Pc / P)⁸]^(−1/8),

    which is P − Pc far above the threshold and zero far below it. The transition has a width of Pc/10.

        P    pressure   Pa   inside
        Pc   pressure   Pa   threshold, Pc = Pt [1 − (c / cos θ)⁴],  cos θ = 2πRN/B
        Pt   threshold  Pa   of a tube with a large stretch
        c    fill       1    cos θ at which the braid has the diameter of the unstretched tube

    The threshold is that of a thin neo-Hookean tube that widens at its unstretched length, μ t/r [1 −
    (r/R)⁴]. With c = 0 it is a constant, as in the common dead band. The muscle then has the potential
    −φ(P) V(L, B), which is conservative at any P. Above the transition φ' = 1, and ∂F/∂P|L = −∂V/∂L|P holds
    with the volume of the muscle. Below it the bladder does not touch the braid, and the volume of the air
    is not that of the muscle. A threshold that depends on length has no exact potential.

    Use it where the bladder is unknown. `bladder_elasticity` has its own threshold, which follows from its
    energy, and predicts the diameter below it. Neutral: Pt = 0, where the derivative is −∂/∂P of the muscle.
    Neglects: the axial force of the rubber; the free bladder.
    Source: derived here; the effective pressure of Tondu, J. Intell. Mater. Syst. Struct. 23, 225 (2012),
    as a constant; the rounded transition is an assumption of pamjax.
    """

    id: ClassVar[str] = "contact_pressure"
    about: ClassVar[Description] = Description(
        title="threshold pressure for contact between bladder and braid",
        equation="P_eff = P - Pc (1 + (Pc/P)^8)^(-1/8);  Pc = Pt [1 - (c/cos theta)^4]",
        signature="The force loss is the same in newtons at every pressure. It is proportional to 3 L^2 -"
        " B^2: largest at rest length, zero at free contraction. Below the threshold there is no force.",
        neglects="the axial force of the rubber, the free bladder",
        confusable=("pressure_offset", "bladder_elasticity", "pressure_gain"),
        experiment="Read the vented gauge. Record a pressure ramp from zero at rest length: a dead band has"
        " a knee, a zero error has none.",
        source="constant dead band of Tondu 2012 and others; rounded transition derived here",
    )
    form_error: ClassVar[FormError] = FormError(
        (*list_powers("pressure", 2), *list_powers("length", 2), "pressure length")
    )

    threshold: Scalar = parameter(
        "Pa", show="kPa", low=0.0, high=2e5, neutral=0.0,
        about="pressure at which the bladder begins to press on the braid",
        source="10 to 100 kPa in the literature", default=0.0,
    )  # fmt: skip
    fill: Scalar = parameter(
        "1", low=0.0, high=0.9,
        about="cosine of the braid angle at which the braid has the unstretched tube's diameter",
        source="0: the same threshold at every length", default=0.0,
    )  # fmt: skip

    def pressure(self, history: History, past: Past) -> Samples:
        width = 2 * jnp.pi * past.state.turns * past.state.radius / past.state.thread
        return past.pressure - self.lost_pressure(past.pressure, width)

    def lost_pressure(self, pressure: Array, width: Array | float = 1.0) -> Array:
        """Return the pressure that does not act on the braid, Pa.

        Args:
            pressure: pressure inside, Pa.
            width: cosine of the braid angle.
        """
        is_positive = pressure > MIN_CONTACT_PRESSURE
        threshold = self.threshold * (1 - (self.fill / jnp.maximum(width, self.fill + _MIN_WIDTH_GAP)) ** 4)
        ratio = threshold / jnp.where(is_positive, pressure, 1.0)
        rounding = jnp.sqrt(jnp.sqrt(jnp.sqrt(1 + ratio**8)))
        return jnp.where(is_positive, threshold / rounding, 0.0)
