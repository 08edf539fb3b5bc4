"""Gain error of the load cell."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.form_error import FormError
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceGain(AbstractSensor):
    """A relative error of force: F_recorded = (1 + g) F.

        g  gain  1  recorded over true force, minus one

    A pull at an angle a to the axis has the gain error cos a − 1. Neutral: g = 0. Neglects:
    non-linearity, hysteresis of the load cell. Source: by definition.
    """

    id: ClassVar[str] = "force_gain"
    about: ClassVar[Description] = Description(
        title="gain error of the load cell",
        equation="F_recorded = (1 + g) F",
        signature="The force error is proportional to force: largest at rest length and high pressure, zero"
        " at free contraction. Diameter is not affected.",
        neglects="non-linearity and hysteresis of the load cell",
        confusable=("pressure_gain", "length_offset", "rig_compliance"),
        experiment="Calibrate the load cell with dead weights.",
        source="by definition: recorded over true, minus one",
    )
    #: A load cell that is not linear.
    form_error: ClassVar[FormError] = FormError(("force",))

    gain: Scalar = parameter(
        "1", show="%", low=-0.3, high=0.3, neutral=0.0, about="recorded over true force, minus one",
        source="1 % for a load cell, more for an amplifier that was set by hand", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        return (1 + self.gain) * force, diameter
