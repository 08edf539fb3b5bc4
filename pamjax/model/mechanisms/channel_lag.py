"""The force channel is late."""

from __future__ import annotations

from typing import ClassVar

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ChannelLag(AbstractSensor):
    """A delay: F_recorded(t) = F(t − d), as well as the other samples of the run tell.

        d  lag  s  by how much force is late; negative where the other channels are

    Samples of other runs are never looked at: before a run begins the force was what it is then.
    Neutral: d = 0, exactly. What it leaves out: a filter (it is late by its time constant, and rounds
    corners besides), a lag of diameter. Source: by definition; interpolation as in `History.delay`.
    """

    id: ClassVar[str] = "channel_lag"
    about: ClassVar[Description] = Description(
        title="one channel is late against another",
        equation="F_recorded(t) = F(t - d)",
        signature="A loop opposite to that of friction when force is late, in proportion to speed and"
        " pressure, widest at mid-stroke; nothing in a hold, at once.",
        leaves_out="filters that round corners; a late diameter",
        confusable=("braid_friction", "viscous_damping", "pressure_drop"),
        experiment="The same stroke three times as fast; a hold, in which a lag ends at once.",
        source="by definition",
    )

    lag: Scalar = parameter(
        "s", low=-5.0, high=5.0, neutral=0.0, about="how late the force channel is",
        source="filters and loggers, a second at most as a rule", default=0.0,
    )  # fmt: skip

    def read(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        return history.delay(force, self.lag), diameter
