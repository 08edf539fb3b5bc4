"""Empirical factor on the contraction, an alternative to `end_taper` for comparison."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from pamjax.model import braid
from pamjax.model.mechanism import AbstractShape, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class ContractionFactor(AbstractShape):
    """A muscle with the force of a cylinder at k times its contraction (Tondu's factor k):

        V = V_cyl(Lk) / k,   Lk = L0 − k (L0 − L),      so that F = P (3 Lk² − B²) / (4πN²)

        k − 1  excess  1   factor minus one
        L0     length  m   rest length, at which contraction is zero

    Its effect on force is that of a gain of the length channel. The library therefore has no such gain.
    The thread load is ∂V/∂B, so that force and volume are consistent.

    It is an alternative to `end_taper`; the two are not combined. Neutral: k = 1. Neglects: the
    cause; the diameter, which is that of a cylinder; a k that decreases with pressure.
    Source: Tondu & Lopez, IEEE Control Syst. Mag. 20, 15 (2000); the volume derived here.
    """

    id: ClassVar[str] = "contraction_factor"
    about: ClassVar[Description] = Description(
        title="empirical factor on the contraction, an alternative to end_taper",
        equation="F = P [3 (L0 - k (L0 - L))^2 - B^2] / (4 pi N^2),   k = 1 + excess",
        signature="The force loss is proportional to pressure and to contraction: zero at rest length,"
        " largest at free contraction. The diameter is that of a cylinder.",
        neglects="the shape of the ends, diameter, a factor that depends on pressure",
        confusable=("end_taper", "length_offset", "pressure_gain"),
        experiment="Check the length channel with a gauge block. Measure the diameter: a length error"
        " changes it, the factor does not.",
        source="Tondu & Lopez 2000; the corresponding volume derived here",
    )

    excess: Scalar = parameter(
        "1", low=0.0, high=0.5, neutral=0.0, about="Tondu's factor minus one",
        source="factors of 1.0 to 1.3 in the literature", default=0.0,
    )  # fmt: skip
    length: Scalar = parameter(
        "m", show="mm", low=1e-3, high=20.0, scale="log", about="rest length of the muscle",
        source="reference length of the contraction", default=0.2,
    )  # fmt: skip

    def shape(self, state: State) -> State:
        factor = 1 + self.excess
        scaled_length = self.length - factor * (self.length - state.length)
        scaled_volume = braid.volume(scaled_length, state.thread, state.turns) / factor
        difference = scaled_volume - braid.volume(state.length, state.thread, state.turns)
        return eqx.tree_at(lambda s: s.volume, state, state.volume + difference)
