"""Part of the pressure is spent before the bladder presses on the braid."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractLine, Description, Past, Samples
from pamjax.parameter import Scalar, parameter

#: Cosine of the braid angle by which a tube is wider than it was made, at least.
MIN_WIDTH_GAP = 1e-3

#: Pressure, Pa, below which a reading counts as none.
MIN_CONTACT_PRESSURE = 1e-3


class ContactPressure(AbstractLine):
    """A dead band: pressure presses on the braid only above a threshold,

        P → P − Pc [1 + (Pc / P)⁸]^(−1/8),

    that is P − Pc well above it and nothing well below, with a rounded knee of a tenth of Pc.

        P    pressure   Pa   inside
        Pc   pressure   Pa   threshold, Pc = Pt [1 − (c / cos θ)⁴],  cos θ = 2πRN/B
        Pt   threshold  Pa   of a tube stretched far
        c    fill       1    cos θ at which the braid is as wide as the tube was made

    The threshold is that of a thin neo-Hookean tube widened at its own length, μ t/r [1 − (r/R)⁴]; with
    c = 0 it is a constant, the popular dead band. Then the muscle's potential is −φ(P) V(L, B): conservative
    at any P, and above the knee, where φ' = 1, ∂F/∂P|L = −∂V/∂L|P holds with the muscle's own volume;
    below it the air is in a bladder that stands off the braid, whose volume no diameter shows. A threshold
    that depends on length is no exact potential.

    It is for a muscle of whose bladder nothing is known: `bladder_elasticity` has a threshold of its own,
    which follows from its energy, and gives the diameter below it. Neutral: Pt = 0, where the derivative
    is −∂/∂P of the muscle. What it leaves out: the axial half of the rubber; the free bladder.
    Source: derived here; the effective pressure of Tondu, J. Intell. Mater. Syst. Struct. 23, 225 (2012),
    as a constant; the knee is ours.
    """

    id: ClassVar[str] = "contact_pressure"
    about: ClassVar[Description] = Description(
        title="pressure is spent before the bladder presses on the braid",
        equation="P_eff = P - Pc (1 + (Pc/P)^8)^(-1/8);  Pc = Pt [1 - (c/cos theta)^4]",
        signature="Force is lost by the same newtons at every pressure, in proportion to 3 L^2 - B^2: most at"
        " rest, none at free contraction; below the threshold there is no force.",
        leaves_out="the axial pull of the rubber, the free bladder",
        confusable=("pressure_offset", "bladder_elasticity", "pressure_gain"),
        experiment="The vented reading of the gauge, and a pressure ramp from zero at rest length: a dead"
        " band has a knee, a wrong zero has none.",
        source="constant dead band of Tondu 2012 and others; knee derived here",
    )

    threshold: Scalar = parameter(
        "Pa", show="kPa", low=0.0, high=2e5, neutral=0.0, about="pressure spent before the braid is pressed",
        source="10 to 100 kPa in the literature", default=0.0,
    )  # fmt: skip
    fill: Scalar = parameter(
        "1", low=0.0, high=0.9, about="cosine of the braid angle at which the tube is as wide as it was made",
        source="0: the same threshold at every length", default=0.0,
    )  # fmt: skip

    def pressure(self, history: History, past: Past) -> Samples:
        width = 2 * jnp.pi * past.state.turns * past.state.radius / past.state.thread
        return past.pressure - self.lost_pressure(past.pressure, width)

    def lost_pressure(self, pressure: Array, width: Array | float = 1.0) -> Array:
        """Pressure that does not reach the braid, Pa, at a width, the cosine of the braid angle."""
        there = pressure > MIN_CONTACT_PRESSURE
        threshold = self.threshold * (1 - (self.fill / jnp.maximum(width, self.fill + MIN_WIDTH_GAP)) ** 4)
        below = threshold / jnp.where(there, pressure, 1.0)
        eighth = jnp.sqrt(jnp.sqrt(jnp.sqrt(1 + below**8)))
        return jnp.where(there, threshold / eighth, 0.0)
