"""Zero drift of the load cell."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceDrift(AbstractSensor):
    """A zero error that changes with time: F_recorded = F + a t + b t², t from the first sample.

        a  rate  N/s   initial slope of the zero
        b  bend  N/s²  half of the change of this slope per second

    Neutral: a = b = 0. What it leaves out: a zero that oscillates, the effect of temperature.
    Source: derived here, first terms of a Taylor series.
    """

    id: ClassVar[str] = "force_drift"
    about: ClassVar[Description] = Description(
        title="zero drift of the load cell",
        equation="F_recorded = F + a t + b t^2",
        signature="The force error is the same in newtons at every pressure and length, and changes steadily"
        " with time. A repeated stroke does not repeat the force. Diameter is not affected.",
        leaves_out="a zero that oscillates, temperature",
        confusable=("force_offset", "viscoelastic_creep", "thread_slip"),
        experiment="Read the force of the unclamped muscle before and after the recording. Repeat the first"
        " isobar at the end.",
        source="first terms of a Taylor series",
    )
    form_error: ClassVar[FormError] = FormError(list_powers("time", 10), is_additive=True)

    rate: Scalar = parameter(
        "N/s", low=-1.0, high=1.0, neutral=0.0, about="initial slope of the zero",
        source="some percent of full scale in an hour, or in minutes while the load cell warms up",
        default=0.0,
    )  # fmt: skip
    bend: Scalar = parameter(
        "N/s^2", low=-1e-2, high=1e-2, neutral=0.0, about="half of the change of slope per second",
        source="as for the rate, over some minutes", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        elapsed = history.time - history.time[0]
        return force + elapsed * (self.rate + self.bend * elapsed), diameter
