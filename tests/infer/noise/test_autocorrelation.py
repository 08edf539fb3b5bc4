"""Variance inflation: one for white noise, and the effective sample size of a smooth misfit."""

import numpy as np
import pytest

from pamjax.infer.noise.autocorrelation import compute_variance_inflation

SAMPLES = 4000
ONE_RUN = np.arange(SAMPLES) == 0


def test_white_noise_has_no_inflation():
    residual = np.random.default_rng(0).standard_normal(SAMPLES)
    assert compute_variance_inflation(residual, ONE_RUN) == pytest.approx(1.0, abs=0.15)
    assert compute_variance_inflation(0.5 * residual, ONE_RUN) == 1.0
    assert compute_variance_inflation(np.zeros(0), np.zeros(0, bool)) == 1.0


def test_a_misfit_counts_with_its_size_and_its_autocorrelation():
    white = np.random.default_rng(1).standard_normal(SAMPLES)
    assert compute_variance_inflation(3 * white, ONE_RUN) == pytest.approx(9.0, rel=0.15)
    # A moving average of m white samples with unit variance has the integrated autocorrelation time m.
    smooth = np.convolve(white, np.ones(20) / np.sqrt(20), mode="same")
    assert compute_variance_inflation(3 * smooth, ONE_RUN) == pytest.approx(180.0, rel=0.35)
    # In runs of one sample, no neighbours show a correlation.
    assert compute_variance_inflation(3 * smooth, np.ones(SAMPLES, bool)) < 12
