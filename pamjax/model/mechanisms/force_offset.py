"""The load cell's zero is wrong."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceOffset(AbstractSensor):
    """An offset, recorded minus true: F_recorded = F + f.

        f  offset  N  what an unloaded cell reads

    Weight that hangs on the cell counts as one. Neutral: f = 0. What it leaves out: a zero that wanders.
    Source: by definition.
    """

    id: ClassVar[str] = "force_offset"
    about: ClassVar[Description] = Description(
        title="the load cell's zero is wrong",
        equation="F_recorded = F + f",
        signature="The same newtons everywhere: at every pressure, length and time. Diameter is right.",
        leaves_out="a zero that wanders with time or temperature",
        confusable=("force_drift", "bladder_elasticity", "pressure_offset"),
        experiment="The reading of the unclamped, vented muscle.",
        source="by definition: recorded minus true",
    )

    offset: Scalar = parameter(
        "N", low=-1e3, high=1e3, neutral=0.0, about="recorded minus true force",
        source="up to some percent of full scale, and dead weights", default=0.0,
    )  # fmt: skip

    def read(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        return force + self.offset, diameter
