"""Bedding-in and one slip: permanent increases of the thread length."""

import math

import numpy as np

from pamjax.model.mechanisms.thread_slip import ThreadSlip
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import compiled, one_run, past, static_map

LOAD = 500 * np.log([1.0, 2.0, 1.5, 4.0, 1.0])


def bedded(slip, when):
    return compiled(slip.extension, when, past(np.full(LOAD.size, 0.2), 0.0, load=LOAD))


def test_bedding_in_increases_the_thread_length():
    # e [1 − e^(−Tmax/Tc)] with Tmax / Tc = ln 1, ln 2, ln 2, ln 4, ln 4.
    computed = bedded(ThreadSlip(4e-3, 500.0), one_run(np.arange(5.0)))
    agree(computed, np.array([0.0, 2e-3, 2e-3, 3e-3, 3e-3]), ROUNDING, 1e-3)


def test_the_exponent_delays_the_bedding_in():
    # e [1 − e^(−(Tmax/Tc)^m)] with (Tmax / Tc)^2 = 0, ln 2, ln 2, ln 4, ln 4.
    load = 500 * np.sqrt(np.log([1.0, 2.0, 1.5, 4.0, 1.0]))
    slip = ThreadSlip(4e-3, 500.0, bedding_exponent=2.0)
    computed = compiled(slip.extension, one_run(np.arange(5.0)), past(np.full(5, 0.2), 0.0, load=load))
    agree(computed, np.array([0.0, 2e-3, 2e-3, 3e-3, 3e-3]), ROUNDING, 1e-3)


def test_bedding_in_far_below_its_load_is_a_power_of_the_load():
    # e (Tmax/Tc)^m to (Tmax/Tc)^m / 2 = 1e-9.
    load = np.array([1.0, 2.0, 4.0])
    slip = ThreadSlip(1e-3, 4000.0, bedding_exponent=3.0)
    computed = compiled(slip.extension, one_run(np.arange(3.0)), past(np.full(3, 0.2), 0.0, load=load))
    agree(computed / computed[0], np.array([1.0, 8.0, 64.0]), 1e-8)


def test_slip_increases_the_thread_length_at_its_time():
    # a / [1 + e^(−(t − t0)/w)] = a/4, a/2, 3a/4 at t0 − w ln 3, t0, t0 + w ln 3.
    time = 70 + 3 * math.log(3) * np.array([-1.0, 0.0, 1.0])
    slip = ThreadSlip(step=4e-3, when=70.0, during=3.0)
    computed = compiled(slip.extension, one_run(time), past(np.full(3, 0.2), 0.0))
    agree(computed, np.array([1e-3, 2e-3, 3e-3]), ROUNDING)


def test_slip_and_bedding_in_add_up_and_are_absent_in_a_static_map():
    slip = ThreadSlip(4e-3, 500.0, step=2e-3, when=2.0, during=0.1)
    # At t0 the slip and the bedding-in are half complete.
    agree(bedded(slip, one_run(np.arange(5.0)))[2], 1e-3 + 2e-3, ROUNDING)
    agree(bedded(slip, static_map(5)), 0.0, ROUNDING, 1e-3)
