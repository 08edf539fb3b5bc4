"""Rivals are fitted to their best: planted coefficients come back, from wherever the exponent lies."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from pamjax.baselines.empirical import Gaylord, Sarosi, fit_gaylord, fit_sarosi
from pamjax.errors import BadInput
from pamjax.records.shipped_tables import convert_to_si, read_shipped

PRESSURE, CONTRACTION = (
    grid.ravel() for grid in np.meshgrid(np.linspace(50e3, 600e3, 8), np.linspace(0.0, 0.25, 6))
)
LENGTH = 0.2357 * (1 - CONTRACTION)
MUSCLE = Gaylord(thread_length=0.2512, turns=1.09)


def planted(rate):
    return Sarosi(a=-4e-5, b=280.0, c=rate, d=-9e-3, e=3e-3, f=-260.0)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("rate", [-150.0, -33.0, -3.0, -0.3, 0.3, 8.0, 40.0, 150.0])
def test_planted_exponent_of_either_sign_comes_back(rate):
    law = planted(rate)
    found = fit_sarosi(PRESSURE, CONTRACTION, law.force(PRESSURE, CONTRACTION))
    assert found.c == pytest.approx(rate, rel=1e-5)
    assert found.b == pytest.approx(law.b, rel=1e-4)
    assert not found.at_limit


def test_a_local_search_from_the_wrong_side_is_beaten():
    force = planted(-33.0).force(PRESSURE, CONTRACTION)
    bar = PRESSURE / 1e5

    def residual(x):
        curve = np.exp(np.clip(x[2] * CONTRACTION, -100, 100))
        return (x[0] * bar + x[1]) * curve + x[3] * CONTRACTION * bar + x[4] * bar + x[5] - force

    local = least_squares(residual, [1, 1, 30, 1, 1, 1], x_scale="jac", max_nfev=500)
    assert local.x[2] > 0
    assert rms(local.fun) > 30
    found = fit_sarosi(PRESSURE, CONTRACTION, force)
    assert rms(found.force(PRESSURE, CONTRACTION) - force) < 1e-6


def test_no_grid_of_exponents_does_better():
    rng = np.random.default_rng(7)
    force = MUSCLE.force(PRESSURE, LENGTH) + rng.normal(0, 20, PRESSURE.size)
    found = fit_sarosi(PRESSURE, CONTRACTION, force)
    best = rms(found.force(PRESSURE, CONTRACTION) - force)
    for rate in np.concatenate([-np.geomspace(0.1, 190, 200), np.geomspace(0.1, 190, 200)]):
        curve = np.exp(rate * CONTRACTION) / np.exp(max(rate, 0) * 0.25)
        p = PRESSURE / 6e5
        design = np.column_stack([p * curve, curve, CONTRACTION * p, p, np.ones_like(p)])
        assert best <= rms(design @ np.linalg.lstsq(design, force, rcond=None)[0] - force) + 1e-9


def test_contractions_close_together_far_from_zero_stay_finite():
    near = 0.5 + CONTRACTION / 50
    force = MUSCLE.force(PRESSURE, 0.2357 * (1 - near))
    found = fit_sarosi(PRESSURE, near, force)
    assert np.isfinite([found.a, found.b, found.c, found.d, found.e, found.f]).all()
    assert rms(found.force(PRESSURE, near) - force) < 0.01 * np.abs(force).max()


def test_a_parabola_is_told_as_a_limit():
    force = PRESSURE / 1e3 * (1 - 3 * CONTRACTION + 5 * CONTRACTION**2)
    found = fit_sarosi(PRESSURE, CONTRACTION, force)
    assert found.at_limit
    assert str(found).endswith("(c at a limit)")
    assert rms(found.force(PRESSURE, CONTRACTION) - force) < 0.1


@pytest.mark.parametrize("threshold", [-20e3, 0.0, 45e3])
def test_planted_cylinder_comes_back(threshold):
    law = Gaylord(MUSCLE.thread_length, MUSCLE.turns, threshold)
    force = law.force(PRESSURE, LENGTH)
    found = fit_gaylord(PRESSURE, LENGTH, force, threshold=True)
    assert found.thread_length == pytest.approx(law.thread_length, rel=1e-6)
    assert found.turns == pytest.approx(law.turns, rel=1e-5)
    assert found.threshold == pytest.approx(threshold, abs=1.0)
    bare = fit_gaylord(PRESSURE, LENGTH, force)
    assert bare.threshold == 0.0
    assert rms(bare.force(PRESSURE, LENGTH) - force) >= rms(found.force(PRESSURE, LENGTH) - force) - 1e-9


def test_the_thread_is_never_shorter_than_the_muscle():
    found = fit_gaylord(PRESSURE, LENGTH, PRESSURE * (LENGTH**2 + 0.01))
    assert found.thread_length == pytest.approx(LENGTH.max())


def test_blanks_are_left_out():
    force = MUSCLE.force(PRESSURE, LENGTH)
    force[::5] = np.nan
    assert fit_gaylord(PRESSURE, LENGTH, force).turns == pytest.approx(MUSCLE.turns)


def test_a_real_force_map_ranks_the_rivals():
    table = convert_to_si(read_shipped("martens_boblan_2017/dmsp-20-300")).query("force > 0")
    pressure, length, force = (table[name].to_numpy() for name in ("pressure", "length", "force"))
    bare = fit_gaylord(pressure, length, force)
    spent = fit_gaylord(pressure, length, force, threshold=True)
    formula = fit_sarosi(pressure, 1 - length / 0.296, force)
    left = [rms(law.force(pressure, length) - force) for law in (bare, spent)]
    left.append(rms(formula.force(pressure, 1 - length / 0.296) - force))
    assert left == sorted(left, reverse=True)
    assert left[-1] < 10
    assert formula.c < 0


def test_too_little_is_refused():
    one = np.full(12, 2e5)
    length, force = np.linspace(0.2, 0.25, 12), np.linspace(10, 100, 12)
    with pytest.raises(BadInput, match="at least 2 different values of `pressure`; got 1, near 2e\\+05 Pa"):
        fit_sarosi(one, 1 - length / 0.25, force)
    with pytest.raises(BadInput, match="at least 2 different values of `pressure`"):
        fit_gaylord(one, length, force, threshold=True)
    with pytest.raises(BadInput, match="at least 3 different values of `contraction`"):
        fit_sarosi(force * 1e3, np.repeat([0.0, 0.1], 6), force)
    with pytest.raises(BadInput, match="at least 2 different values of `length`; got 1"):
        fit_gaylord(force * 1e3, np.full(12, 0.2), force)
    with pytest.raises(BadInput, match="six coefficients need six rows or more; got 5"):
        fit_sarosi(force[:5] * 1e3, np.arange(5) / 20, force[:5])
    with pytest.raises(BadInput, match="as many rows as each other; got 3 of `pressure`, 12 of `length`"):
        fit_gaylord(one[:3], length, force)
    with pytest.raises(BadInput, match="nothing is blank"):
        fit_gaylord(one, length, force * np.nan)
    with pytest.raises(BadInput, match="must pull harder under pressure"):
        fit_gaylord(one, length, np.full(12, -100.0))
    with pytest.raises(BadInput, match="some `pressure` must differ from zero"):
        fit_gaylord(one * 0, length, force)
