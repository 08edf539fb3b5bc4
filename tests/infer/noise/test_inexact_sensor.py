"""Noise of a sensor whose stated noise may be inexact."""

import numpy as np
import pytest

from pamjax.infer.noise.inexact_sensor import estimate_inexact_noise
from pamjax.infer.noise.second_differences import DifferenceStatistics, compute_second_differences
from tests.diagnosis.noise_draws import repeating

ROWS = 4000


def simulate_noise(rho, seed):
    """Return noise of unit variance with a correlation of neighbours."""
    return repeating(np.random.default_rng(seed), rho, ROWS)


def estimate(noise, stated_sd, propagated_sd=0.0):
    differences = compute_second_differences(noise, np.zeros(noise.size, int))
    statistics = DifferenceStatistics(
        np.array([np.mean(d**2) for d in differences]),
        np.array([d.size for d in differences]),
        np.full(len(differences), 6 * propagated_sd**2),
        0.1,
    )
    return estimate_inexact_noise(statistics, stated_sd**2)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("seed", [0, 1])
def test_an_exact_statement_is_kept(rho, seed):
    noise = estimate(simulate_noise(rho, seed), 1.0)
    assert noise.posterior.variance == pytest.approx(1.0, rel=0.1)
    assert noise.posterior.correlation == pytest.approx(rho, abs=0.06)


@pytest.mark.parametrize("factor", [0.75, 1.2, 1.5])
def test_the_scale_of_an_inexact_statement_is_found(factor):
    # White noise, `factor` times as large as stated.
    noise = estimate(simulate_noise(0.0, 2) * factor, 1.0)
    assert np.sqrt(noise.posterior.variance) == pytest.approx(factor, rel=0.04)
    assert noise.posterior.correlation == 0.0


def test_propagated_noise_scales_with_the_sensor():
    rng = np.random.default_rng(3)
    # Sensor and propagated noise, both white and both 1.4 times as large as stated.
    noise = estimate(1.4 * (rng.standard_normal(ROWS) + 2.0 * rng.standard_normal(ROWS)), 1.0, 2.0)
    assert noise.posterior.variance + 4.0 * noise.input_factor == pytest.approx(1.4**2 * 5.0, rel=0.06)


@pytest.mark.parametrize("noise_share", [0.0, 1e-3])
@pytest.mark.parametrize("propagated_sd", [0.0, 0.01, 0.1, 0.3])
@pytest.mark.parametrize("misfit", [0.0, 1.0, 100.0])
def test_a_recording_almost_free_of_noise_has_little_noise(noise_share, propagated_sd, misfit):
    smooth = misfit * np.sin(12 * np.linspace(0, 1, ROWS))
    noise = estimate(noise_share * simulate_noise(0.0, 5) + smooth, 1.0, propagated_sd)
    assert noise.posterior.variance < 0.1
    assert np.all(np.isfinite(noise.posterior.support))


def test_a_smooth_misfit_is_not_noise():
    time = np.linspace(0, 1, ROWS)
    noise = estimate(simulate_noise(0.0, 4) + 30 * np.sin(12 * time), 1.0)
    assert noise.posterior.variance == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("propagated_sd", [0.0, 1.0])
def test_posterior_contains_the_true_noise(propagated_sd):
    """Simulation: power of slow noise, with statements and correlations drawn from their priors."""
    rng, rows, ranks = np.random.default_rng(5), 850, []
    for _ in range(600):
        is_exact = rng.random() < 0.7
        sensor, propagated = (1.0, 1.0) if is_exact else np.exp(rng.uniform(np.log(0.7), np.log(1.5), 2))
        rho = 0.0 if rng.random() < 0.5 else rng.uniform(0.02, 0.95)
        white = propagated_sd * propagated * rng.standard_normal(rows)
        posterior = estimate(sensor * repeating(rng, rho, rows) + white, 1.0, propagated_sd).posterior
        slow = posterior.support[:, 1] * (1 + posterior.support[:, 0]) / (1 - posterior.support[:, 0])
        ranks.append(posterior.probability[slow < sensor**2 * (1 + rho) / (1 - rho)].sum())
    assert np.mean(np.array(ranks) > 0.99) < 0.03
    assert np.mean(np.array(ranks) < 0.01) < 0.03
    assert 0.3 < np.mean(np.array(ranks) < 0.5) < 0.7


def test_correlated_noise_above_the_statement_remains_possible():
    """With ρ = 0.9 neighbours hardly separate a larger variance from a smaller correlation."""
    rng, true_power = np.random.default_rng(6), 1.4**2 * 19.0
    ranks, point_estimates = [], []
    for _ in range(60):
        posterior = estimate(1.4 * repeating(rng, 0.9, 850), 1.0).posterior
        slow = posterior.support[:, 1] * (1 + posterior.support[:, 0]) / (1 - posterior.support[:, 0])
        ranks.append(posterior.probability[slow < true_power].sum())
        rho = posterior.correlation
        point_estimates.append(posterior.variance * (1 + rho) / (1 - rho))
    assert np.median(ranks) < 0.99
    # The point estimate alone contains too little slow noise, so its posterior must be used.
    assert np.median(point_estimates) < 0.8 * true_power
