"""Zero error of the length sensor."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Samples
from pamjax.parameter import Scalar, parameter


class LengthOffset(AbstractSensor):
    """An offset, recorded minus true: L = L_recorded − l.

        l  offset  m  error of the recorded length

    A rigid end piece that the recorded length includes has this effect. Neutral: l = 0. Neglects: a
    gain error of the length channel. Source: by definition.
    """

    id: ClassVar[str] = "length_offset"
    about: ClassVar[Description] = Description(
        title="zero error of the length sensor",
        equation="L = L_recorded - l",
        signature="The force error is proportional to pressure times length: a little smaller at free"
        " contraction than at rest length. The diameter error is the same at every pressure, and largest at"
        " rest length.",
        neglects="a gain error of the length channel",
        confusable=("braid_elasticity", "thread_slip", "pressure_gain", "diameter_offset"),
        experiment="Check the length with a gauge block. Record a pressure ramp at one length: threads"
        " stretch, a zero error does not change.",
        source="by definition: recorded minus true",
    )

    offset: Scalar = parameter(
        "m", show="mm", low=-0.02, high=0.02, neutral=0.0, about="recorded minus true length",
        source="0.5 to 2 mm at the fittings, more if measured with a ruler", default=0.0,
    )  # fmt: skip

    def to_true_inputs(self, pressure: Samples, length: Samples, history: History) -> tuple[Samples, Samples]:
        return pressure, length - self.offset
