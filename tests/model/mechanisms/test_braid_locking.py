"""Contact of neighbouring threads at both ends of the stroke."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.bench import record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_locking import BraidLocking
from pamjax.model.state import Cylinder
from tests.agreement import ROUNDING, SOLVED, agree, printed
from tests.model.mechanisms import triangle
from tests.model.mechanisms.typical import LENGTH, THREAD, TURNS, bench

ANGLE = np.radians([25.0, 33.0, 45.0, 57.0, 65.0, 69.8, 75.0, 80.0])
AT = THREAD * np.sin(ANGLE)
STILL = build_time_history(None, np.arange(ANGLE.size) == 0)
N = 144


@cache
def added(pressure, stiffness, width):
    """Return the locking force at the angles above, N, and the change of diameter, m."""
    level = np.full(ANGLE.size, pressure)
    jammed = record_bench(bench(BraidLocking(stiffness, width)), level, AT, STILL)
    free = record_bench(bench(BraidLocking(0.0, width)), level, AT, STILL)
    return np.asarray(jammed.force - free.force), np.asarray(jammed.diameter - free.diameter)


def test_locked_threads_act_as_a_spring_in_their_spacing():
    """F = −k ⟨w − s⟩ 2 cos 2θ / (n N cos θ) of one pair of threads with stiffness k, N/m."""
    width, stiffness = 1.4e-3, 3e5
    spacing = THREAD / (N * TURNS) * np.sin(2 * ANGLE)
    pair = stiffness * THREAD**3 / (4 * np.pi * TURNS**2) / width**2
    force = -pair * (width - spacing) * 2 * np.cos(2 * ANGLE) / (N * TURNS * np.cos(ANGLE))
    touching = width - spacing > 0.15e-3
    force_difference, _ = added(4e5, stiffness, N * width)
    assert touching.sum() == 5
    agree(force_difference[touching], force[touching], 1e-5)
    assert np.all(np.abs(force_difference[spacing - width > 0.15e-3]) < 1e-3)


def test_locking_pulls_at_the_long_end_and_pushes_at_the_short_end():
    force, diameter = added(4e5, 3e5, N * 1.6e-3)
    assert np.all(force[np.radians(50) < ANGLE] > 1.0)
    assert np.all(force[np.radians(40) > ANGLE] < -1.0)
    assert abs(force[2]) < 1e-6 * np.max(force)
    agree(diameter, 0.0, ROUNDING, 0.03)


@pytest.mark.parametrize(("contraction", "spacing"), [(0.0, "1.04"), (0.2465, "1.60")])
def test_spacing_of_the_kevlar_muscle(contraction, spacing):
    """From the energy, whose square root is linear in the spacing; the largest spacing is at 45°."""
    width = 0.4
    state = Cylinder()(np.array(LENGTH * (1 - contraction)), np.array(THREAD), np.array(TURNS))
    energy = float(BraidLocking(1.0, width).energy(state))
    full = 0.5 * THREAD**3 / (4 * np.pi * TURNS**2)
    printed(1e3 * width * (1 - np.sqrt(energy / full)) / N, spacing)


@pytest.mark.parametrize(
    ("length", "spacing"),
    # S = 2 L √(B² − L²) / (B N): 2 × 0.2 × 0.15 / 0.3125 and 2 × 0.24 × 0.07 / 0.3125 m, none when straight.
    [(0.2, 0.192), (0.24, 0.10752), (0.26, 0.0)],
)
def test_energy_of_locked_threads_agrees_with_a_hand_calculation(length, spacing):
    # W = K B³ / (8πN²) ⟨c⟩² with c = 1 − S/w and ⟨c⟩ = [c + √(c² + 0.01²)] / 2.
    closer = 1 - spacing / 0.24
    rounded = 0.5 * (closer + np.sqrt(closer**2 + 1e-4))
    energy = BraidLocking(0.2e6, 0.24).energy(triangle.state(length))
    agree(energy, 0.2e6 * 0.25**3 / (8 * np.pi * 1.25**2) * rounded**2, ROUNDING)


def test_rounding_spreads_the_onset_of_contact():
    # At S = w the rounded overlap is ρ/2: W = K B³ / (8πN²) (ρ/2)² with ρ = 0.1.
    energy = BraidLocking(0.2e6, 0.192, rounding=0.1).energy(triangle.state(0.2))
    agree(energy, 0.2e6 * 0.25**3 / (8 * np.pi * 1.25**2) * 0.05**2, 1e-9)


@pytest.mark.parametrize(("exponent", "share"), [(0.5, 2 / 3), (1.5, 2 / 5), (3.0, 1 / 4)])
def test_exponent_changes_the_power_of_the_overlap(exponent, share):
    # W = K B³ / (4πN²) ⟨c⟩^(m+1) / (m + 1) with S = 0.192 m of threads 0.24 m wide: c = 1/5.
    rounded = 0.5 * (0.2 + np.sqrt(0.04 + 1e-4))
    energy = BraidLocking(0.2e6, 0.24, exponent).energy(triangle.state(0.2))
    agree(energy, share * 0.2e6 * 0.25**3 / (4 * np.pi * 1.25**2) * rounded ** (exponent + 1), ROUNDING)


def test_stretch_of_the_threads_changes_the_spacing():
    """Threads of 0.25 m, stretched to 0.26 m: the energy is that of the unstretched length, or of a share."""
    stretched = triangle.state(0.2, 0.26)
    prepared = BraidLocking(0.2e6, 0.24).prepare(jnp.asarray(0.25), jnp.asarray(1.25))
    agree(prepared.energy(stretched), BraidLocking(0.2e6, 0.24).energy(triangle.state(0.2)), ROUNDING)
    half = BraidLocking(0.2e6, 0.24, stretch=0.5).prepare(jnp.asarray(0.25), jnp.asarray(1.25))
    agree(half.energy(stretched), BraidLocking(0.2e6, 0.24).energy(triangle.state(0.2, 0.255)), ROUNDING)
    # Negative control: the stretch opens the contact.
    assert BraidLocking(0.2e6, 0.24).energy(stretched) < 0.9 * prepared.energy(stretched)


def test_force_is_the_same_at_every_pressure_unless_the_stretch_opens_the_contact():
    def compute_force(stretch, pressure):
        level, threads = np.full(ANGLE.size, pressure), BraidElasticity(2e-6)
        jammed = record_bench(
            bench(BraidLocking(3e5, N * 1.4e-3, stretch=stretch), threads), level, AT, STILL
        )
        return np.asarray(jammed.force - record_bench(bench(threads), level, AT, STILL).force)

    agree(compute_force(0.0, 1e5), compute_force(0.0, 5e5), SOLVED, 1e3)
    assert np.max(compute_force(1.0, 1e5) - compute_force(1.0, 5e5)) > 1.0


def test_force_grows_with_a_power_of_the_overlap():
    # dW/dL at constant thread length: −K V° ⟨c⟩^m d⟨c⟩/dc · dS/dL / w with
    # dS/dL = 2 (B² − 2 L²) / (B N √(B² − L²)), where the root is 0.15 m at 0.2 m.
    def force(exponent):
        return jax.grad(lambda x: jnp.sum(BraidLocking(0.2e6, 0.24, exponent).energy(triangle.state(x))))(0.2)

    slope = 2 * (0.25**2 - 2 * 0.2**2) / (0.25 * 1.25 * 0.15)
    root = np.sqrt(0.04 + 1e-4)
    rounded, steepness = 0.5 * (0.2 + root), 0.5 * (1 + 0.2 / root)
    size = 0.2e6 * 0.25**3 / (4 * np.pi * 1.25**2)
    for exponent in (0.5, 1.0, 2.5):
        agree(force(exponent), -size * rounded**exponent * steepness * slope / 0.24, 1e-9)
    assert force(1.0) > force(2.5) > 0


@pytest.mark.parametrize("width", [0.192, 0.1, 1e-3, 1e-9])
@pytest.mark.parametrize("exponent", [0.5, 1.0, 3.0])
def test_derivatives_are_finite_without_overlap(width, exponent):
    """At the first contact, far from it, and where rounding cancels the overlap."""

    def energy(x):
        return BraidLocking(x[0], x[1], x[2]).energy(triangle.state(x[3]))

    at = jnp.array([0.2e6, width, exponent, 0.2])
    assert np.all(np.isfinite(jax.grad(energy)(at)))
    assert np.all(np.isfinite(jax.hessian(energy)(at)))


def test_separate_threads_store_almost_no_energy():
    # S = 0.192 m of threads 0.1 m wide: c = −0.92, of which the rounded corner leaves 1e-4 / (4 × 0.92).
    energy = BraidLocking(0.2e6, 0.1).energy(triangle.state(0.2))
    agree(energy, 0.2e6 * 0.25**3 / (8 * np.pi * 1.25**2) * (1e-4 / (4 * 0.92)) ** 2, 1e-3)
