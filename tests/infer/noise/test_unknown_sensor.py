"""Noise of a sensor that is not stated, estimated from the recording."""

import numpy as np
import pytest

from pamjax.infer.noise.second_differences import (
    DIFFERENCE_LAGS,
    DifferenceStatistics,
    compute_expected_squares,
    compute_second_differences,
)
from pamjax.infer.noise.sensor_posterior import CORRELATION_GRID
from pamjax.infer.noise.unknown_sensor import estimate_unknown_noise
from tests.diagnosis.noise_draws import repeating

N = 850
ONE_RUN = np.zeros(N)
NO_OTHER, MANY = np.zeros(DIFFERENCE_LAGS.size), np.full(DIFFERENCE_LAGS.size, N)


def squares(values):
    return np.array([np.mean(d**2) for d in compute_second_differences(values, ONE_RUN)])


@pytest.mark.parametrize("k", [0, 25, 46])
def test_mean_squares_and_their_sd_agree_with_simulations(k):
    rng = np.random.default_rng(k)
    drawn = np.array([squares(repeating(rng, CORRELATION_GRID[k], N)) for _ in range(3000)])
    mean, covariance = compute_expected_squares(k)
    assert drawn.mean(axis=0) == pytest.approx(mean, rel=0.03)
    simulated = np.cov((drawn / mean).T) * N
    assert simulated == pytest.approx(covariance, rel=0.15, abs=0.15 * np.max(covariance))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("misfit", [0.0, 5.0])
def test_size_and_correlation_are_estimated_with_a_curved_misfit(rho, misfit):
    rng, slow = np.random.default_rng(1), misfit * np.sin(2 * np.pi * np.arange(N) / 85)
    taken = [
        estimate_unknown_noise(
            DifferenceStatistics(squares(repeating(rng, rho, N) + slow), MANY, NO_OTHER, 0.1)
        ).posterior
        for _ in range(60)
    ]
    assert np.median([t.correlation for t in taken]) == pytest.approx(rho, abs=0.06)
    assert np.median([t.variance for t in taken]) == pytest.approx(1.0, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_possible_noise_includes_the_true_noise(rho):
    """Power of slow noise, with other noise that is known to 10 %."""
    rng, below, far_below = np.random.default_rng(2), [], []
    for _ in range(100):
        values = repeating(rng, rho, N) + rng.standard_normal(N)
        noise = estimate_unknown_noise(
            DifferenceStatistics(squares(values), MANY, np.full(DIFFERENCE_LAGS.size, 6.0), 0.1)
        )
        slow = (
            noise.posterior.support[:, 1]
            * (1 + noise.posterior.support[:, 0])
            / (1 - noise.posterior.support[:, 0])
        )
        assert np.all(np.diff(slow) >= -1e-9 * slow[-1])
        assert noise.posterior.probability.sum() == pytest.approx(1.0)
        below.append(noise.posterior.probability[slow < (1 + rho) / (1 - rho)].sum())
        far_below.append(noise.posterior.probability[slow < 4 * (1 + rho) / (1 - rho)].sum())
    # It is hardly ever outside its possible range: this separates noise from misfit.
    assert np.mean(np.array(below) > 0.99) < 0.06
    assert np.mean(np.array(below) < 0.01) < 0.06
    # A correlation of 0.9 is underestimated: above the 90 % limit in 31 of 100 cases instead of 10.
    # Negative control: noise of twice the rms is outside far more often.
    assert np.mean(np.array(below) > 0.9) < 0.4
    assert np.mean(np.array(far_below) > 0.9) > 0.6


def test_differences_do_not_cross_gaps():
    runs, values = np.repeat([0, 1], 50), np.r_[np.zeros(50), np.full(50, 1e3)]
    assert all(not d.any() for d in compute_second_differences(values, runs))
    assert compute_second_differences(values, np.zeros(100))[0].any()


def test_slow_noise_is_possible_with_unstated_white_noise():
    rng, beyond = np.random.default_rng(3), {True: [], False: []}
    for _ in range(40):
        values = squares(repeating(rng, 0.9, N) + rng.standard_normal(N))
        for room, outcomes in beyond.items():
            noise = estimate_unknown_noise(
                DifferenceStatistics(values, MANY, NO_OTHER, 0.1, allows_white_noise=room)
            )
            slow = (
                noise.posterior.support[:, 1]
                * (1 + noise.posterior.support[:, 0])
                / (1 - noise.posterior.support[:, 0])
            )
            outcomes.append(noise.posterior.probability[slow < 19].sum() > 0.99)
    assert np.mean(beyond[True]) < 0.15
    # Negative control: without white noise in the model, almost no correlation is estimated.
    assert np.mean(beyond[False]) > 0.8


def test_recording_without_noise_is_accepted():
    noise = estimate_unknown_noise(
        DifferenceStatistics(
            np.zeros(DIFFERENCE_LAGS.size),
            MANY,
            np.full(DIFFERENCE_LAGS.size, 6.0),
            0.1,
            allows_white_noise=True,
        )
    )
    assert np.all(np.isfinite(noise.posterior.support))
    assert noise.posterior.probability.sum() == pytest.approx(1.0)
