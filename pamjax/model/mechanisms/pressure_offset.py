"""The pressure gauge's zero is wrong."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Samples
from pamjax.parameter import Scalar, parameter


class PressureOffset(AbstractSensor):
    """An offset, recorded minus true: P = P_recorded − p.

        p  offset  Pa  what a vented gauge reads

    Neutral: p = 0. What it leaves out: a zero that wanders, a barometer that changes.
    Source: by definition.
    """

    id: ClassVar[str] = "pressure_offset"
    about: ClassVar[Description] = Description(
        title="the pressure gauge's zero is wrong",
        equation="P = P_recorded - p",
        signature="The same newtons at every pressure, in proportion to 3 L^2 - B^2: most at rest, none at"
        " free contraction.",
        leaves_out="a zero that wanders, ambient pressure",
        confusable=("contact_pressure", "bladder_elasticity", "force_offset", "pressure_gain"),
        experiment="The reading of the vented gauge.",
        source="by definition: recorded minus true",
    )

    offset: Scalar = parameter(
        "Pa", show="kPa", low=-1e5, high=1e5, neutral=0.0, about="recorded minus true pressure",
        source="1 % of full scale; an atmosphere where absolute was taken for gauge", default=0.0,
    )  # fmt: skip

    def undo(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        return pressure - self.offset, length
