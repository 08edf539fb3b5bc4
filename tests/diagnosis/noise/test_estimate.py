"""The noise is read off neighbouring samples, and the filter makes it white."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pamjax.diagnosis.noise.estimate import NoiseModel, _build_channel_noise, _compute_roughness
from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error


def sample(shared, correlation, n=20000, seed=0):
    """Noise of unit variance, of which a share repeats itself."""
    rng = np.random.default_rng(seed)
    own = lfilter([1.0], [1.0, -correlation], rng.standard_normal(n) * np.sqrt(1 - correlation**2))
    return np.sqrt(shared) * own + np.sqrt(1 - shared) * rng.standard_normal(n)


def whitening(colour, n):
    rows = (np.arange(n), np.arange(0))
    return NoiseModel((colour, None), rows, (np.array([[0, n]]), np.zeros((0, 2), int)))


@pytest.mark.parametrize(
    ("shared", "correlation"), [(1.0, 0.0), (1.0, 0.5), (1.0, 0.9), (0.6, 0.9), (0.5, 0.7)]
)
def test_the_filter_leaves_white_noise_of_unit_variance(shared, correlation):
    noise = sample(shared, correlation)
    white = whitening(Ar1Noise(np.ones(noise.size), shared, correlation, True), noise.size)
    left = white.whiten(np.stack([noise, noise]))[100:]
    assert np.var(left) == pytest.approx(1.0, abs=0.04)
    for lag in (1, 2, 5, 20):
        assert abs(np.mean(left[lag:] * left[:-lag])) < 4 / np.sqrt(left.size)
    # A slow sum is white too: what a wrong correlation would show first.
    sums = left[: left.size // 100 * 100].reshape(-1, 100).sum(axis=1) / 10
    assert np.var(sums) == pytest.approx(1.0, abs=0.35)


def test_a_wrong_correlation_shows():
    noise = sample(1.0, 0.9)
    left = whitening(Ar1Noise(np.ones(noise.size), 1.0, 0.5, True), noise.size).whiten(
        np.stack([noise, noise])
    )
    sums = left[: left.size // 100 * 100].reshape(-1, 100).sum(axis=1) / 10
    assert np.var(sums) > 3


@pytest.mark.parametrize(("shared", "correlation"), [(1.0, 0.0), (0.7, 0.6), (0.9, 0.9)])
def test_correlation_is_read_off_neighbours_whatever_the_misfit(shared, correlation):
    n = 4000
    slow = 20 * np.sin(np.arange(n) / 300)
    residual = sample(shared, correlation, n, seed=3) + slow
    found = _build_channel_noise(
        residual, np.array([shared]), np.full(n, 1 - shared), np.arange(n), np.zeros(n), True
    )
    assert found.ar1_fraction == pytest.approx(shared)
    assert found.correlation == pytest.approx(correlation, abs=0.06)


def test_no_product_reaches_across_a_gap():
    colour = Ar1Noise(np.ones(8), 1.0, 0.9, True)
    white = NoiseModel(
        (colour, None), (np.arange(8), np.arange(0)), (np.array([[0, 4], [4, 8]]), np.zeros((0, 2), int))
    )
    step = np.zeros((2, 8))
    step[:, 3] = 1.0
    assert np.all(white.whiten(step)[4:] == 0)


@pytest.mark.parametrize("shared", [1.0, 0.6])
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_a_correlation_is_as_uncertain_as_it_says(shared, correlation):
    n, found = 700, []
    for seed in range(300):
        noise = sample(shared, correlation, n + 300, seed)[300:]
        rough = _compute_roughness(noise, np.ones(n), np.arange(n), np.ones(n))
        found.append(1 - (rough - (1 - shared)) / shared)
    # 300 draws know a standard deviation to 4 %.
    assert np.std(found) == pytest.approx(compute_correlation_error(shared, correlation, n), rel=0.15)
