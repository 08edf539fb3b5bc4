"""One p-value for the largest of many correlated directions."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm, t

from pamjax.diagnosis.detect import significance as under_test
from pamjax.diagnosis.detect.significance import (
    _compute_deviation,
    _compute_sd_bound,
    _estimate_tail_probability,
    compute_significance,
)
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.noise.uncertainty import NORMAL_NODES, NoiseUncertainty, estimate_noise_uncertainty
from pamjax.infer.noise.ar1_filter import Ar1Noise


def doubt(much):
    """That ln(standard deviation) of each of some directions is known to so much, (k,)."""
    by = np.exp(2 * np.outer(much, NORMAL_NODES))[:, None]
    return NoiseUncertainty(np.zeros(len(much)), by)


def sure(many):
    return doubt(np.zeros(many))


def directions(many, size, seed=0):
    """Unit directions that are correlated: neighbours overlap."""
    rng = np.random.default_rng(seed)
    raw = np.cumsum(rng.standard_normal((many, size)), axis=0)
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)


@pytest.mark.slow
def test_p_values_are_uniform_where_nothing_is():
    rows = directions(40, 300)
    rng = np.random.default_rng(1)
    largest = np.abs(rows @ rng.standard_normal((300, 400))).max(axis=0)
    p = np.array([_estimate_tail_probability(rows @ rows.T, x, sure(40), seed=2) for x in largest])
    # Kolmogorov and Smirnov's distance of 400 uniform numbers is above 0.0815 in one of a hundred.
    assert np.max(np.abs(np.sort(p) - (np.arange(400) + 0.5) / 400)) < 0.0815


@pytest.mark.slow
def test_p_values_are_uniform_where_most_directions_have_one_sign():
    rows, either = directions(40, 300), np.arange(40) < 4
    rng = np.random.default_rng(3)
    largest = _compute_deviation(rng.standard_normal((150, 300)) @ rows.T, either).max(axis=1)
    # The distance of 150 uniform numbers is above 0.133 in one of a hundred.
    p = np.array(
        [_estimate_tail_probability(rows @ rows.T, x, sure(40), seed=2, is_two_sided=either) for x in largest]
    )
    assert np.max(np.abs(np.sort(p) - (np.arange(150) + 0.5) / 150)) < 0.133
    both = np.array([_estimate_tail_probability(rows @ rows.T, x, sure(40), seed=2) for x in largest])
    assert np.max(np.abs(np.sort(both) - (np.arange(150) + 0.5) / 150)) > 0.133


def test_the_tail_beyond_the_draws_goes_on_where_they_end():
    rows = directions(40, 300)
    gram = rows @ rows.T
    chances = [_estimate_tail_probability(gram, x, sure(40), seed=2) for x in np.linspace(3.0, 6.0, 13)]
    steps = np.diff(np.log(chances))
    assert np.all(steps < 0)
    # Nowhere does it jump: each step is steeper than the last, and by little.
    assert np.all(np.abs(np.diff(steps)) < 1.0)


def test_a_single_direction_has_the_chance_of_one():
    assert _estimate_tail_probability(np.eye(1), 1.96, sure(1), seed=0) == pytest.approx(0.05, abs=0.01)
    assert _estimate_tail_probability(np.eye(1), 5.0, sure(1), seed=0) == pytest.approx(5.7e-7, rel=0.5)


def seen(deviation, much):
    """The chance of the largest of five deviations whose noise is in doubt."""
    five = doubt(np.full(5, much))
    return _estimate_tail_probability(np.eye(5), deviation / _compute_sd_bound(five)[0], five, seed=0)


def test_doubt_about_the_noise_makes_large_deviations_less_surprising():
    assert seen(4.0, 0.2) > 3 * seen(4.0, 0.0)


def test_a_deviation_of_known_noise_is_not_hidden_by_one_of_doubtful_noise(monkeypatch):
    """Thirty directions, one of them in doubt: a sure one counts about as if that were not there."""
    one = doubt(np.r_[0.6, np.zeros(29)])
    known = _estimate_tail_probability(np.eye(30), 4.2, sure(30), seed=0)
    assert known < _estimate_tail_probability(np.eye(30), 4.2, one, seed=0) < 4 * known
    # Able to fail: undivided, the doubtful one hides it.
    monkeypatch.setattr(under_test, "_compute_sd_bound", lambda doubt: np.ones(30))
    assert _estimate_tail_probability(np.eye(30), 4.2, one, seed=0) > 10 * known


def test_the_tail_of_doubtful_noise_has_the_closed_form():
    """One direction whose ln(sd) is normal: the chance is an integral over it, far beyond any draw."""
    much, far = 0.3, 6.0
    scale = np.linspace(-4, 4, 4001)
    want = 2 * np.trapezoid(norm.sf(far / np.exp(much * scale)) * norm.pdf(scale), scale)
    one = doubt(np.array([much]))
    assert want < 1e-3
    assert _estimate_tail_probability(
        np.eye(1), far / _compute_sd_bound(one)[0], one, seed=0
    ) == pytest.approx(want, rel=0.02)
    # Able to fail: what is known has no such tail.
    assert _estimate_tail_probability(np.eye(1), far, sure(1), seed=0) < 1e-2 * want


@pytest.mark.parametrize("alike", [0.0, 0.99])
def test_the_tail_of_many_doubtful_directions_is_that_of_drawing_them(alike):
    """Two hundred, all of one doubtful noise, none or nearly all the same; half have one sign."""
    many, much, far = 200, 0.5, 9.0
    gram = np.full((many, many), alike) + (1 - alike) * np.eye(many)
    either = np.arange(many) < 100
    every = doubt(np.full(many, much))
    rng = np.random.default_rng(4)
    hits = []
    for _ in range(40):
        shared, own = rng.standard_normal((2000, 1)), rng.standard_normal((2000, many))
        drawn = np.sqrt(alike) * shared + np.sqrt(1 - alike) * own
        drawn *= np.exp(much * rng.standard_normal((2000, 1)))
        hits.append(np.mean(_compute_deviation(drawn, either).max(axis=1) >= far))
    want, error = np.mean(hits), np.std(hits) / np.sqrt(40)
    assert 1e-4 < want < 0.1
    assert _estimate_tail_probability(
        gram, far / _compute_sd_bound(every)[0], every, is_two_sided=either
    ) == pytest.approx(want, abs=4 * error)
    # Able to fail: as many independent ones of known noise have another tail.
    assert (
        abs(
            _estimate_tail_probability(
                np.eye(many), far / _compute_sd_bound(every)[0], sure(many), is_two_sided=either
            )
            - want
        )
        > 8 * error
    )


def test_a_noise_that_a_table_tells_is_shared_by_all_directions():
    """Drawn: fifty directions over one square of three degrees of freedom."""
    rng, freedom, far = np.random.default_rng(5), 3.0, 12.0
    drawn = np.abs(rng.standard_normal((200_000, 50))).max(axis=1)
    want = np.mean(drawn / np.sqrt(rng.chisquare(freedom, drawn.size) / freedom) > far)
    assert _estimate_tail_probability(np.eye(50), far, sure(50), freedom) == pytest.approx(want, rel=0.05)
    # Able to fail: fifty of a square each reach as far many times as often.
    assert 1 - (1 - 2 * t.sf(far, freedom)) ** 50 > 2 * want


def test_where_nothing_can_be_looked_along_nothing_is_found():
    assert _estimate_tail_probability(np.eye(0), 0.0, sure(0)) == 1.0


def test_both_ends_of_a_doubt_stretch():
    """A fast direction has more noise for a smaller correlation."""
    fast = NoiseUncertainty(np.zeros(1), np.exp(-2 * 0.3 * NORMAL_NODES)[None, None])
    assert _compute_sd_bound(fast) == pytest.approx([np.exp(0.6)])
    slow_and_fast = np.stack([0.5 * np.exp(2 * 0.3 * NORMAL_NODES), 0.5 * np.exp(-2 * 0.3 * NORMAL_NODES)])[
        None
    ]
    assert _compute_sd_bound(NoiseUncertainty(np.zeros(1), slow_and_fast)) == pytest.approx([np.exp(0.6)])


def test_noise_found_from_few_squares_makes_a_deviation_less_surprising():
    """One direction under Student's noise: the closed form."""
    gram = np.eye(1)
    for deviation, freedom in ((3.0, 3.0), (25.0, 3.0), (25.0, 2.0)):
        want = 2 * t.sf(deviation, freedom)
        assert _estimate_tail_probability(gram, deviation, sure(1), freedom, 0) == pytest.approx(
            want, rel=0.25
        )
    # Able to fail: known noise calls the same deviation impossible.
    assert _estimate_tail_probability(gram, 25.0, sure(1), np.inf, 0) < 1e-100


@pytest.mark.parametrize("freedom", [np.inf, 3.0])
@pytest.mark.parametrize("much", [0.3, 2.0])
def test_no_deviation_is_lost_to_a_tail_too_small_for_a_number(much, freedom):
    chances = [
        _estimate_tail_probability(np.eye(5), x, doubt(np.full(5, much)), freedom, 0) for x in (1e4, 1e6, 1e8)
    ]
    assert np.all(np.isfinite(chances))
    assert chances[0] >= chances[1] >= chances[2]
    assert chances[2] < 1e-6


def test_the_deviation_that_was_seen_is_divided_as_the_draws_are(monkeypatch):
    """Four standard deviations along a slow direction of a channel whose own noise is a fifth."""
    n = 700
    slow = np.ones((1, n)) / np.sqrt(n)
    colour = Ar1Noise(np.ones(n), 0.2, 0.0, True, rho_from_differences=0.4)
    runs = (np.array([[0, n]]), np.zeros((0, 2), int))
    white = NoiseModel((colour, None), (np.arange(n), np.arange(0)), runs)
    at: Any = SimpleNamespace(residual=4.0 * slow[0], jacobian=np.zeros((n, 1)), prior_sd=np.ones(1))
    monkeypatch.setattr(under_test, "compute_region_shifts", lambda found, white: slow)
    monkeypatch.setattr(under_test, "_find_largest_mean_square", lambda found, white, at: (1.0, -np.inf))
    found: Any = None
    judged = compute_significance(found, white, at, [])
    stretch = _compute_sd_bound(estimate_noise_uncertainty(white, slow))[0]
    assert stretch > 1.3
    assert judged.largest_deviation == pytest.approx(4.0 / stretch)
    # Able to fail: undivided, it would be as rare as one that is larger by that factor.
    assert (
        _estimate_tail_probability(np.eye(1), 4.0, estimate_noise_uncertainty(white, slow))
        < 0.5 * judged.p_value
    )
