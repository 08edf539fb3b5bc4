"""Time delay of the force channel against the other channels."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ChannelLag(AbstractSensor):
    """A time delay: F_recorded(t) = F(t − d), interpolated between the samples of a run.

        d  lag  s  delay of the force; negative if the other channels are late

    Samples of other runs are not used: before the start of a run, the force has its first value.
    Neutral: d = 0, exactly. What it leaves out: a filter (its delay is its time constant, and it rounds
    corners), a delay of diameter. Source: by definition; interpolation as in `History.delay`.
    """

    id: ClassVar[str] = "channel_lag"
    about: ClassVar[Description] = Description(
        title="time delay between force and the other channels",
        equation="F_recorded(t) = F(t - d)",
        signature="If force is late, the loop has the opposite sense of a friction loop. Its width is"
        " proportional to speed and pressure, and largest at mid-stroke. In a hold the effect disappears"
        " immediately.",
        leaves_out="filters that round corners, a delay of diameter",
        confusable=("braid_friction", "viscous_damping", "pressure_drop"),
        experiment="Repeat the stroke three times as fast. Record a hold, in which the effect of a delay"
        " disappears immediately.",
        source="by definition",
    )

    lag: Scalar = parameter(
        "s", low=-5.0, high=5.0, neutral=0.0,
        about="delay of the force channel; negative if the other channels are late",
        source="filters and data loggers, usually one second at most", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        return history.delay(force, self.lag), diameter
