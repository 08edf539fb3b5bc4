"""Estimates of noise and autocorrelation from neighbouring samples, and whitening."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error
from pamjax.infer.noise.estimate import _build_channel_noise, _ChannelSamples, _compute_half_mean_square
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.noise_settings import NOISE_SETTINGS


def sample(shared, correlation, n=20000, seed=0):
    """Return AR(1) noise of unit variance."""
    rng = np.random.default_rng(seed)
    own = lfilter([1.0], [1.0, -correlation], rng.standard_normal(n) * np.sqrt(1 - correlation**2))
    return np.sqrt(shared) * own + np.sqrt(1 - shared) * rng.standard_normal(n)


def whitening(colour, n):
    rows = (np.arange(n), np.arange(0))
    return NoiseModel((colour, None), rows, (np.array([[0, n]]), np.zeros((0, 2), int)))


@pytest.mark.parametrize(
    ("shared", "correlation"), [(1.0, 0.0), (1.0, 0.5), (1.0, 0.9), (0.6, 0.9), (0.5, 0.7)]
)
def test_filter_gives_white_noise_of_unit_variance(shared, correlation):
    noise = sample(shared, correlation)
    white = whitening(Ar1Noise(np.ones(noise.size), shared, correlation, True), noise.size)
    left = white.whiten(np.stack([noise, noise]))[100:]
    assert np.var(left) == pytest.approx(1.0, abs=0.04)
    for lag in (1, 2, 5, 20):
        assert abs(np.mean(left[lag:] * left[:-lag])) < 4 / np.sqrt(left.size)
    # A slow sum is also white; it is most sensitive to a wrong correlation.
    sums = left[: left.size // 100 * 100].reshape(-1, 100).sum(axis=1) / 10
    assert np.var(sums) == pytest.approx(1.0, abs=0.35)


def test_wrong_correlation_is_detected():
    noise = sample(1.0, 0.9)
    left = whitening(Ar1Noise(np.ones(noise.size), 1.0, 0.5, True), noise.size).whiten(
        np.stack([noise, noise])
    )
    sums = left[: left.size // 100 * 100].reshape(-1, 100).sum(axis=1) / 10
    assert np.var(sums) > 3


@pytest.mark.parametrize(("shared", "correlation"), [(1.0, 0.0), (0.7, 0.6), (0.9, 0.9)])
def test_correlation_estimate_is_independent_of_misfit(shared, correlation):
    n = 4000
    slow = 20 * np.sin(np.arange(n) / 300)
    residual = sample(shared, correlation, n, seed=3) + slow
    channel_noise = _build_channel_noise(
        _ChannelSamples(residual, np.arange(n), np.zeros(n), np.full(n, 1 - shared)),
        np.array([shared]),
        settings=NOISE_SETTINGS,
    )
    assert channel_noise.ar1_fraction == pytest.approx(shared)
    assert channel_noise.correlation == pytest.approx(correlation, abs=0.06)


def test_correlation_ignores_gaps():
    colour = Ar1Noise(np.ones(8), 1.0, 0.9, True)
    white = NoiseModel(
        (colour, None), (np.arange(8), np.arange(0)), (np.array([[0, 4], [4, 8]]), np.zeros((0, 2), int))
    )
    step = np.zeros((2, 8))
    step[:, 3] = 1.0
    assert np.all(white.whiten(step)[4:] == 0)


@pytest.mark.parametrize("shared", [1.0, 0.6])
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_correlation_has_its_stated_uncertainty(shared, correlation):
    n, correlations = 700, []
    for seed in range(300):
        noise = sample(shared, correlation, n + 300, seed)[300:]
        rough = _compute_half_mean_square(noise, np.ones(n), np.arange(n), np.ones(n), NOISE_SETTINGS)
        correlations.append(1 - (rough - (1 - shared)) / shared)
    # An sd from 300 draws has a standard error of 4 %.
    assert np.std(correlations) == pytest.approx(compute_correlation_error(shared, correlation, n), rel=0.15)


@pytest.mark.parametrize(("factor", "expected"), [(1.5, 1.5), (2.6, 1.0)])
def test_only_a_plausible_ratio_replaces_the_stated_noise(factor, expected):
    """Noise of more than 2.1 times the stated noise is misfit that changes from sample to sample."""
    n = 4000
    channel_noise = _build_channel_noise(
        _ChannelSamples(factor * sample(1.0, 0.0, n, seed=4), np.arange(n), np.zeros(n), np.zeros(n)),
        np.array([1.0]),
        settings=NOISE_SETTINGS,
        max_noise_ratio=2.1,
    )
    assert channel_noise.sd.mean() == pytest.approx(expected, rel=0.05)
