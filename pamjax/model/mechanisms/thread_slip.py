"""Threads lengthen for good: bedding-in, and slip at the fittings."""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp

from pamjax.model import scan
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSlip, Description, Past, Samples
from pamjax.parameter import Scalar, parameter


class ThreadSlip(AbstractSlip):
    """Bedding-in under the largest load so far, and one slip at a time of its own.

        B0 (t) = B0 [1 + e (1 − exp(−Tmax/Tc)) + a / (1 + exp(−(t − t0)/w))]

        e     bedding    1   strain once all of the braid is bedded in
        Tc    load       N   load of all threads together at which 63 % of it is there
        Tmax             N   largest load of all threads so far
        a     step       1   strain by which the threads slip
        t0    when       s   middle of that slip
        w     during     s   its duration: 46 % of it happens from t0 − w to t0 + w

    Permanent and monotone: carried across gaps, unchanged when the pressure is gone. Neutral: e = a = 0.
    A static map has no order, so that nothing in it is bedded in. What it leaves out: creep, recovery,
    more than one slip, a loss of turns.
    Source: rope practice (constructional stretch); derived here in this form.
    """

    id: ClassVar[str] = "thread_slip"
    about: ClassVar[Description] = Description(
        title="threads lengthen for good",
        equation="B0(t) = B0 [1 + e (1 - exp(-Tmax/Tc)) + a / (1 + exp(-(t - t0)/w))]",
        signature="Force is lost and diameter gained at new highest loads, or at one time, for good; the loss"
        " is in proportion to pressure and the same at every length.",
        leaves_out="creep and recovery; more than one slip",
        confusable=("thread_crimp", "braid_elasticity", "mullins_softening", "force_drift"),
        experiment="Repeat the lowest isobar at the end: a slip is still there. Take the isobars in falling"
        " order: bedding-in happens in the first stroke only.",
        source="derived here; constructional stretch of ropes",
    )

    bedding: Scalar = parameter(
        "1", show="%", low=0.0, high=0.03, neutral=0.0, about="strain once the braid is bedded in",
        source="0.05 to 0.5 % for aramid braid, some percent for ropes", default=0.0,
    )  # fmt: skip
    load: Scalar = parameter(
        "N", low=1.0, high=1e5, scale="log", about="load of all threads at which 63 % of it is bedded in",
        source="a twentieth of the breaking load to all of the working load", default=500.0,
    )  # fmt: skip
    step: Scalar = parameter(
        "1", show="%", low=0.0, high=0.03, neutral=0.0, about="strain by which the threads slip at a time",
        source="0 to 2 mm at a fitting before it fails, of threads of 0.1 to 1 m", default=0.0,
    )  # fmt: skip
    when: Scalar = parameter(
        "s", low=0.0, high=1e6, about="time of that slip", source="within the recording", default=60.0
    )  # fmt: skip
    during: Scalar = parameter(
        "s", low=0.05, high=1e5, scale="log", about="duration of that slip",
        source="from stick-slip to most of a recording", default=2.0,
    )  # fmt: skip

    def extension(self, history: History, past: Past) -> Samples:
        most = scan.running_max(past.load, history.restart)
        bedded = -self.bedding * jnp.expm1(-most / self.load)
        slipped = self.step * jax.nn.sigmoid((history.time - self.when) / self.during)
        ordered = history.time[-1] > history.time[0]
        return jnp.where(ordered, bedded + slipped, 0.0)
