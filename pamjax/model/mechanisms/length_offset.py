"""The length zero is wrong."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Samples
from pamjax.parameter import Scalar, parameter


class LengthOffset(AbstractSensor):
    """An offset, recorded minus true: L = L_recorded − l.

        l  offset  m  by how much the length reads too large

    A swage that does not move and was counted in is one. Neutral: l = 0. What it leaves out: a gain of
    the length channel. Source: by definition.
    """

    id: ClassVar[str] = "length_offset"
    about: ClassVar[Description] = Description(
        title="the length zero is wrong",
        equation="L = L_recorded - l",
        signature="Force is wrong as pressure times length: little less at free contraction than"
        " at rest. Diameter is wrong at every pressure alike, most at rest.",
        leaves_out="a gain of the length channel",
        confusable=("braid_elasticity", "thread_slip", "pressure_gain", "diameter_offset"),
        experiment="A gauge block; a pressure ramp at one length, on which threads stretch and a zero stays.",
        source="by definition: recorded minus true",
    )

    offset: Scalar = parameter(
        "m", show="mm", low=-0.02, high=0.02, neutral=0.0, about="recorded minus true length",
        source="0.5 to 2 mm at the fittings, more by ruler", default=0.0,
    )  # fmt: skip

    def undo(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        return pressure, length - self.offset
