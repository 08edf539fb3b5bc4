"""Zero error of the pressure gauge."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Samples
from pamjax.parameter import Scalar, parameter


class PressureOffset(AbstractSensor):
    """An offset, recorded minus true: P = P_recorded − p.

        p  offset  Pa  reading of the vented gauge

    Neutral: p = 0. Neglects: zero drift, changes of ambient pressure.
    Source: by definition.
    """

    id: ClassVar[str] = "pressure_offset"
    about: ClassVar[Description] = Description(
        title="zero error of the pressure gauge",
        equation="P = P_recorded - p",
        signature="The force error is the same in newtons at every pressure. It is proportional to 3 L^2 -"
        " B^2: largest at rest length, zero at free contraction.",
        neglects="zero drift, changes of ambient pressure",
        confusable=("contact_pressure", "bladder_elasticity", "force_offset", "pressure_gain"),
        experiment="Read the vented gauge.",
        source="by definition: recorded minus true",
    )

    offset: Scalar = parameter(
        "Pa", show="kPa", low=-1e5, high=1e5, neutral=0.0, about="recorded minus true pressure",
        source="1 % of full scale; one atmosphere if absolute pressure is taken for gauge pressure",
        default=0.0,
    )  # fmt: skip

    def to_true_inputs(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        return pressure - self.offset, length
