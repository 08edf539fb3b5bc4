"""Mean square of a residual: noise of a sensor that is noisier than stated is no misfit."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.detect.mean_square import compute_mean_square_significance
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.sensor_posterior import SensorPosterior
from tests.diagnosis.noise_draws import repeating

N = 700


def compute_p_value(residual, channel, samples_per_row=1.0):
    """Return the p-value of a force residual of N rows."""
    noise = NoiseModel(
        (channel,), (np.arange(N),), (np.array([[0, N]]),), samples_per_row=(samples_per_row, 1.0)
    )
    problem = SimpleNamespace(
        measured=residual[None], predict=lambda values: np.zeros((1, N)), settings=DEFAULT_SETTINGS
    )
    return compute_mean_square_significance(problem, noise, SimpleNamespace(values=None))[1]


def build_channel(rho, posterior=None, is_stated=True):
    return Ar1Noise(np.ones(N), 1.0, rho, is_stated, sensor_posterior=posterior)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_p_values_of_noise_are_rarely_small(rho):
    rng = np.random.default_rng(7)
    p_values = np.array([compute_p_value(repeating(rng, rho, N), build_channel(rho)) for _ in range(400)])
    # The stated variance is known to 10 %, so noise of exactly this variance has few small p-values.
    assert np.mean(p_values < 0.05) < 0.06
    # Negative control: an rms residual of 1.4 noise sd.
    assert np.mean([compute_p_value(1.4 * repeating(rng, 0.0, N), build_channel(0.0))]) < 1e-5


def test_posterior_of_the_sensor_decides_what_is_noise():
    residual = 1.4 * repeating(np.random.default_rng(8), 0.5, N)
    # The sensor has its stated noise, or a variance twice as large, with equal probabilities.
    posterior = SensorPosterior(0.5, 1.0, np.array([[0.5, 1.0], [0.5, 2.0]]), np.array([0.5, 0.5]))
    assert compute_p_value(residual, build_channel(0.5)) < 1e-3
    assert compute_p_value(residual, build_channel(0.5, posterior)) > 0.1


def test_sensor_without_stated_noise_has_no_p_value():
    residual = 3 * repeating(np.random.default_rng(9), 0.0, N)
    assert compute_p_value(residual, build_channel(0.0, is_stated=False)) == 1.0


def test_slow_noise_in_means_is_no_misfit():
    """A slow part of 4 % of the variance of a sample is 36 % of that of the mean of nine."""
    rng = np.random.default_rng(10)
    residual = repeating(rng, 0.0, N) + 0.6 * np.sin(np.arange(N) / 20) * np.sqrt(2)
    assert compute_p_value(residual, build_channel(0.0)) < 0.01
    assert compute_p_value(residual, build_channel(0.0), samples_per_row=9.0) > 0.2
