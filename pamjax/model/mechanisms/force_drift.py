"""Zero drift of the load cell."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSensor, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ForceDrift(AbstractSensor):
    """A zero error that changes with time, t from the first sample:

        F_recorded = F + a t + b t² + D (1 − e^(−t/τ)) + r √t + s sin(2πt/T) + c (1 − cos(2πt/T))

        a  rate          N/s    initial slope of the zero
        b  bend          N/s²   half of the change of this slope per second
        D  warmup        N      total change of the zero while the load cell warms up
        τ  warmup_time   s      time constant of the warm-up
        r  root          N/√s   change that grows with the square root of time
        s  swing_sine    N      amplitude of a periodic zero, part that starts with a slope
        c  swing_cosine  N      amplitude of a periodic zero, part that starts without a slope
        T  period        s      period of the swing

    Every term is zero at the first sample. A warm-up is the step response of one thermal mass. Heat that
    enters a thick body from its surface gives the square root of time. A room gives the period.

    Neutral: a = b = D = r = s = c = 0. Neglects: several time constants or periods, and a measured
    temperature.
    Source: the first terms of a Taylor series; Newton's law of cooling; Carslaw & Jaeger, Conduction of Heat
    in Solids (1959), for the square root.
    """

    id: ClassVar[str] = "force_drift"
    needs_time: ClassVar[bool] = True
    about: ClassVar[Description] = Description(
        title="zero drift of the load cell",
        equation="F_recorded = F + a t + b t^2 + D (1 - e^(-t/tau)) + r sqrt(t)\n"
        "             + s sin(2 pi t/T) + c (1 - cos(2 pi t/T))",
        signature="The force error is the same in newtons at every pressure and length, and changes slowly"
        " with time. During warm-up it changes fast at first, and approaches a limit. A repeated stroke does"
        " not repeat the force. Diameter is not affected.",
        neglects="several time constants or periods, a measured temperature",
        confusable=("force_offset", "viscoelastic_creep", "thread_slip"),
        experiment="Read the force of the unclamped muscle before and after the recording. Repeat the first"
        " isobar at the end.",
        source="first terms of a Taylor series; Newton's law of cooling; Carslaw & Jaeger 1959 (root)",
    )
    form_error: ClassVar[FormError] = FormError(list_powers("time", 30), is_additive=True)

    rate: Scalar = parameter(
        "N/s", low=-1.0, high=1.0, neutral=0.0, about="initial slope of the zero",
        source="some percent of full scale in an hour, or in minutes while the load cell warms up",
        default=0.0,
    )  # fmt: skip
    bend: Scalar = parameter(
        "N/s^2", low=-1e-2, high=1e-2, neutral=0.0, about="half of the change of slope per second",
        source="as for the rate, over some minutes", default=0.0,
    )  # fmt: skip

    warmup: Scalar = parameter(
        "N", low=-100.0, high=100.0, neutral=0.0, is_refinement=True,
        about="total change of the zero by warm-up",
        source="some percent of full scale of a load cell of some kN", default=0.0,
    )  # fmt: skip
    warmup_time: Scalar = parameter(
        "s", low=1.0, high=1e5, scale="log", is_refinement=True,
        about="time constant of the warm-up",
        source="seconds for a bare strain gauge, minutes to hours for a load cell in its frame",
        default=600.0,
    )  # fmt: skip
    root: Scalar = parameter(
        "N/s^0.5", low=-10.0, high=10.0, neutral=0.0, is_refinement=True,
        about="change of the zero per square root of time",
        source="as for the warm-up, within some minutes", default=0.0,
    )  # fmt: skip
    swing_sine: Scalar = parameter(
        "N", low=-50.0, high=50.0, neutral=0.0, is_refinement=True,
        about="amplitude of the sine of a periodic zero",
        source="some tenths of a percent of full scale for 10 K in the room", default=0.0,
    )  # fmt: skip
    swing_cosine: Scalar = parameter(
        "N", low=-50.0, high=50.0, neutral=0.0, is_refinement=True,
        about="amplitude of the cosine of a periodic zero",
        source="as for the sine", default=0.0,
    )  # fmt: skip
    period: Scalar = parameter(
        "s", low=60.0, high=1e6, scale="log", is_refinement=True, about="period of the periodic zero",
        source="minutes for the cycle of an air conditioner, a day for a room", default=1800.0,
    )  # fmt: skip

    def to_recorded_outputs(
        self, force: Samples, diameter: Samples, past: Past, history: History
    ) -> tuple[Samples, Samples]:
        elapsed = history.time - history.time[0]
        phase = 2 * jnp.pi * elapsed / self.period
        steady = elapsed * (self.rate + self.bend * elapsed) + self.root * jnp.sqrt(elapsed)
        settling = -self.warmup * jnp.expm1(-elapsed / self.warmup_time)
        swing = self.swing_sine * jnp.sin(phase) + self.swing_cosine * (1 - jnp.cos(phase))
        return force + steady + settling + swing, diameter
