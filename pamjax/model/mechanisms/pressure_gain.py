"""Gain error of the pressure gauge."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Samples
from pamjax.parameter import Scalar, parameter


class PressureGain(AbstractSensor):
    """A relative error of pressure: P = P_recorded / (1 + g).

        g  gain  1  recorded over true pressure, minus one

    Neutral: g = 0. Neglects: non-linearity. Source: by definition.
    """

    id: ClassVar[str] = "pressure_gain"
    about: ClassVar[Description] = Description(
        title="gain error of the pressure gauge",
        equation="P = P_recorded / (1 + g)",
        signature="The force error is proportional to the part of the force that pressure produces. It"
        " resembles a gain error of the load cell: only a weight on the load cell distinguishes the two.",
        neglects="non-linearity",
        confusable=("force_gain", "pressure_offset", "length_offset"),
        experiment="Compare with a second gauge at the muscle. Calibrate the load cell with dead weights.",
        source="by definition: recorded over true, minus one",
    )

    gain: Scalar = parameter(
        "1", show="%", low=-0.3, high=0.3, neutral=0.0, about="recorded over true pressure, minus one",
        source="1 % for a sensor, more for an amplifier that was set by hand", default=0.0,
    )  # fmt: skip

    def to_true_inputs(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        return pressure / (1 + self.gain), length
