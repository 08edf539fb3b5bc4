"""Zero error of the load cell."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceOffset(AbstractSensor):
    """An offset, recorded minus true: F_recorded = F + f.

        f  offset  N  reading of an unloaded load cell

    It includes the weight of parts that hang on the load cell. Neutral: f = 0. Neglects: zero
    drift. Source: by definition.
    """

    id: ClassVar[str] = "force_offset"
    about: ClassVar[Description] = Description(
        title="zero error of the load cell",
        equation="F_recorded = F + f",
        signature="The force error is the same in newtons at every pressure, length and time. Diameter is"
        " not affected.",
        neglects="a zero that drifts with time or temperature",
        confusable=("force_drift", "bladder_elasticity", "pressure_offset"),
        experiment="Read the force of the unclamped, vented muscle.",
        source="by definition: recorded minus true",
    )

    offset: Scalar = parameter(
        "N", low=-1e3, high=1e3, neutral=0.0, about="recorded minus true force",
        source="up to some percent of full scale, and the weight of parts on the load cell", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        return force + self.offset, diameter
