"""A fit takes its noise from neighbouring samples, and its sds from the whitened residuals."""

import dataclasses

import numpy as np
import pytest

from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.least_squares import linearise_problem
from pamjax.infer.fitting.prior_bounds import find_limits, solve_within_limits
from pamjax.infer.fitting.reweight import has_enough_neighbours
from tests.agreement import agree
from tests.infer.made import SENSORS, made, sds_off

QUICK = {"starts": 1, "fold_count": 2}
CORRELATION = 0.8
RECORDINGS = 40
#: Sensor noise only, so that all noise is correlated.
BENCH = dataclasses.replace(SENSORS, pressure=None, length=None)


def with_force(case, force):
    """Return the case with another force, N."""
    return dataclasses.replace(case, recording=dataclasses.replace(case.recording, force=force))


def with_misfit(case, size=30.0):
    """Return the case with a force error that alternates from isobar to isobar, N."""
    isobar = np.unique(np.round(case.recording.pressure, -4), return_inverse=True)[1]
    return with_force(case, case.recording.force + size * (-1.0) ** isobar)


def with_gain(case, gain=1.3):
    """Return the case with a wrong gain of the load cell, which the diameter contradicts."""
    return with_force(case, gain * case.recording.force)


def compute_coverage(**settings):
    """Return the share of 1-sd intervals that hold the true value."""
    errors = [
        error
        for seed in range(RECORDINGS)
        for error in sds_off(
            fit(made(seed=seed, bench=BENCH, sensors=BENCH, lag_one=CORRELATION, **settings), **QUICK)
        ).values()
    ]
    return np.mean(np.abs(errors) < 1)


@pytest.mark.slow
def test_intervals_hold_with_correlated_noise(monkeypatch):
    # The standard error of the share is 4 %.
    assert compute_coverage() == pytest.approx(0.683, abs=0.1)
    # Negative control: without the correlation of the noise, the intervals are three times too narrow.
    monkeypatch.setattr("pamjax.infer.fitting.reweight.compute_variance_inflation", lambda *_: 1.0)
    monkeypatch.setattr("pamjax.infer.noise.estimate.compute_correlation_error", lambda *_: 1e9)
    assert compute_coverage() < 0.45


def test_noise_is_that_of_neighbours_and_not_the_misfit():
    sensors = dataclasses.replace(SENSORS, force=None)
    quiet = fit(made(sensors=sensors), **QUICK).cases[0].noise["force"]
    fitted = fit(with_misfit(made(sensors=sensors)), **QUICK)
    noise = fitted.cases[0].noise["force"]
    assert not noise.is_stated
    assert noise.sd == pytest.approx(quiet.sd, rel=0.25)
    assert noise.rms_over_noise > 3
    note = str(fitted)
    assert "the rmse of force is" in note
    rmse = fitted.cases[0].rmse["force"]
    # One estimate of the noise: the difference of neighbouring samples would be a second one.
    assert f"{rmse / noise.sd:.1f} times its noise" in note
    assert "samples differ by" not in note
    assert "the model may lack a mechanism; run `pamjax diagnose`" in note
    assert "neighbouring samples (no sensor stated)" in note


def test_a_misfit_increases_the_sd():
    sure, unsure = fit(made(), **QUICK), fit(with_misfit(made()), **QUICK)
    inflation = float(unsure.datasets[0].whitening.variance_inflation)
    assert inflation > 30
    for name, e in sure.estimates.items():
        if unsure.estimates[name].sd is not None:
            assert 3 * e.sd < unsure.estimates[name].sd < e.prior_sd


def test_a_stated_value_beyond_its_limit_stops_there_if_the_model_misses():
    fitted = fit(with_gain(made()), **QUICK)
    stopped = [e for e in fitted.estimates.values() if e.at_limit]
    assert stopped
    for e in stopped:
        if e.meaning.scale == "log" and e.value > 4 * e.prior:
            # The stiffness of the threads has a limit at a factor of five.
            assert e.value == pytest.approx(5 * e.prior, rel=1e-3)
        else:
            assert abs(e.value - e.prior) / e.prior_sd == pytest.approx(3.0, abs=1e-3)
    assert "LIMIT; prior" in str(fitted)
    # A wrong stated value that explains the recording is corrected.
    wrong = fit(made(off=(0, 5.0, 0)), **QUICK).estimates["muscle.turns"]
    assert not wrong.at_limit
    assert abs(wrong.value - wrong.prior) > 4 * wrong.prior_sd


def test_a_value_at_its_limit_keeps_its_own_prior_in_the_covariance():
    """A narrow prior holds the value at the limit; it must not reduce the sd of the other values."""
    fitted = fit(with_gain(made()), **QUICK)
    assert fitted.limited_space is not fitted.space
    expected = linearise_problem(fitted.datasets, fitted.space, fitted.solution.u)
    for name in ("cost", "information", "prior_information"):
        value = np.asarray(getattr(expected, name))
        agree(getattr(fitted.solution, name), value, 1e-6, scale=float(np.abs(value).max()))
    held = linearise_problem(fitted.datasets, fitted.limited_space, fitted.solution.u)
    assert np.abs(held.prior_information).max() > 10 * np.abs(expected.prior_information).max()


def test_limited_solution_has_no_better_neighbour():
    fitted = fit(with_gain(made()), **QUICK)
    limits = find_limits(fitted.space, fitted.space.names)
    fixed_space, solution = solve_within_limits(fitted.datasets, fitted.space, fitted.solution, limits)
    values = np.asarray(fitted.space.to_values(solution.u))
    tolerance = 1e-4 * (limits[1] - limits[0])
    assert np.all((values >= limits[0] - tolerance) & (values <= limits[1] + tolerance))
    assert bool(np.any(np.asarray(fixed_space.sd) != np.asarray(fitted.space.sd)))
    # Limits that hold the free solution leave it unchanged.
    free = fit(made(), **QUICK)
    space, same = solve_within_limits(
        free.datasets, free.space, free.solution, find_limits(free.space, free.space.names)
    )
    assert np.array_equal(np.asarray(space.sd), np.asarray(free.space.sd))
    assert np.allclose(np.asarray(same.u), np.asarray(free.solution.u), atol=1e-4)


def test_tables_and_short_recordings_keep_the_noise_of_the_residuals():
    case = made()
    assert has_enough_neighbours(case)
    assert not has_enough_neighbours(
        dataclasses.replace(case, recording=dataclasses.replace(case.recording, time=None))
    )
    table = dataclasses.replace(case, recording=dataclasses.replace(case.recording, time=None))
    fitted = fit(table, **QUICK)
    assert fitted.datasets[0].whitening is None
    assert fitted.cases[0].noise["force"].neighbour_sd is None
