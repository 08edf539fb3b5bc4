"""Correction of a candidate's χ² for noise that its own memory smooths."""

import dataclasses

import numpy as np
import pytest

from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from tests.diagnosis.plain_fits import build_estimate, build_fit, build_noise


def correct_chi2(chi2, input_noise_chi2, weight=1.0):
    """Return the corrected χ² of two parameters and a thousand samples."""
    fit = build_fit(np.zeros(2), (0, 1), n=1000, chi2=chi2, input_noise_chi2=input_noise_chi2, weight=weight)
    return fit.corrected_chi2


@pytest.mark.parametrize(
    ("chi2", "input_noise_chi2", "corrected"),
    [
        (1100.0, 60.0, 1040.0),  # the excess contains it
        (1100.0, 300.0, 998.0),  # at most the excess is subtracted
        (980.0, 60.0, 980.0),  # without excess nothing is subtracted
        (980.0, -60.0, 1040.0),  # noise that a lag averages is no improvement
    ],
)
def test_smoothed_input_noise_is_subtracted(chi2, input_noise_chi2, corrected):
    assert correct_chi2(chi2, input_noise_chi2) == pytest.approx(corrected)


def test_correction_is_smaller_with_misfit_weighting():
    assert correct_chi2(400.0, 1000.0, weight=0.5) == pytest.approx(0.25 * 1000 - 2)


def test_models_with_different_noise_are_compared_by_the_likelihood():
    """Minus twice the logarithm of the normal density of all samples, written out."""
    n, channel = 12, Ar1Noise(np.linspace(0.5, 2.0, 12), 0.7, 0.8, True)
    noise = build_noise(channel)
    louder_noise = dataclasses.replace(
        noise, by_channel=(dataclasses.replace(channel, sd=9 * channel.sd), None)
    )
    residual = np.random.default_rng(0).standard_normal((2, n))

    def build_fit(noise: NoiseModel) -> ModelFit:
        chi2 = float(np.sum(noise.whiten(residual) ** 2))
        return ModelFit((), noise, build_estimate((), chi2=chi2))

    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    covariance = np.outer(channel.sd, channel.sd) * (0.7 * 0.8**lag + 0.3 * np.eye(n))
    want = np.linalg.slogdet(covariance)[1] + residual[0] @ np.linalg.solve(covariance, residual[0])
    fit, louder = build_fit(noise), build_fit(louder_noise)
    # The filter assumes a run without beginning: its first samples differ a little.
    assert fit.full_bic == pytest.approx(want, abs=0.5)
    # Negative control: without the determinant, a larger noise is always preferred.
    assert louder.bic < fit.bic
    assert louder.full_bic > fit.full_bic + 10
