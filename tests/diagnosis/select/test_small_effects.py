"""Small effects beside a large one are told where they leave little of what it leaves, and only there."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate
from pamjax.diagnosis.select import small_effects as under_test
from pamjax.diagnosis.select.small_effects import (
    add_small_effects,
    compute_excess_mean_square,
    is_prior_consistent,
)
from pamjax.infer.noise.ar1_filter import Ar1Noise

ROWS = 1500
#: Thirty ramps: what a model misses comes back in each.
X = np.tile(np.linspace(-1, 1, 50), 30)
NAMES = ("muscle.turns", "wall.much", "kink.much", "bump.much", "saw.much")
#: What each number does to the reading; the first is the lab's own and believed to 0.1.
SHAPES = np.stack([X, X**2, np.maximum(X - 0.3, 0), np.exp(-((X + 0.5) ** 2) / 0.02), (5 * X) % 1 - 0.5])
WALL, KINK, BUMP, SAW = (Candidate(name.partition(".")[0], (name,)) for name in NAMES[1:])


def read(kink, bump, unknown=0.0):
    """Unit noise on a wall of 300, with what is small beside it, and something that is no candidate."""
    noise = np.random.default_rng(2).standard_normal(ROWS)
    measured = np.full((2, ROWS), np.nan)
    measured[0] = np.array([0.0, 300.0, kink, bump, 0.0]) @ SHAPES + unknown * np.sin(9 * X) + noise

    def slopes(values, places):
        shown = np.stack([values @ SHAPES, np.zeros(ROWS)])
        return shown, np.stack([np.stack([SHAPES[k], np.zeros(ROWS)]) for k in places])

    limits = np.array([0.3, *[1e3] * 4])
    return SimpleNamespace(
        names=NAMES,
        index=NAMES.index,
        active=lambda values: set(),
        n=ROWS,
        measured=measured,
        jacobian=slopes,
        predict=lambda values: slopes(values, [0])[0],
        start=np.zeros(5),
        neutral=np.zeros(5),
        prior_sd=np.array([0.1, *[np.inf] * 4]),
        low=-limits,
        high=limits,
        meanings=(SimpleNamespace(neutral=0.0, scale="linear"),) * 5,
        is_logarithmic=np.zeros(5, bool),
        is_baseline=np.array([True, *[False] * 4]),
        case=SimpleNamespace(recording=SimpleNamespace(time=None)),
    )


@pytest.fixture
def told(monkeypatch):
    """What refining names in a reading whose wall is named."""
    colours = (Ar1Noise(np.ones(ROWS), 1.0, 0.0, True), None)
    white = NoiseModel(colours, (np.arange(ROWS), np.arange(0)), (np.zeros((0, 2), int),) * 2)

    def named(found):
        model = CandidateFit((WALL,), white, settled(found, white))
        return model, add_small_effects(found, model, (WALL, KINK, BUMP, SAW))

    def settled(found, white):
        monkeypatch.setattr("pamjax.diagnosis.refit.candidate_fit.estimate_noise", lambda *_: white)
        monkeypatch.setattr(
            "pamjax.diagnosis.refit.candidate_fit.correct_input_noise_bias", lambda *one: (one[2], 0.0)
        )
        return fit_candidate(found, np.ones(ROWS, bool), (WALL,), found.neutral).estimate

    return named


def test_small_effects_beside_a_large_one_are_named(told):
    model, grown = told(read(kink=12.0, bump=6.0))
    assert set(grown.ids) == {"wall", "kink", "bump"}
    assert compute_excess_mean_square(grown) < 0.1 * compute_excess_mean_square(model)
    assert grown.estimate.values[2:4] == pytest.approx([12.0, 6.0], abs=1.0)


def test_none_is_told_where_they_leave_much_of_what_was_left(told, monkeypatch):
    strange = read(kink=6.0, bump=0.0, unknown=3.0)
    model, grown = told(strange)
    assert grown is model
    # Able to fail: a rule that asks less of them tells some.
    monkeypatch.setattr(under_test, "MIN_JOINT_EXCESS_SHARE", 0.0)
    assert len(told(strange)[1].ids) > 1


def test_numbers_that_a_lab_would_not_believe_are_not_bought():
    found = SimpleNamespace(
        is_baseline=np.array([True, True]), prior_sd=np.array([0.1, 1.0]), start=np.zeros(2)
    )
    near, far = (
        SimpleNamespace(estimate=SimpleNamespace(values=np.array([a, b]))) for a, b in ((0.2, 1), (0.27, 2))
    )
    assert is_prior_consistent(found, near)
    assert not is_prior_consistent(found, far)


def test_a_model_that_leaves_noise_stays_as_it_is(told):
    model, grown = told(read(kink=0.0, bump=0.0))
    assert grown is model


def test_an_offset_that_no_bench_has_explains_nothing(told, monkeypatch):
    """A zero that ends where its range does is another's work."""
    found = read(kink=12.0, bump=6.0)
    _, grown = told(found)
    assert {"kink", "bump"} <= set(grown.ids)
    found.low, found.high = found.low.copy(), found.high.copy()
    found.low[3], found.high[3] = -4.0, 4.0
    model, grown = told(found)
    assert grown is model
    # Able to fail: it is the end of the range that speaks against it.
    monkeypatch.setattr(under_test, "has_extreme_amplitude", lambda *_: False)
    assert "bump" in told(found)[1].ids
