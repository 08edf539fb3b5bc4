"""The pressure gauge's gain is wrong."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Samples
from pamjax.parameter import Scalar, parameter


class PressureGain(AbstractSensor):
    """A gain, recorded over true minus one: P = P_recorded / (1 + g).

        g  gain  1  share by which pressure reads too large

    Neutral: g = 0. What it leaves out: non-linearity. Source: by definition.
    """

    id: ClassVar[str] = "pressure_gain"
    about: ClassVar[Description] = Description(
        title="the pressure gauge's gain is wrong",
        equation="P = P_recorded / (1 + g)",
        signature="Force is wrong by a share of what pressure makes of it, as with a wrong gain of the load"
        " cell: the two are told apart by nothing but a weight.",
        leaves_out="non-linearity",
        confusable=("force_gain", "pressure_offset", "length_offset"),
        experiment="A second gauge at the muscle; dead weights on the load cell.",
        source="by definition: recorded over true, minus one",
    )

    gain: Scalar = parameter(
        "1", show="%", low=-0.3, high=0.3, neutral=0.0, about="recorded over true pressure, minus one",
        source="1 % of a sensor, more of an amplifier set by hand", default=0.0,
    )  # fmt: skip

    def undo(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        return pressure / (1 + self.gain), length
