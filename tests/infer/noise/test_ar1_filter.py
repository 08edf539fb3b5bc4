"""The AR(1) filter of a channel agrees with its covariance matrix."""

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular, toeplitz

from pamjax.infer.noise.ar1_filter import Ar1Noise, SampleNoise
from pamjax.infer.noise.noise_model import NoiseModel


def _root(shared, correlation, n):
    """Return the lower Cholesky factor of the covariance of n samples of unit variance."""
    covariance = shared * correlation ** np.arange(n)
    covariance[0] = 1.0
    return cholesky(toeplitz(covariance), lower=True)


def _whiten(noise, run):
    return noise.build_filter(np.array([[0, run.shape[-1]]])).whiten(run)


@pytest.mark.parametrize("n", [1, 2, 7, 60, 800])
@pytest.mark.parametrize(
    ("shared", "correlation"), [(1.0, 0.9), (0.6, 0.5), (0.5, 0.95), (0.1, 0.98), (0.02, 0.9)]
)
def test_filter_agrees_with_the_covariance(shared, correlation, n):
    colour, root = Ar1Noise(np.ones(n), shared, correlation, True), _root(shared, correlation, n)
    run = np.random.default_rng(n).standard_normal((3, n))
    expected = solve_triangular(root, run.T, lower=True).T
    np.testing.assert_allclose(_whiten(colour, run), expected, atol=2e-3)
    assert np.log(colour.build_filter(np.array([[0, n]])).sd).sum() == pytest.approx(
        np.log(np.diag(root)).sum(), abs=2e-3 * (1 + n / 800)
    )


def test_slow_shift_of_a_short_run_has_its_correct_weight():
    n, shared, correlation = 40, 0.3, 0.97
    shift = _whiten(Ar1Noise(np.ones(n), shared, correlation, True), np.ones(n))
    by_covariance = solve_triangular(_root(shared, correlation, n), np.ones(n), lower=True)
    assert np.sum(shift**2) == pytest.approx(np.sum(by_covariance**2), rel=1e-3)
    # Negative control: the stationary filter from the second sample gives a much larger weight.
    theta, left = Ar1Noise(np.ones(n), shared, correlation, True).filter
    steady, last = [1.0], 1.0
    for _ in range(n - 1):
        last = 1 - correlation + theta * last
        steady.append(last / left)
    assert np.sum(np.square(steady)) > 1.1 * np.sum(by_covariance**2)


def test_uncorrelated_noise_is_unchanged():
    for colour in (Ar1Noise(np.ones(5), 1.0, 0.0, True), Ar1Noise(np.ones(5), 0.0, 0.9, True)):
        assert colour.build_filter(np.array([[0, 5]])) is None


def test_noise_that_differs_between_samples_agrees_with_its_covariance():
    rng = np.random.default_rng(5)
    fraction, rho = rng.uniform(0.2, 1.0, 60), rng.uniform(0.1, 0.9, 60)
    # The product of the correlations between two samples.
    between = np.concatenate([[0.0], np.cumsum(np.log(rho[1:]))])
    covariance = np.exp(-np.abs(between[:, None] - between)) * np.sqrt(np.outer(fraction, fraction))
    np.fill_diagonal(covariance, 1.0)
    noise = Ar1Noise(np.ones(60), 0.6, 0.5, True, by_sample=SampleNoise(fraction, rho))
    samples = rng.standard_normal((3, 60))
    run_filter = noise.build_filter(np.array([[0, 60]]), np.arange(60))
    root = cholesky(covariance, lower=True)
    np.testing.assert_allclose(
        run_filter.whiten(samples), solve_triangular(root, samples.T, lower=True).T, atol=1e-9
    )
    assert np.log(run_filter.sd).sum() == pytest.approx(np.log(np.diag(root)).sum(), abs=1e-9)
    # A run of some of the samples has the same noise.
    part = noise.build_filter(np.array([[0, 20]]), np.arange(30, 50)).whiten(samples[:, 30:50])
    root = cholesky(covariance[30:50, 30:50], lower=True)
    np.testing.assert_allclose(part, solve_triangular(root, samples[:, 30:50].T, lower=True).T, atol=1e-9)


def test_filter_restarts_at_each_run():
    noise = Ar1Noise(np.ones(90), 0.7, 0.8, True)
    samples = np.random.default_rng(3).standard_normal((2, 90))
    parts = [_whiten(noise, samples[:, :50]), _whiten(noise, samples[:, 50:])]
    runs = noise.build_filter(np.array([[0, 50], [50, 90]]))
    np.testing.assert_allclose(runs.whiten(samples), np.concatenate(parts, axis=1), atol=1e-12)
    # Negative control: one run of all samples has another value after the border.
    assert np.abs(_whiten(noise, samples)[:, 50] - parts[1][:, 0]).max() > 0.1


def test_missing_sample_is_missing_to_the_end_of_its_run():
    noise = Ar1Noise(np.ones(90), 0.7, 0.8, True)
    runs, samples = noise.build_filter(np.array([[0, 50], [50, 90]])), np.ones((2, 90))
    complete = runs.whiten(samples)
    samples[0, 20] = np.nan
    white = runs.whiten(samples)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(white[0])), np.arange(20, 50))
    np.testing.assert_allclose(np.where(np.isnan(white), complete, white), complete, atol=1e-12)


def test_channel_without_rows_is_left_out():
    channel = Ar1Noise(np.ones(9), 0.7, 0.8, True)
    rows, runs = np.arange(9), np.array([[0, 9]])
    force_alone = NoiseModel((channel, channel), (rows, rows[:0]), (runs, runs[:0]))
    values = np.random.default_rng(3).standard_normal((2, 9))
    np.testing.assert_allclose(force_alone.whiten(values), _whiten(channel, values[0]), atol=1e-12)
    # No derivatives, as for a model without free parameters.
    assert force_alone.whiten(np.empty((0, 2, 9))).shape == (0, 9)


def test_a_sample_with_a_further_variance_is_independent_of_its_neighbours():
    n, changed = 40, 17
    rows, runs = np.arange(n), np.array([[0, n]])
    channel = Ar1Noise(np.full(n, 2.0), 1.0, 0.8, True)
    noise = NoiseModel((channel, None), (rows, rows[:0]), (runs, np.zeros((0, 2), int)))
    variance = np.zeros((2, n))
    variance[0, changed] = 96.0
    wider = noise.add_row_variance(variance)
    residual = np.zeros((2, n))
    residual[0, changed] = 10.0
    expected = np.zeros(n)
    expected[changed] = 1.0
    np.testing.assert_allclose(wider.whiten(residual), expected, atol=1e-12)
    # With one run, the next sample is not white: a negative control.
    assert abs(noise.whiten(residual)[changed + 1]) > 1.0
    # Each part is that of the samples alone.
    parts = [noise.restrict_to_rows(mask) for mask in (rows < changed, rows > changed)]
    alone = 2 * np.log(10.0)
    assert wider.log_determinant == pytest.approx(alone + sum(part.log_determinant for part in parts))
    assert wider.compute_rms_sd(0) == pytest.approx(2.0)
    assert noise.add_row_variance(np.zeros((2, n))).runs[0].tolist() == runs.tolist()
