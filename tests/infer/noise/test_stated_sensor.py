"""Noise of a sensor whose stated noise may be inexact."""

import numpy as np
import pytest

from pamjax.infer.noise.unknown_sensor import (
    DifferenceStatistics,
    compute_second_differences,
    estimate_stated_noise,
)

ROWS = 4000


def simulate_noise(rho, seed):
    """Return noise of unit variance with a correlation of neighbours."""
    rng = np.random.default_rng(seed)
    noise = np.empty(ROWS)
    noise[0] = rng.standard_normal()
    for k in range(1, ROWS):
        noise[k] = rho * noise[k - 1] + np.sqrt(1 - rho**2) * rng.standard_normal()
    return noise


def estimate(noise, stated_sd, propagated_sd=0.0):
    differences = compute_second_differences(noise, np.zeros(noise.size, int))
    statistics = DifferenceStatistics(
        np.array([np.mean(d**2) for d in differences]),
        np.array([d.size for d in differences]),
        np.full(len(differences), 6 * propagated_sd**2),
        0.1,
    )
    return estimate_stated_noise(statistics, stated_sd**2)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("seed", [0, 1])
def test_an_exact_statement_is_kept(rho, seed):
    noise = estimate(simulate_noise(rho, seed), 1.0)
    assert noise.variance == pytest.approx(1.0, rel=0.1)
    assert noise.correlation == pytest.approx(rho, abs=0.06)


@pytest.mark.parametrize("factor", [0.75, 1.2, 1.5])
def test_the_scale_of_an_inexact_statement_is_found(factor):
    # White noise, `factor` times as large as stated.
    noise = estimate(simulate_noise(0.0, 2) * factor, 1.0)
    assert np.sqrt(noise.variance) == pytest.approx(factor, rel=0.04)
    assert noise.correlation == 0.0


def test_propagated_noise_scales_with_the_sensor():
    rng = np.random.default_rng(3)
    # Sensor and propagated noise, both white and both 1.4 times as large as stated.
    noise = estimate(1.4 * (rng.standard_normal(ROWS) + 2.0 * rng.standard_normal(ROWS)), 1.0, 2.0)
    assert noise.variance + 4.0 * noise.input_factor == pytest.approx(1.4**2 * 5.0, rel=0.06)


def test_a_smooth_misfit_is_not_noise():
    time = np.linspace(0, 1, ROWS)
    noise = estimate(simulate_noise(0.0, 4) + 30 * np.sin(12 * time), 1.0)
    assert noise.variance == pytest.approx(1.0, rel=0.05)
