"""A lag: delay of the force channel, s."""

import numpy as np

from pamjax.model.mechanisms.channel_lag import ChannelLag
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import compiled, one_run

TIME = np.arange(20.0)


def late(lag):
    read = ChannelLag(lag).to_recorded_outputs
    force, diameter = compiled(read, 10 * TIME, np.full(20, 0.03), None, one_run(TIME))
    agree(diameter, 0.03, ROUNDING)
    return np.asarray(force)


def test_recorded_force_is_delayed_by_the_lag():
    # F = 10 N/s · t: with a lag of 0.5 s the recorded force at t is 10 (t − 0.5); before, the first value.
    agree(late(0.5), 10 * np.maximum(TIME - 0.5, 0.0), ROUNDING, 1.0)
    agree(late(-0.5), 10 * np.minimum(TIME + 0.5, TIME[-1]), ROUNDING, 1.0)
