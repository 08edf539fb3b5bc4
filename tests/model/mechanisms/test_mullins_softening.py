"""Softening: only the first stretch is stiffer, and no closed path gains energy."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pamjax.model import wall
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.parameter import list_field_meanings
from tests.agreement import ROUNDING, SOLVED, agree
from tests.model.mechanisms.rubber import REST, SIZE, WALKS, returning, shown
from tests.model.mechanisms.triangle import one_run, static_map, tube

#: Rows of a path: steps of a twentieth of the smallest width along its longest part.
FINE = 20_000

NARROW, WIDE = (getattr(list_field_meanings(MullinsSoftening)["width"], end) for end in ("low", "high"))

stresses = jax.jit(lambda m, strains, past: m.stresses(past, strains, None))


def test_only_the_first_stretch_has_the_extra_stiffness():
    half = np.linspace(0, 1, 60)
    length = REST * (1 - np.concatenate([0.2 * half, 0.2 * half[::-1], 0.3 * half, 0.3 * half[::-1]]))
    lost = np.asarray(
        shown([MullinsSoftening(0.1e6, 0.02, **SIZE)], 4e5, length).force - shown([], 4e5, length).force
    )
    elastic = np.asarray(
        shown([BladderElasticity(0.1e6, **SIZE)], 4e5, length).force - shown([], 4e5, length).force
    )
    agree(lost[:60], elastic[:60], SOLVED, scale=1.0)
    second, beyond = length[120:180] > 0.82 * REST, length[120:180] < 0.799 * REST
    assert np.all(np.abs(lost[120:180][second]) < 1e-3)
    agree(lost[120:180][beyond], elastic[120:180][beyond], SOLVED, scale=1.0)
    assert np.all(np.abs(lost[180:][length[180:] > 0.75 * REST]) < 1e-3)


def test_softening_continues_across_a_gap_and_is_absent_in_a_static_map():
    length = REST * np.array([1.0, 0.8, 1.0, 0.9, 0.8])
    soft, starts = [MullinsSoftening(0.1e6, 0.05, **SIZE)], np.array([1, 0, 0, 1, 0], bool)
    still = shown([], 4e5, length).force
    gap = build_time_history(np.array([0, 10.0, 20, 5000, 5010]), starts)
    lost = shown(soft, 4e5, length, gap).force - still
    assert abs(lost[3]) < 1e-3
    assert lost[4] < -10.0
    agree(shown(soft, 4e5, length, build_time_history(None, starts)).force, still, ROUNDING)
    anew = build_time_history(np.array([0, 10.0, 20, 5000, 5010]), starts, restart=True)
    assert (shown(soft, 4e5, length, anew).force - still)[3] < -10.0


def gained(walk, rubber, law=lambda stress: stress):
    """Return the net work of a closed path / total work."""
    time, path = returning(walk, FINE)
    along, around = path[:, :1], path[:, 1:]
    energy = along**2 + around**2 + (along * around) ** -2 - 3
    energy[-1] = energy[0]
    energy = np.asarray(0.5 * wall.rubber_volume(rubber) * energy)
    stress = law(np.asarray(stresses(rubber, jnp.asarray(energy), build_time_history(time, time == 0))))
    done = 0.5 * (stress[1:] + stress[:-1]) * np.diff(energy, axis=0)
    return -done.sum() / np.abs(done).sum()


@settings(max_examples=30)
@given(WALKS, st.floats(NARROW, WIDE))
def test_softening_dissipates_energy(walk, width):
    # The error of the trapezoidal rule is quadratic in the step.
    assert gained(walk, MullinsSoftening(1e6, width, **SIZE)) < 1e-3


@pytest.mark.parametrize("width", [NARROW, WIDE])
def test_hardening_would_gain_energy(width):
    there_and_back = [(0.8, 2.0, 10.0)]
    rubber = MullinsSoftening(1e6, width, **SIZE)
    assert gained(there_and_back, rubber) < -0.1
    assert gained(there_and_back, rubber, lambda stress: stress.max() - stress) > 0.1


def test_softening_agrees_with_a_hand_calculation():
    # η = 1 − erf[(m − e) / (w m)] at first stretch, half and full largest energy, and a new largest energy.
    rubber, volume = MullinsSoftening(2e6, 0.5, **SIZE), math.pi * 1.5875e-3 * 20.6125e-3 * REST
    energy = 1e6 * volume * np.array([[1.0], [2.0], [1.5], [0.0], [4.0]])
    left = [1.0, 1.0, math.erfc(0.5), math.erfc(2.0), 1.0]
    computed = stresses(rubber, energy, one_run(np.arange(5.0)))
    agree(computed[:, 0], 2e6 * np.array(left), 1e-9)
    agree(stresses(rubber, energy, static_map(5)), 0.0, ROUNDING, 1.0)


def test_softening_of_a_small_stretch_uses_the_minimum_energy():
    # A millionth of the rubber's volume is added to the width w m: (m − e) / (w m + V/10⁶) = 2 / (1 + 1).
    rubber, volume = MullinsSoftening(2e6, 0.5, **SIZE), math.pi * 1.5875e-3 * 20.6125e-3 * REST
    energy = 1e-6 * volume * np.array([[0.0], [2.0], [0.0]])
    computed = stresses(rubber, energy, one_run(np.arange(3.0)))
    agree(computed[:, 0], 2e6 * np.array([1.0, 1.0, math.erfc(1.0)]), SOLVED)


def test_softening_energy_agrees_with_a_hand_calculation():
    # As in the test of the elastic bladder: stretches 1/2, 3/2, 4/3, thus e = V (I1 − 3) / 2 = V × 23/36.
    rubber = MullinsSoftening(1.0, 0.5, inner_diameter=16e-3, thickness=2e-3, length=0.2)
    computed = rubber.strains(tube(0.1, 0.5 * (27 + 72 / 27) * 1e-3), 0.0)
    agree(computed, [math.pi * 2e-3 * 18e-3 * 0.2 * 23 / 36], ROUNDING)


def test_cyclic_softening_agrees_with_a_hand_calculation():
    # s = μ_c exp[−β / (κ V)] with the path β / V = 0, 1, 1.5, 3 and 7 at κ = 2; a restart begins a new path.
    rubber = MullinsSoftening(cyclic_modulus=2e6, cyclic_energy=2.0, **SIZE)
    energy = math.pi * 1.5875e-3 * 20.6125e-3 * REST * np.array([[1.0], [2.0], [1.5], [0.0], [4.0]])
    computed = stresses(rubber, energy, one_run(np.arange(5.0)))
    agree(computed[:, 0], 2e6 * np.exp(-np.array([0.0, 1.0, 1.5, 3.0, 7.0]) / 2), 1e-9)
    agree(stresses(rubber, energy, static_map(5)), 0.0, ROUNDING, 1.0)
    anew = build_time_history(np.arange(5.0), np.array([1, 0, 0, 1, 0], bool), restart=True)
    agree(stresses(rubber, energy, anew)[:, 0], 2e6 * np.exp(-np.array([0.0, 1.0, 1.5, 0.0, 4.0]) / 2), 1e-9)


def test_cyclic_softening_adds_to_that_of_the_first_stretch():
    energy = 1e-5 * np.array([[1.0], [3.0], [0.5], [2.0]])
    shapes = {"width": 0.3, "cyclic_energy": 0.7, **SIZE}
    both, first, cyclic = (
        stresses(MullinsSoftening(**moduli, **shapes), energy, one_run(np.arange(4.0)))
        for moduli in ({"modulus": 1e6, "cyclic_modulus": 2e6}, {"modulus": 1e6}, {"cyclic_modulus": 2e6})
    )
    agree(both, first + cyclic, ROUNDING)


@pytest.mark.parametrize("sign", [1, -1])
def test_cyclic_softening_dissipates_energy(sign):
    # Work ≥ change of the stored energy μ η e. On a path that is its own reverse, a factor that increases
    # violates this.
    rubber = MullinsSoftening(cyclic_modulus=1e6, cyclic_energy=0.8, **SIZE)
    volume = wall.rubber_volume(rubber)
    energy = np.asarray(volume * (1 + 0.5 * np.cos(np.linspace(0, 12 * np.pi, FINE))))[:, None]
    stress = np.asarray(stresses(rubber, jnp.asarray(energy), one_run(np.arange(float(FINE)))))[::sign]
    work = np.sum(0.5 * (stress[1:] + stress[:-1]) * np.diff(energy, axis=0))
    stored = float(stress[-1, 0] * energy[-1, 0] - stress[0, 0] * energy[0, 0])
    assert sign * (work - stored) > 0.1 * float(volume) * 1e6
