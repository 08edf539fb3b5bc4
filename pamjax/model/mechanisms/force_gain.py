"""The load cell's gain is wrong."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceGain(AbstractSensor):
    """A gain, recorded over true minus one: F_recorded = (1 + g) F.

        g  gain  1  share by which force reads too large

    A pull at an angle a to the axis is one of cos a − 1. Neutral: g = 0. What it leaves out:
    non-linearity, hysteresis of the cell. Source: by definition.
    """

    id: ClassVar[str] = "force_gain"
    about: ClassVar[Description] = Description(
        title="the load cell's gain is wrong",
        equation="F_recorded = (1 + g) F",
        signature="Force is wrong by a share of itself: most at rest and high pressure, nothing at free"
        " contraction. Diameter is right.",
        leaves_out="non-linearity and hysteresis of the cell",
        confusable=("pressure_gain", "length_offset", "rig_compliance"),
        experiment="Dead weights on the load cell.",
        source="by definition: recorded over true, minus one",
    )

    gain: Scalar = parameter(
        "1", show="%", low=-0.3, high=0.3, neutral=0.0, about="recorded over true force, minus one",
        source="1 % of a cell, more of an amplifier set by hand", default=0.0,
    )  # fmt: skip

    def read(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        return (1 + self.gain) * force, diameter
