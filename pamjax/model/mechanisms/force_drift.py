"""The load cell's zero wanders with time."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceDrift(AbstractSensor):
    """A zero that wanders: F_recorded = F + a t + b t², t from the first sample.

        a  rate  N/s   first slope of the zero
        b  bend  N/s²  half of the change of that slope in a second

    Neutral: a = b = 0. What it leaves out: a zero that wanders to and fro, temperature itself.
    Source: derived here, Taylor's first terms.
    """

    id: ClassVar[str] = "force_drift"
    about: ClassVar[Description] = Description(
        title="the load cell's zero wanders with time",
        equation="F_recorded = F + a t + b t^2",
        signature="The same newtons at every pressure and length, growing with time; nothing returns when a"
        " stroke is repeated. Diameter is right.",
        leaves_out="wandering to and fro, temperature",
        confusable=("force_offset", "viscoelastic_creep", "thread_slip"),
        experiment="The reading of the unclamped muscle before and after; repeat the first isobar last.",
        source="Taylor's first terms",
    )

    rate: Scalar = parameter(
        "N/s", low=-1.0, high=1.0, neutral=0.0, about="first slope of the zero",
        source="some percent of full scale in an hour, or in minutes while the cell warms up", default=0.0,
    )  # fmt: skip
    bend: Scalar = parameter(
        "N/s^2", low=-1e-2, high=1e-2, neutral=0.0, about="half of the change of slope in a second",
        source="as the rate, over some minutes", default=0.0,
    )  # fmt: skip

    def read(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        since = history.time - history.time[0]
        return force + since * (self.rate + self.bend * since), diameter
