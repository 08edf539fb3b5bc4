"""Autocorrelation of the noise from residuals of a model, if neighbouring samples do not determine it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from pamjax.diagnosis.refit import noise_correlation as under_test
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.noise_correlation import fit_noise_correlation
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.records.simulate import draw_ar1_noise

ROWS, MEMORY, SHARED, MANY = 900, 0.9, 0.3, 40
X = np.linspace(-1, 1, ROWS)
#: A model that is linear in its parameters, with slow directions only.
SHAPES = np.stack([np.ones(ROWS), X, X**2, X**3])


def recording(seed: int, memory: float = MEMORY) -> Any:
    """Return noise with 30 % of its variance correlated; all parameters are zero."""
    rng = np.random.default_rng(seed)
    noise = np.sqrt(SHARED) * draw_ar1_noise(rng, ROWS, memory) + np.sqrt(1 - SHARED) * rng.standard_normal(
        ROWS
    )

    def slopes(values, places):
        shown = np.stack([values @ SHAPES, np.zeros(ROWS)])
        return shown, np.stack([np.stack([SHAPES[k], np.zeros(ROWS)]) for k in places])

    far = np.full(4, 1e3)
    return SimpleNamespace(
        settings=DEFAULT_SETTINGS,
        n=ROWS, jacobian=slopes, predict=lambda v: slopes(v, [0])[0], is_logarithmic=np.zeros(4, bool),
        is_baseline=np.ones(4, bool), prior_sd=np.full(4, np.inf), low=-far, high=far, start=np.zeros(4),
        neutral=np.zeros(4),
        meanings=(SimpleNamespace(neutral=0.0),) * 4, measured=np.stack([noise, np.full(ROWS, np.nan)]),
    )  # fmt: skip


def model(found, memory: float, given: bool = True) -> CandidateFit:
    """Return a model that is refitted with an assumed correlation."""
    colours = (Ar1Noise(np.ones(ROWS), SHARED, memory, given), None)
    white = NoiseModel(
        colours, (np.arange(ROWS), np.arange(0)), (np.array([[0, ROWS]]), np.zeros((0, 2), int))
    )
    return CandidateFit((), white, fit_parameters(found, white, [0, 1, 2, 3], np.zeros(4)))


def told(found, memory: float = 0.4) -> CandidateFit:
    return fit_noise_correlation(found, model(found, memory))


def memory_of(one: CandidateFit) -> float:
    colour = one.noise.channels[0]
    assert colour is not None
    return colour.correlation


def off(one: CandidateFit) -> list[float]:
    """Return the error of each parameter in units of its reported sd."""
    return [abs(one.estimate.values[k]) / one.sd(k) for k in range(4)]


def test_correlation_is_estimated_from_the_residuals(monkeypatch):
    monkeypatch.setattr(
        under_test, "build_corrected_fit", lambda found, chosen, white, at: CandidateFit(chosen, white, at)
    )
    ends = [told(recording(seed)) for seed in range(MANY)]
    found = np.array([memory_of(one) for one in ends])
    assert abs(found.mean() - MEMORY) < 3 * found.std() / np.sqrt(MANY) + 0.01
    assert np.mean([off(one) for one in ends]) < 1.0
    # Negative control: with the correlation of neighbouring samples, the reported sd are too small.
    assert np.mean([off(model(recording(seed), 0.4)) for seed in range(MANY)]) > 1.1


def test_uncorrelated_noise_stays_uncorrelated(monkeypatch):
    monkeypatch.setattr(
        under_test, "build_corrected_fit", lambda found, chosen, white, at: CandidateFit(chosen, white, at)
    )
    found = np.array([memory_of(told(recording(seed, 0.0), 0.0)) for seed in range(MANY)])
    assert np.mean(found < 0.3) > 0.8


def test_unstated_sensor_and_misfit_leave_the_noise_unchanged():
    one = model(recording(0), 0.4, given=False)
    assert fit_noise_correlation(recording(0), one) is one
    wrong = replace(one, noise=replace(one.noise, weight=0.5))
    assert fit_noise_correlation(recording(0), wrong) is wrong
