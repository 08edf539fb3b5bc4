"""The length at a set force: one step from the measured length, and the solved length."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from pamjax.model.assembly import assemble, assemble_bench
from pamjax.model.bench import record_bench, remove_memories
from pamjax.model.history import build_time_history
from pamjax.model.isotonic import MIN_STIFFNESS, compute_stiffness, predict_length, solve_lengths
from tests.agreement import SOLVED, agree

BRAID = {"muscle.rest_length": 0.2, "muscle.thread_length": 0.214, "muscle.turns": 1.2}
RUBBER = {
    "bladder_elasticity.modulus": 4e5,
    "bladder_elasticity.inner_diameter": 0.018,
    "bladder_elasticity.thickness": 0.001,
}
PRESSURE, LOAD = np.array([1e5, 3e5, 6e5]), np.array([0.0, 20.0, 50.0])


def find_roots(muscle):
    """Return the lengths, m, at which the force equals the load, by bisection."""
    return np.array(
        [
            brentq(lambda x, p=p, f=f: float(muscle(p, x).force) - f, 0.09, 0.21, xtol=1e-13)
            for p, f in zip(PRESSURE, LOAD, strict=True)
        ]
    )


def predict_at(muscle, length):
    samples = (jnp.asarray(x) for x in (PRESSURE, length, LOAD))
    return predict_length(muscle, *samples, build_history(3))


@pytest.fixture(scope="module")
def muscle():
    return assemble("elastic", BRAID | {"thread.stiffness": 0.59e6})


@pytest.fixture(scope="module")
def roots(muscle):
    return find_roots(muscle)


@pytest.mark.parametrize("misfit", [-2e-3, -5e-4, 5e-4, 2e-3])
def test_step_reaches_the_root_within_its_stated_error(muscle, roots, misfit):
    length = roots + misfit
    error = np.asarray(predict_at(muscle, length).length) - roots
    # F″/2K is 1/2L for the bare braid; threads that stretch change it by less than a tenth.
    assert np.all(np.abs(error) < 1.2 * misfit**2 / (2 * length))
    assert np.all(np.abs(error) > 0.5 * misfit**2 / (2 * length))


def test_wrong_stiffness_misses_the_root(muscle, roots):
    length = roots + 5e-4
    reading = predict_at(muscle, length)
    wrong = length + (np.asarray(reading.length) - length) / 2
    assert np.all(np.abs(wrong - roots) > 1e-4)


def test_free_contraction_of_the_bare_braid_is_its_closed_form():
    free, is_solved = solve_lengths(
        assemble("inelastic", BRAID), PRESSURE, np.full(3, 0.2), np.zeros(3), build_history(3)
    )
    assert np.all(is_solved)
    agree(free.length, 0.214 / np.sqrt(3), SOLVED)


def build_history(n):
    return build_time_history(10.0 * np.arange(n), np.arange(n) == 0, stroke_channels=np.zeros((2, n)))


def test_length_without_equilibrium_is_not_solved():
    _, is_solved = solve_lengths(
        assemble("inelastic", BRAID), np.array([0.0]), np.array([0.2]), np.array([20.0]), build_history(1)
    )
    assert not np.any(is_solved)


def test_stiffness_without_pressure_has_a_lower_limit(muscle):
    stiffness = compute_stiffness(muscle, jnp.zeros(2), jnp.array([0.15, 0.19]), build_history(2))
    agree(stiffness, MIN_STIFFNESS, SOLVED)


def test_stiffness_of_the_bare_braid_is_its_closed_form():
    # F = P (3 L² − B²) / (4 π N²), so that ∂F/∂L = 3 P L / (2 π N²).
    length, expected = jnp.array([0.14, 0.16, 0.19]), 3 * PRESSURE / (2 * np.pi * 1.2**2)
    muscle = assemble("inelastic", BRAID)
    agree(
        compute_stiffness(muscle, jnp.asarray(PRESSURE), length, build_history(3)), expected * length, 1e-12
    )
    bench = assemble_bench("inelastic", (), BRAID)
    agree(compute_stiffness(bench, jnp.asarray(PRESSURE), length, build_history(3)), expected * length, 1e-12)


@pytest.mark.slow
def test_stiffness_of_a_bench_is_the_slope_of_its_force():
    ids = ("bladder_elasticity", "thread_crimp", "end_taper", "rig_compliance")
    bench, history, step = assemble_bench("inelastic", ids, BRAID | RUBBER), build_history(3), 1e-5
    pressure, length = jnp.asarray(PRESSURE), jnp.array([0.14, 0.16, 0.18])
    above, below = (record_bench(bench, pressure, length + s, history).force for s in (step, -step))
    agree(compute_stiffness(bench, pressure, length, history), (above - below) / (2 * step), 1e-6)


@pytest.mark.slow
def test_friction_delays_the_length_in_both_directions():
    ids, friction = ("bladder_elasticity", "braid_friction"), {"braid_friction.coefficient": 0.3}
    bench = assemble_bench("inelastic", ids, BRAID | RUBBER | friction | {"braid_friction.presliding": 1e-3})
    pressure = np.concatenate([np.linspace(1e5, 6e5, 21), np.linspace(6e5, 1e5, 21)[1:]])
    history = build_time_history(
        10.0 * np.arange(41), np.arange(41) == 0, stroke_channels=np.stack([pressure, pressure])
    )
    start, load = np.full(41, 0.16), np.zeros(41)
    rubbed, is_solved = solve_lengths(bench, pressure, start, load, history)
    smooth, _ = solve_lengths(remove_memories(bench), pressure, start, load, history)
    assert np.all(is_solved)
    excess = np.asarray(rubbed.length - smooth.length)
    assert np.all(excess[5:20] > 1e-4)
    assert np.all(excess[26:36] < -1e-4)
    # The solved length is a root of the whole model, memories included.
    agree(bench(jnp.asarray(pressure), rubbed.length, history).force, 0.0, 1e-5, scale=1.0)
