"""Noise of means, from the noise of the samples."""

import math

import numpy as np
import pytest

from pamjax.diagnosis.noise.average_noise import (
    average_noise,
    compute_mean_correlation,
    compute_mean_variance,
)
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.estimate import find_runs
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.sensor_posterior import SensorPosterior
from pamjax.records.recording import Recording
from pamjax.records.row_averages import RowAverages
from pamjax.records.simulate import draw_ar1_noise

ROWS = 60000


def build_averages(size, interval=1, n=ROWS, stroke=None):
    """Return groups of a rising pressure, or of strokes, with a force in each row that `interval` divides."""
    row = np.arange(float(n))
    rise = row if stroke is None else np.abs((row + stroke) % (2 * stroke) - stroke)
    recording = Recording.from_arrays(
        pressure=1e5 + 1e3 * rise,
        length=np.full(n, 0.2),
        force=np.where(row % interval == 0, 10.0, np.nan),
        time=row,
    )
    return RowAverages.from_recording(recording, np.zeros(n, dtype=int), size)


def average(channel, averages):
    """Return the noise of the means of a force with this noise."""
    rows = np.flatnonzero(np.isfinite(averages.recording.force))
    runs = np.array([[0, rows.size]])
    noise = NoiseModel((channel, None), (rows, rows[:0]), (runs, runs[:0]))
    is_measured = averages.count("force") > 0
    in_use = np.stack([is_measured, np.zeros(is_measured.size, dtype=bool)])
    return average_noise(
        noise, averages, ("force", "diameter"), in_use, np.zeros(is_measured.size, dtype=int)
    )


@pytest.mark.parametrize("count", [1, 2, 3, 7])
@pytest.mark.parametrize("next_count", [1, 4])
@pytest.mark.parametrize("rho", [-0.3, 0.0, 0.5, 0.95])
def test_a_mean_has_the_variance_and_the_correlation_of_its_samples(count, next_count, rho):
    k = np.arange(count + next_count)
    covariance = rho ** np.abs(k[:, None] - k)
    weights = np.stack([(k < count) / count, (k >= count) / next_count])
    (variance, shared), (_, other) = weights @ covariance @ weights.T
    assert compute_mean_variance(count, rho) == pytest.approx(variance, rel=1e-12)
    expected = shared / np.sqrt(variance * other)
    assert compute_mean_correlation(count, next_count, rho) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("size", "interval"), [(3, 1), (11, 1), (7, 2), (7, 5)])
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_means_of_noise_are_white_with_the_noise_of_means(size, interval, rho):
    averages, rng = build_averages(size, interval), np.random.default_rng(11)
    is_read = np.isfinite(averages.recording.force)
    samples = np.full(ROWS, np.nan)
    # A fraction of 0.7 of the variance is correlated.
    parts = draw_ar1_noise(rng, is_read.sum(), rho), rng.standard_normal(is_read.sum())
    samples[is_read] = 2.0 * (math.sqrt(0.7) * parts[0] + math.sqrt(0.3) * parts[1])
    noise = average(Ar1Noise(np.full(ROWS, 2.0), 0.7, rho, True), averages)
    means = np.stack([averages.average(samples), np.zeros(averages.centres.size)])
    white = noise.whiten(means)[30:]
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.1)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.1
    # The sum over many means shows slow noise, which is overestimated slightly.
    slow = white[: white.size // 50 * 50].reshape(-1, 50).sum(axis=1) / math.sqrt(50)
    assert 0.65 < np.mean(slow**2) < 1.2


@pytest.mark.parametrize(("size", "stroke"), [(3, 40), (5, 200), (7, 400)])
@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_short_strokes_have_white_noise_too(size, stroke, rho):
    """Many groups have one sample: the turns and the first rows of each stroke."""
    averages = build_averages(size, n=8000, stroke=stroke)
    assert np.mean(averages.count("force") == 1) > 0.15
    noise = average(Ar1Noise(np.full(8000, 2.0), 1.0, rho, True), averages)
    rng, zeros = np.random.default_rng(3), np.zeros(averages.centres.size)
    draws = [2.0 * draw_ar1_noise(rng, 8000, rho) for _ in range(100)]
    white = noise.whiten(np.stack([np.stack([averages.average(draw), zeros]) for draw in draws]))
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.07)
    # An effect that decreases after each turn is not more significant than noise.
    start = np.exp(-(averages.centres % stroke) / 10)
    direction = noise.whiten(np.stack([start, zeros]))
    projection = white @ direction / np.linalg.norm(direction)
    assert 0.6 < np.mean(projection**2) < 1.35


def test_input_noise_that_changes_along_a_stroke_is_added_for_each_mean():
    averages = build_averages(5)
    variance = 1.0 + np.linspace(0.0, 9.0, ROWS)
    fraction = np.mean(1 / variance)
    channel = average(Ar1Noise(np.sqrt(variance), fraction, 0.8, True), averages).by_channel[0]
    expected = compute_mean_variance(5, 0.8) + (variance[averages.centres] - 1) / 5
    is_typical = averages.count("force") == 5
    np.testing.assert_allclose(channel.sd[is_typical], np.sqrt(expected[is_typical]), rtol=1e-3)


def test_a_mean_of_one_sample_has_its_noise():
    averages = build_averages(5)
    noise = average(Ar1Noise(np.full(ROWS, 2.0), 0.7, 0.5, True), averages)
    channel = noise.by_channel[0]
    np.testing.assert_allclose(channel.sd[averages.count("force") == 1], 2.0)
    assert noise.sample_count == pytest.approx(ROWS)


def test_uncertain_noise_keeps_its_probabilities():
    averages, support = build_averages(3), np.array([[0.0, 1.0], [0.6, 2.0]])
    posterior = SensorPosterior(0.6, 2.0, support, np.array([0.3, 0.7]))
    sensor = Ar1Noise(np.full(ROWS, 1.5), 1.0, 0.6, True, sensor_posterior=posterior)
    averaged = average(sensor, averages).by_channel[0].sensor_posterior
    np.testing.assert_allclose(averaged.support[0], [0.0, 1 / 3], rtol=2e-3)
    np.testing.assert_allclose(averaged.support[1], [averaged.correlation, averaged.variance])
    np.testing.assert_array_equal(averaged.probability, posterior.probability)


def test_an_estimate_by_chance_has_a_correlation():
    averages = build_averages(3)
    for rho in (-1.5, 1.4):
        sensor = Ar1Noise(np.full(ROWS, 1.5), 1.0, 0.0, True, rho_from_differences=rho)
        assert -1 < average(sensor, averages).by_channel[0].rho_from_differences < 1


def test_a_change_of_the_run_number_ends_a_run():
    np.testing.assert_array_equal(
        find_runs(np.array([0, 0, 0, 1, 1]), np.array([0, 2, 3, 4])), [[0, 2], [2, 4]]
    )
