"""Time delay of the force channel against the other channels."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.model.scan import relax_states
from pamjax.parameter import Scalar, parameter

#: Time constant below which a filter has no effect, s.
_MIN_TIME_CONSTANT = 1e-6


class ChannelLag(AbstractSensor):
    """A time delay, followed by a low-pass filter:

        τ dF_recorded/dt = F(t − d + τ) − F_recorded,   τ = s max(d, 0)

        d  lag        s  delay of the force; negative if the other channels are late
        s  smoothing  1  share of the delay that is due to a filter of first order


    Samples of other runs are not used: before the start of a run, the force has its first value.
    Neutral: d = 0, exactly. Neglects: filters of higher order, a delay of diameter.
    Source: by definition; interpolation as in `History.delay`.
    """

    id: ClassVar[str] = "channel_lag"
    needs_time: ClassVar[bool] = True
    mixes_samples: ClassVar[bool] = True
    about: ClassVar[Description] = Description(
        title="time delay between force and the other channels",
        equation="tau dF_recorded/dt = F(t - d + tau) - F_recorded,   tau = s max(d, 0)",
        signature="If force is late, the loop has the opposite sense of a friction loop. Its width is"
        " proportional to speed and pressure, and largest at mid-stroke. In a hold the effect disappears"
        " immediately.",
        neglects="filters of higher order, a delay of diameter",
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

    smoothing: Scalar = parameter(
        "1", low=0.0, high=1.0, about="share of the delay that is due to a low-pass filter",
        source="0 for a delay in the data logger, 1 for an analogue filter", default=0.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        time_constant = self.smoothing * jnp.maximum(self.lag, 0.0)
        delayed_force = history.delay(force, self.lag - time_constant)
        # Deviation e of the filter from its input, with a linear input over each step of h time constants:
        # e ← e exp(−h) + ΔF (1 − exp(−h)) / h.
        steps = history.increments(history.time) / jnp.maximum(time_constant, _MIN_TIME_CONSTANT)
        mean_share = -jnp.expm1(-steps) / jnp.where(steps > 0, steps, 1.0)
        deviation = relax_states(
            history.increments(delayed_force) * mean_share, jnp.exp(-steps), history.restart
        )
        return delayed_force - jnp.where(time_constant > _MIN_TIME_CONSTANT, deviation, 0.0), diameter
