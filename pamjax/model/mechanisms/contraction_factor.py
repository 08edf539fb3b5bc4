"""The textbook's factor on contraction, which stands for the ends of a muscle, to compare with the net."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from pamjax.model import braid
from pamjax.model.mechanism import AbstractShape, Description
from pamjax.model.state import State
from pamjax.parameter import Scalar, parameter


class ContractionFactor(AbstractShape):
    """A muscle that pulls as a cylinder would at k times its contraction (Tondu's k):

        V = V_cyl(Lk) / k,   Lk = L0 − k (L0 − L),      so that F = P (3 Lk² − B²) / (4πN²)

        k − 1  excess  1   by which contraction counts for more
        L0     length  m   at rest, from which contraction counts

    To the force it is the same as a gain of the length channel, which is why pamjax has none of those.
    Threads are loaded with ∂V/∂B, so that force and volume still belong together.

    An alternative to `end_taper`, never beside it. Neutral: k = 1. What it leaves out: why; diameter,
    which stays a cylinder's; a k that falls with pressure.
    Source: Tondu & Lopez, IEEE Control Syst. Mag. 20, 15 (2000); the volume derived here.
    """

    id: ClassVar[str] = "contraction_factor"
    about: ClassVar[Description] = Description(
        title="contraction counted k times, a textbook's stand-in for end_taper",
        equation="F = P [3 (L0 - k (L0 - L))^2 - B^2] / (4 pi N^2),   k = 1 + excess",
        signature="Force is lost in proportion to pressure and to contraction: nothing at rest, most at free"
        " contraction. Diameter stays that of a cylinder.",
        leaves_out="what the ends look like; diameter; a factor that depends on pressure",
        confusable=("end_taper", "length_offset", "pressure_gain"),
        experiment="A gauge block for the length channel; diameter, which a wrong length moves, not k.",
        source="Tondu & Lopez 2000; the volume that belongs to it derived here",
    )

    excess: Scalar = parameter(
        "1", low=0.0, high=0.5, neutral=0.0, about="Tondu's factor less one",
        source="factors of 1.0 to 1.3 in the literature", default=0.0,
    )  # fmt: skip
    length: Scalar = parameter(
        "m", show="mm", low=1e-3, high=20.0, scale="log", about="of the muscle at rest",
        source="from which contraction is counted", default=0.2,
    )  # fmt: skip

    def shape(self, state: State) -> State:
        factor = 1 + self.excess
        stroked = self.length - factor * (self.length - state.length)
        counted = braid.volume(stroked, state.thread, state.turns) / factor
        more = counted - braid.volume(state.length, state.thread, state.turns)
        return eqx.tree_at(lambda s: s.volume, state, state.volume + more)
