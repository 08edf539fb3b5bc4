"""Model averaging: estimates and sd include other models that fit equally well."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.select import model_averaging as under_test
from pamjax.diagnosis.select.model_averaging import average_models
from pamjax.diagnosis.select.selection import NamedMechanism
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel

ROWS = 400
X = np.linspace(0, 1, ROWS)
UP, DOWN = (Candidate("wave", ("wave.much",), {"wave.turn": turn}) for turn in (1.0, -1.0))
NAMES = ("level", "wave.much", "wave.turn")


def recording(tilt) -> Any:
    """Return rows of level + much (turn² X + tilt turn X²); without tilt, ± turn are equivalent."""

    def slopes(values, places):
        level, much, turn = values
        by = [np.ones(ROWS), turn**2 * X + tilt * turn * X**2, much * (2 * turn * X + tilt * X**2)]
        shown = level + much * by[1]
        return np.stack([shown, np.zeros(ROWS)]), np.stack(
            [np.stack([by[k], np.zeros(ROWS)]) for k in places]
        )

    found = SimpleNamespace(
        settings=DEFAULT_SETTINGS,
        names=NAMES,
        index=NAMES.index,
        n=ROWS,
        jacobian=slopes,
        predict=lambda v: slopes(v, [0])[0],
        is_baseline=np.array([True, False, False]),
        is_logarithmic=np.zeros(3, bool),
        active=lambda values: set(),
        neutral=np.zeros(3),
        start=np.array([0.0, 5.0, 0.0]),
        prior_sd=np.array([10.0, 0.5, np.inf]),
        low=np.array([-50.0, 0.0, -3.0]),
        high=np.array([50.0, 9.0, 3.0]),
        meanings=tuple(SimpleNamespace(neutral=n, scale="linear") for n in (None, 0.0, None)),
    )
    noise = 0.1 * np.random.default_rng(5).standard_normal(ROWS)
    force = found.predict(np.array([2.0, 5.0, 1.2]))[0] + noise
    return SimpleNamespace(**vars(found), measured=np.stack([force, np.full(ROWS, np.nan)]))


def fitted(found, turn):
    colours = (Ar1Noise(np.full(ROWS, 0.1), 1.0, 0.0, True), None)
    white = NoiseModel(
        colours, (np.arange(ROWS), np.arange(0)), (np.array([[0, ROWS]]), np.zeros((0, 2), int))
    )
    return CandidateFit((UP,), white, fit_parameters(found, white, [0, 1, 2], np.array([0.0, 4.0, turn])))


@pytest.fixture(autouse=True)
def two_forms(monkeypatch):
    monkeypatch.setattr(under_test, "build_candidates", lambda found: [UP, DOWN])
    monkeypatch.setattr(
        under_test,
        "build_corrected_fit",
        lambda found, chosen, white, at: CandidateFit(chosen, white, at, 0.0),
    )


def test_sd_includes_two_equal_minima():
    found = recording(tilt=0.0)
    model = fitted(found, 1.0)
    told = average_models(found, model, ())
    turn = told.estimate.values[2]
    assert turn == pytest.approx(1.2, abs=0.2)
    # With probability 1/2, the difference is 2.4.
    assert told.sd(2) == pytest.approx(np.sqrt(0.5) * 2 * turn, rel=0.05)
    assert model.sd(2) < 0.2
    # Parameters on which both agree keep their sd.
    assert told.sd(0) == pytest.approx(model.sd(0), rel=0.05)


def test_better_minimum_replaces_the_worse():
    found = recording(tilt=0.9)
    wrong = fitted(found, -1.0)
    assert wrong.estimate.values[2] < 0
    told = average_models(found, wrong, ())
    right = fitted(found, 1.0)
    assert told.estimate.chi2_with_priors < wrong.estimate.chi2_with_priors - 10
    assert told.estimate.values == pytest.approx(right.estimate.values, rel=1e-2)
    assert told.sd(2) == pytest.approx(right.sd(2), rel=0.1)


def test_sd_includes_the_shift_of_a_tie():
    """The other form has a lower wave and a higher level. With weight 1/2 the variance is half the square."""
    found = recording(tilt=0.9)
    model = fitted(found, 1.0)
    other = Candidate("other", ("wave.turn",))
    tie = NamedMechanism(
        "wave", 0.9, ("other",), 50.0, alternatives=((0.5, other, np.array([0.0, 5.0, 0.3])),)
    )
    told = average_models(found, model, (tie,))
    by = (
        fit_parameters(found, model.noise, [0, 2], np.array([2.0, 0.0, 0.3])).values[0]
        - model.estimate.values[0]
    )
    assert abs(by) > 5 * model.sd(0)
    assert told.sd(0) == pytest.approx(np.hypot(model.sd(0), np.sqrt(0.5) * by), rel=0.02)
    # The parameters of the mechanism itself do not change.
    assert told.sd(1) == pytest.approx(model.sd(1))
    # A mechanism that was removed from the model has no effect.
    gone = dataclasses.replace(tie, id="gone")
    assert average_models(found, model, (gone,)).sd(0) == pytest.approx(model.sd(0), rel=0.1)
