"""Fits of the empirical formulas: they recover the coefficients of simulated data for any exponent."""

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
def test_exponent_of_either_sign_is_recovered(rate):
    law = planted(rate)
    fitted = fit_sarosi(PRESSURE, CONTRACTION, law.force(PRESSURE, CONTRACTION))
    assert fitted.c == pytest.approx(rate, rel=1e-5)
    assert fitted.b == pytest.approx(law.b, rel=1e-4)
    assert not fitted.at_limit


def test_fit_is_better_than_a_local_search_from_the_wrong_sign():
    force = planted(-33.0).force(PRESSURE, CONTRACTION)
    bar = PRESSURE / 1e5

    def residual(x):
        curve = np.exp(np.clip(x[2] * CONTRACTION, -100, 100))
        return (x[0] * bar + x[1]) * curve + x[3] * CONTRACTION * bar + x[4] * bar + x[5] - force

    local = least_squares(residual, [1, 1, 30, 1, 1, 1], x_scale="jac", max_nfev=500)
    assert local.x[2] > 0
    assert rms(local.fun) > 30
    fitted = fit_sarosi(PRESSURE, CONTRACTION, force)
    assert rms(fitted.force(PRESSURE, CONTRACTION) - force) < 1e-6


def test_fit_is_as_good_as_a_grid_of_exponents():
    rng = np.random.default_rng(7)
    force = MUSCLE.force(PRESSURE, LENGTH) + rng.normal(0, 20, PRESSURE.size)
    fitted = fit_sarosi(PRESSURE, CONTRACTION, force)
    best = rms(fitted.force(PRESSURE, CONTRACTION) - force)
    for rate in np.concatenate([-np.geomspace(0.1, 190, 200), np.geomspace(0.1, 190, 200)]):
        curve = np.exp(rate * CONTRACTION) / np.exp(max(rate, 0) * 0.25)
        p = PRESSURE / 6e5
        design = np.column_stack([p * curve, curve, CONTRACTION * p, p, np.ones_like(p)])
        assert best <= rms(design @ np.linalg.lstsq(design, force, rcond=None)[0] - force) + 1e-9


def test_fit_is_finite_for_close_contractions_far_from_zero():
    near = 0.5 + CONTRACTION / 50
    force = MUSCLE.force(PRESSURE, 0.2357 * (1 - near))
    fitted = fit_sarosi(PRESSURE, near, force)
    assert np.isfinite([fitted.a, fitted.b, fitted.c, fitted.d, fitted.e, fitted.f]).all()
    assert rms(fitted.force(PRESSURE, near) - force) < 0.01 * np.abs(force).max()


def test_parabola_is_reported_as_a_limiting_case():
    force = PRESSURE / 1e3 * (1 - 3 * CONTRACTION + 5 * CONTRACTION**2)
    fitted = fit_sarosi(PRESSURE, CONTRACTION, force)
    assert fitted.at_limit
    assert str(fitted).endswith("(c at a limit)")
    assert rms(fitted.force(PRESSURE, CONTRACTION) - force) < 0.1


@pytest.mark.parametrize("threshold", [-20e3, 0.0, 45e3])
def test_parameters_of_the_cylinder_are_recovered(threshold):
    law = Gaylord(MUSCLE.thread_length, MUSCLE.turns, threshold)
    force = law.force(PRESSURE, LENGTH)
    fitted = fit_gaylord(PRESSURE, LENGTH, force, threshold=True)
    assert fitted.thread_length == pytest.approx(law.thread_length, rel=1e-6)
    assert fitted.turns == pytest.approx(law.turns, rel=1e-5)
    assert fitted.threshold == pytest.approx(threshold, abs=1.0)
    without_threshold = fit_gaylord(PRESSURE, LENGTH, force)
    assert without_threshold.threshold == 0.0
    assert (
        rms(without_threshold.force(PRESSURE, LENGTH) - force)
        >= rms(fitted.force(PRESSURE, LENGTH) - force) - 1e-9
    )


def test_thread_is_at_least_as_long_as_the_muscle():
    fitted = fit_gaylord(PRESSURE, LENGTH, PRESSURE * (LENGTH**2 + 0.01))
    assert fitted.thread_length == pytest.approx(LENGTH.max())


def test_blank_cells_are_ignored():
    force = MUSCLE.force(PRESSURE, LENGTH)
    force[::5] = np.nan
    assert fit_gaylord(PRESSURE, LENGTH, force).turns == pytest.approx(MUSCLE.turns)


def test_formulas_are_ranked_on_a_real_force_map():
    table = convert_to_si(read_shipped("martens_boblan_2017/dmsp-20-300")).query("force > 0")
    pressure, length, force = (table[name].to_numpy() for name in ("pressure", "length", "force"))
    without_threshold = fit_gaylord(pressure, length, force)
    with_threshold = fit_gaylord(pressure, length, force, threshold=True)
    formula = fit_sarosi(pressure, 1 - length / 0.296, force)
    errors = [rms(law.force(pressure, length) - force) for law in (without_threshold, with_threshold)]
    errors.append(rms(formula.force(pressure, 1 - length / 0.296) - force))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 10
    assert formula.c < 0


def test_too_few_rows_are_refused():
    constant_pressure = np.full(12, 2e5)
    length, force = np.linspace(0.2, 0.25, 12), np.linspace(10, 100, 12)
    with pytest.raises(BadInput, match="at least 2 different values of `pressure`; got 1, near 2e\\+05 Pa"):
        fit_sarosi(constant_pressure, 1 - length / 0.25, force)
    with pytest.raises(BadInput, match="at least 2 different values of `pressure`"):
        fit_gaylord(constant_pressure, length, force, threshold=True)
    with pytest.raises(BadInput, match="at least 3 different values of `contraction`"):
        fit_sarosi(force * 1e3, np.repeat([0.0, 0.1], 6), force)
    with pytest.raises(BadInput, match="at least 2 different values of `length`; got 1"):
        fit_gaylord(force * 1e3, np.full(12, 0.2), force)
    with pytest.raises(BadInput, match="six coefficients need at least six rows; got 5"):
        fit_sarosi(force[:5] * 1e3, np.arange(5) / 20, force[:5])
    with pytest.raises(BadInput, match="the same number of rows; got 3 of `pressure`, 12 of `length`"):
        fit_gaylord(constant_pressure[:3], length, force)
    with pytest.raises(BadInput, match="rows without blank values"):
        fit_gaylord(constant_pressure, length, force * np.nan)
    with pytest.raises(BadInput, match="must increase with `pressure`"):
        fit_gaylord(constant_pressure, length, np.full(12, -100.0))
    with pytest.raises(BadInput, match="`pressure` must differ from zero in some row"):
        fit_gaylord(constant_pressure * 0, length, force)
