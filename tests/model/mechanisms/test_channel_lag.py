"""A lag: delay of the force channel, s."""

import numpy as np

from pamjax.model.mechanisms.channel_lag import ChannelLag
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import compiled, one_run

TIME = np.arange(20.0)


def late(lag, smoothing=0.0, force=10 * TIME):
    read = ChannelLag(lag, smoothing).to_recorded_outputs
    force, diameter = compiled(read, force, np.full(20, 0.03), None, one_run(TIME))
    agree(diameter, 0.03, ROUNDING)
    return np.asarray(force)


def test_recorded_force_is_delayed_by_the_lag():
    # F = 10 N/s · t: with a lag of 0.5 s the recorded force at t is 10 (t − 0.5); before, the first value.
    agree(late(0.5), 10 * np.maximum(TIME - 0.5, 0.0), ROUNDING, 1.0)
    agree(late(-0.5), 10 * np.minimum(TIME + 0.5, TIME[-1]), ROUNDING, 1.0)


def test_filtered_ramp_is_late_by_the_time_constant():
    # The step response of τ dF/dt = F_in − F to a ramp of 10 N/s is 10 (t − τ (1 − exp(−t/τ))), τ = 2 s.
    agree(late(2.0, 1.0), 10 * (TIME - 2.0 * (1 - np.exp(-TIME / 2.0))), ROUNDING, 1.0)


def test_half_of_the_delay_can_be_a_filter():
    # A delay of 1 s, then a filter of 1 s; both change a ramp of 10 N/s that begins at 4 s.
    after = np.maximum(TIME - 5.0, 0.0)
    force = late(2.0, 0.5, 10 * np.maximum(TIME - 4.0, 0.0))
    expected = 10 * (after - (1 - np.exp(-after)))
    # The cubic between samples rounds the corner of the ramp.
    agree(force[8:], expected[8:], ROUNDING, 1.0)


def test_a_filter_does_not_act_on_early_force():
    agree(late(-0.5, 1.0), late(-0.5), ROUNDING, 1.0)
