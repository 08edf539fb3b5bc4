"""Correction of a candidate's χ² for noise that its own memory smooths."""

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel


def model(cost, passed, trust=1.0):
    at = SimpleNamespace(chi2_with_priors=cost, free=(0, 1))
    white = SimpleNamespace(size=1000, weight=trust)
    return CandidateFit((), cast(Any, white), cast(Any, at), passed)


@pytest.mark.parametrize(
    ("cost", "passed", "fair"),
    [
        (1100.0, 60.0, 1040.0),  # it is there, and is no misfit
        (1100.0, 300.0, 998.0),  # no more than is there
        (980.0, 60.0, 980.0),  # nothing is there
        (980.0, -60.0, 1040.0),  # what a lag averages is no merit
    ],
)
def test_smoothed_input_noise_is_subtracted(cost, passed, fair):
    assert model(cost, passed).corrected_chi2 == pytest.approx(fair)


def test_correction_is_smaller_with_misfit_weighting():
    assert model(400.0, 1000.0, trust=0.5).corrected_chi2 == pytest.approx(0.25 * 1000 - 2)


def test_models_with_different_noise_are_compared_by_the_likelihood():
    """Minus twice the logarithm of the normal density of all samples, written out."""
    n, channel = 12, Ar1Noise(np.linspace(0.5, 2.0, 12), 0.7, 0.8, True)
    noise = NoiseModel(
        (channel, None), (np.arange(n), np.arange(0)), (np.array([[0, n]]), np.zeros((0, 2), int))
    )
    louder_noise = dataclasses.replace(
        noise, channels=(dataclasses.replace(channel, sd=9 * channel.sd), None)
    )
    residual = np.random.default_rng(0).standard_normal((2, n))

    def build_fit(noise: NoiseModel) -> CandidateFit:
        cost = float(np.sum(noise.whiten(residual) ** 2))
        estimate: Any = SimpleNamespace(chi2_with_priors=cost, chi2=cost, free=())
        return CandidateFit((), noise, estimate)

    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    covariance = np.outer(channel.sd, channel.sd) * (0.7 * 0.8**lag + 0.3 * np.eye(n))
    want = np.linalg.slogdet(covariance)[1] + residual[0] @ np.linalg.solve(covariance, residual[0])
    fit, louder = build_fit(noise), build_fit(louder_noise)
    # The filter assumes a run without beginning: its first samples differ a little.
    assert fit.full_bic == pytest.approx(want, abs=0.5)
    # Negative control: without the determinant, a larger noise is always preferred.
    assert louder.bic < fit.bic
    assert louder.full_bic > fit.full_bic + 10
