"""Misfit weighting: a smooth misfit does not change well-measured parameters."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.refit import misfit_weighting as under_test
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.misfit_weighting import (
    fit_with_misfit_weight,
    reweight_by_misfit,
)
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel

ROWS = 2000


def line(smooth):
    """Return readings of a x + b with unit noise and a smooth misfit; a has a prior."""
    rng = np.random.default_rng(6)
    x = np.linspace(-1, 1, ROWS)
    design = np.stack([x, np.ones(ROWS)])
    measured = np.full((2, ROWS), np.nan)
    measured[0] = 3 * x + 2 + smooth * np.where(x > 0.4, x - 0.4, 0.0) + rng.standard_normal(ROWS)

    def slopes(values, places):
        shown = np.stack([values @ design, np.zeros(ROWS)])
        return shown, np.stack([np.stack([design[k], np.zeros(ROWS)]) for k in places])

    found = SimpleNamespace(
        settings=DEFAULT_SETTINGS,
        start=np.array([3.0, 0.0]),
        prior_sd=np.array([0.3, np.inf]),
        low=np.full(2, -50.0),
        high=np.full(2, 50.0),
        meanings=(SimpleNamespace(neutral=None, scale="linear"),) * 2,
        is_logarithmic=np.zeros(2, bool),
        is_baseline=np.ones(2, bool),
        n=ROWS,
        measured=measured,
        jacobian=slopes,
        predict=lambda values: slopes(values, [0])[0],
    )
    colours = (Ar1Noise(np.ones(ROWS), 1.0, 0.0, True), None)
    white = NoiseModel(colours, (np.arange(ROWS), np.arange(0)), (np.zeros((0, 2), int),) * 2)
    return found, CandidateFit((), white, fit_parameters(found, white, [0, 1], np.array([3.0, 0.0])))


def test_prior_is_kept_if_the_model_is_wrong():
    found, model = line(smooth=60.0)
    a, kept = model.estimate.values[0], reweight_by_misfit(found, model).estimate.values[0]
    # Negative control: weighted by noise only, two thousand rows shift the slope by tens of sd.
    assert abs(a - 3.0) > 20 * 0.3
    assert abs(kept - 3.0) < abs(a - 3.0) / 2
    assert reweight_by_misfit(found, model).estimate.covariance[0, 0] > 5**2 * model.estimate.covariance[0, 0]


def test_model_without_misfit_is_unchanged():
    found, model = line(smooth=0.0)
    assert reweight_by_misfit(found, model) is model


def test_weights_follow_from_the_residuals_at_the_start(monkeypatch):
    found, model = line(smooth=60.0)
    settled = []
    monkeypatch.setattr(under_test, "estimate_noise", lambda *_: model.noise)
    monkeypatch.setattr(under_test, "fit_candidate", lambda *one: settled.append(one))
    kept = fit_with_misfit_weight(found, np.ones(ROWS, bool), (), np.array([3.0, 2.0]))
    assert not settled
    assert kept.noise.weight < 0.5
    # Weighted by noise only, the slope is tens of sd away.
    assert abs(kept.estimate.values[0] - 3.0) < abs(model.estimate.values[0] - 3.0) / 2
    # A model that is wrong only at its start values gets the weights of the noise.
    found, model = line(smooth=0.0)
    fit_with_misfit_weight(found, np.ones(ROWS, bool), (), np.array([-3.0, 20.0]))
    fit_with_misfit_weight(found, np.ones(ROWS, bool), (), model.estimate.values)
    assert [float(one[3][0]) for one in settled] == pytest.approx([3.0, 3.0], abs=0.3)
