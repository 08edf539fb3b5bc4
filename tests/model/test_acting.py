"""A bench computes an expensive mechanism only if it acts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.bench import Bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.channel_lag import ChannelLag
from pamjax.model.mechanisms.end_cones import EndCones
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.mechanisms.thread_slip import ThreadSlip
from pamjax.model.mechanisms.viscous_damping import ViscousDamping
from tests.agreement import SOLVED, agree

TIME = np.arange(60.0)
PAST = build_time_history(TIME, TIME == 0)
PRESSURE, LENGTH = jnp.asarray(3e5 + 1e5 * np.sin(TIME / 7)), jnp.asarray(0.22 - 0.02 * np.cos(TIME / 11))


def compute_force(mechanisms, acting=None):
    return Bench(0.2512, 1.09, mechanisms, acting)(PRESSURE, LENGTH, PAST).force


def test_one_pass_is_sufficient_without_memory():
    @jax.jit
    def force(coefficient, lasting):
        kinds = BraidElasticity(1e-6), BraidFriction(coefficient, 15 * coefficient)
        return compute_force(kinds, {"braid_friction": lasting})

    once, twice = jnp.asarray(False), jnp.asarray(True)
    agree(force(0.0, once), force(0.0, twice), SOLVED, 100.0)
    by_thread = compute_force((BraidElasticity(1e-6), BraidFriction(0.2, 3.0)))
    agree(force(0.2, twice), by_thread, SOLVED, 100.0)
    # Negative control: with friction, one pass of the recording is not sufficient.
    assert np.max(np.abs(force(0.2, once) - force(0.2, twice))) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    "mechanism",
    [
        BraidFriction(0.2, 3.0),
        BladderElasticity(3e5, 0.1, 0.019, 0.0016, 0.2357),
        ChannelLag(0.4),
        EndCones(0.012),
        PressureDrop(1e8),
        ThreadSlip(1e-3, 50.0),
    ],
    ids=lambda mechanism: mechanism.id,
)
def test_mechanism_that_does_not_act_is_left_out(mechanism):
    damping = ViscousDamping(jnp.asarray(400.0))

    @jax.jit
    def force_and_slope(acting):
        """Return the force, and its derivative by the thread length."""

        def force(thread_length):
            bench = Bench(thread_length, 1.09, (mechanism, damping), acting)
            return bench(PRESSURE, LENGTH, PAST).force

        return jax.jvp(force, (0.2512,), (1.0,))

    def compute_alone(*mechanisms):
        return jax.jvp(lambda b: Bench(b, 1.09, mechanisms)(PRESSURE, LENGTH, PAST).force, (0.2512,), (1.0,))

    without = force_and_slope({mechanism.id: jnp.asarray(False), damping.id: jnp.asarray(True)})
    both = force_and_slope({mechanism.id: jnp.asarray(True), damping.id: jnp.asarray(True)})
    for result, expected in ((without, compute_alone(damping)), (both, compute_alone(mechanism, damping))):
        agree(result[0], expected[0], SOLVED, 100.0)
        agree(result[1], expected[1], SOLVED, float(np.max(np.abs(expected[1]))))
    # Negative control: both mechanisms have an effect.
    assert np.max(np.abs(both[0] - without[0])) > 0.1
    assert np.max(np.abs(without[0] - compute_alone()[0])) > 0.1
