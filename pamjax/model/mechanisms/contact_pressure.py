"""Part of the pressure is spent before the bladder presses on the braid."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.history import History
from pamjax.model.mechanism import About, AbstractLine, Past, Samples
from pamjax.parameter import Scalar, parameter

#: Pressure, Pa, below which a reading counts as none.
NONE = 1e-3


class ContactPressure(AbstractLine):
    """A dead band: pressure presses on the braid only above a threshold,

        P → P − Pc [1 + (Pc / P)⁸]^(−1/8),

    that is P − Pc well above it and nothing well below, with a rounded knee of a tenth of Pc.

        P    pressure   Pa   inside
        Pc   pressure   Pa   threshold

    The muscle's potential becomes −φ(P) V(L, B): conservative at any P, since φ does not depend on where
    the muscle is. Above the knee φ' = 1, and ∂F/∂P|L = −∂V/∂L|P holds with the muscle's own volume;
    below it the air is in a bladder that stands off the braid, whose volume no diameter shows. An energy
    Pc V(L, B) is the same thing above the knee, but has nothing that holds the bladder below it.

    It is for a muscle of whose bladder nothing is known: `bladder_elasticity` has a threshold of its own,
    which grows with contraction, and gives the diameter below it. Neutral: Pc = 0, where the derivative is
    −∂/∂P of the muscle. What it leaves out: that the threshold depends on length; the axial half of the
    rubber; the free bladder.
    Source: the effective pressure of Tondu, J. Intell. Mater. Syst. Struct. 23, 225 (2012), as a
    constant; the knee is ours.
    """

    id: ClassVar[str] = "contact_pressure"
    about: ClassVar[About] = About(
        title="pressure is spent before the bladder presses on the braid",
        equation="P_eff = P - Pc (1 + (Pc/P)^8)^(-1/8)",
        signature="Force is lost by the same newtons at every pressure, in proportion to 3 L^2 - B^2: most at"
        " rest, none at free contraction; below the threshold there is no force.",
        leaves_out="a threshold that depends on length, the axial pull of the rubber, the free bladder",
        confusable=("pressure_offset", "bladder_elasticity", "pressure_gain"),
        experiment="The vented reading of the gauge, and a pressure ramp from zero at rest length: a dead"
        " band has a knee, a wrong zero has none.",
        source="constant dead band of Tondu 2012 and others; knee derived here",
    )

    threshold: Scalar = parameter(
        "Pa", show="kPa", low=0.0, high=2e5, neutral=0.0, about="pressure spent before the braid is pressed",
        source="10 to 100 kPa in the literature", default=0.0,
    )  # fmt: skip

    def pressure(self, history: History, past: Past) -> Samples:
        return past.pressure - self.spent(past.pressure)

    def spent(self, pressure: Array) -> Array:
        """Pressure that does not reach the braid, Pa; none where there is none."""
        there = pressure > NONE
        below = self.threshold / jnp.where(there, pressure, 1.0)
        eighth = jnp.sqrt(jnp.sqrt(jnp.sqrt(1 + below**8)))
        return jnp.where(there, self.threshold / eighth, 0.0)
