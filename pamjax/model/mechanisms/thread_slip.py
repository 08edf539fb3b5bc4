"""Permanent lengthening of the threads: bedding-in, and slip at the fittings."""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp

from pamjax.model import scan
from pamjax.model.form_error import FormError, list_powers
from pamjax.model.history import History
from pamjax.model.mechanism import AbstractSlip, Description, Past, Samples
from pamjax.parameter import Scalar, parameter

#: Loads below this multiple of `load` count as this one. Their bedding-in is zero to rounding.
_MIN_RELATIVE_LOAD = 1e-15


class ThreadSlip(AbstractSlip):
    """Bedding-in under the largest load so far, and one slip at a separate time:

        B0 (t) = B0 [1 + e (1 − exp(−(Tmax/Tc)^m)) + a / (1 + exp(−(t − t0)/w))]

        e     bedding            1   strain after complete bedding-in
        Tc    load               N   load of all threads together at which 63 % of the bedding-in is complete
        m     bedding_exponent   1   larger: contacts that settle at more equal loads
        Tmax                     N   largest load of all threads so far
        a     step               1   strain of the slip
        t0    when               s   time of the middle of the slip
        w     during             s   duration: 46 % of the slip occurs from t0 − w to t0 + w

    Both are permanent and monotone. They continue across gaps, and remain when the pressure is released.
    Every contact of the braid settles at a load of its own, and these loads have a Weibull distribution.
    Far below Tc, the bedding-in is e (Tmax/Tc)^m.

    Neutral: e = a = 0. The samples of a static map have no order, so that a static map has no bedding-in.
    Neglects: creep, recovery, more than one slip, a loss of turns.
    Source: constructional stretch of ropes; distribution of loads after Weibull, J. Appl. Mech. 18, 293
    (1951); derived here in this form.
    """

    id: ClassVar[str] = "thread_slip"
    about: ClassVar[Description] = Description(
        title="permanent elongation of the threads",
        equation="B0(t) = B0 [1 + e (1 - exp(-(Tmax/Tc)^m)) + a / (1 + exp(-(t - t0)/w))]",
        signature="Force decreases and diameter increases permanently, at each new maximum of the load or at"
        " one time. The force loss is proportional to pressure, and the same at every length.",
        neglects="creep, recovery, more than one slip",
        confusable=("thread_crimp", "braid_elasticity", "mullins_softening", "force_drift"),
        experiment="Repeat the lowest isobar at the end: the effect of a slip remains. Record the isobars in"
        " descending order of pressure: bedding-in occurs in the first stroke only.",
        source="derived here; constructional stretch of ropes; Weibull 1951 (distribution of loads)",
    )
    # Not in pressure: a slip is one strain at every load. A strain that grows with the load is elastic.
    form_error: ClassVar[FormError] = FormError(list_powers("time", 8))

    bedding: Scalar = parameter(
        "1", show="%", low=0.0, high=0.03, neutral=0.0, about="strain after complete bedding-in",
        source="0.05 to 0.5 % for aramid braid, some percent for ropes", default=0.0,
    )  # fmt: skip
    load: Scalar = parameter(
        "N", low=1.0, high=1e5, scale="log",
        about="load of all threads at which 63 % of the bedding-in is complete",
        source="from a twentieth of the breaking load to the full working load", default=500.0,
    )  # fmt: skip
    bedding_exponent: Scalar = parameter(
        "1", low=1.0, high=6.0, is_refinement=True,
        about="exponent of the load in the bedding-in",
        source="1 for widely scattered settling loads, more for nearly equal ones", default=1.0,
    )  # fmt: skip
    step: Scalar = parameter(
        "1", show="%", low=0.0, high=0.03, neutral=0.0, about="strain of the slip",
        source="0 to 2 mm at a fitting before it fails, for threads of 0.1 to 1 m", default=0.0,
    )  # fmt: skip
    when: Scalar = parameter(
        "s", low=0.0, high=1e6, about="time of the middle of the slip", source="within the recording",
        default=60.0,
    )  # fmt: skip
    during: Scalar = parameter(
        "s", low=0.05, high=1e5, scale="log", about="duration of the slip",
        source="from stick-slip to most of a recording", default=2.0,
    )  # fmt: skip

    def extension(self, history: History, past: Past) -> Samples:
        largest_load = scan.running_max(past.load, history.restart)
        # The power of zero has no derivative by its exponent.
        relative_load = jnp.maximum(largest_load / self.load, _MIN_RELATIVE_LOAD)
        bedding_strain = -self.bedding * jnp.expm1(-(relative_load**self.bedding_exponent))
        slip_strain = self.step * jax.nn.sigmoid((history.time - self.when) / self.during)
        has_time = history.time[-1] > history.time[0]
        return jnp.where(has_time, bedding_strain + slip_strain, 0.0)
