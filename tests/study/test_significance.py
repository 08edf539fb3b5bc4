"""One p-value for the largest of many correlated directions."""

import numpy as np
import pytest
from scipy.stats import norm, t

from pamjax.study import significance as under_test
from pamjax.study.noise_doubt import SCALE, Doubt
from pamjax.study.significance import _chance, _deviation, _stretch


def doubt(much):
    """That ln(standard deviation) of each of some directions is known to so much, (k,)."""
    by = np.exp(2 * np.outer(much, SCALE))[:, None]
    return Doubt(np.zeros(len(much)), by)


def sure(many):
    return doubt(np.zeros(many))


def directions(many, size, seed=0):
    """Unit directions that are correlated: neighbours overlap."""
    rng = np.random.default_rng(seed)
    raw = np.cumsum(rng.standard_normal((many, size)), axis=0)
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)


def test_p_values_are_uniform_where_nothing_is():
    rows = directions(40, 300)
    rng = np.random.default_rng(1)
    largest = np.abs(rows @ rng.standard_normal((300, 400))).max(axis=0)
    p = np.array([_chance(rows @ rows.T, x, sure(40), seed=2) for x in largest])
    # Kolmogorov and Smirnov's distance of 400 uniform numbers is above 0.0815 in one of a hundred.
    assert np.max(np.abs(np.sort(p) - (np.arange(400) + 0.5) / 400)) < 0.0815


def test_p_values_are_uniform_where_most_directions_have_one_sign():
    rows, either = directions(40, 300), np.arange(40) < 4
    rng = np.random.default_rng(3)
    largest = _deviation(rng.standard_normal((150, 300)) @ rows.T, either).max(axis=1)
    # The distance of 150 uniform numbers is above 0.133 in one of a hundred.
    p = np.array([_chance(rows @ rows.T, x, sure(40), seed=2, either=either) for x in largest])
    assert np.max(np.abs(np.sort(p) - (np.arange(150) + 0.5) / 150)) < 0.133
    both = np.array([_chance(rows @ rows.T, x, sure(40), seed=2) for x in largest])
    assert np.max(np.abs(np.sort(both) - (np.arange(150) + 0.5) / 150)) > 0.133


def test_the_tail_beyond_the_draws_goes_on_where_they_end():
    rows = directions(40, 300)
    gram = rows @ rows.T
    chances = [_chance(gram, x, sure(40), seed=2) for x in np.linspace(3.0, 6.0, 13)]
    steps = np.diff(np.log(chances))
    assert np.all(steps < 0)
    # Nowhere does it jump: each step is steeper than the last, and by little.
    assert np.all(np.abs(np.diff(steps)) < 1.0)


def test_a_single_direction_has_the_chance_of_one():
    assert _chance(np.eye(1), 1.96, sure(1), seed=0) == pytest.approx(0.05, abs=0.01)
    assert _chance(np.eye(1), 5.0, sure(1), seed=0) == pytest.approx(5.7e-7, rel=0.5)


def seen(deviation, much):
    """The chance of the largest of five deviations whose noise is in doubt."""
    five = doubt(np.full(5, much))
    return _chance(np.eye(5), deviation / _stretch(five)[0], five, seed=0)


def test_doubt_about_the_noise_makes_large_deviations_less_surprising():
    assert seen(4.0, 0.2) > 3 * seen(4.0, 0.0)


def test_a_deviation_of_known_noise_is_not_hidden_by_one_of_doubtful_noise(monkeypatch):
    """Thirty directions, one of them in doubt: a sure one counts about as if that were not there."""
    one = doubt(np.r_[0.6, np.zeros(29)])
    known = _chance(np.eye(30), 4.2, sure(30), seed=0)
    assert known < _chance(np.eye(30), 4.2, one, seed=0) < 4 * known
    # Able to fail: undivided, the doubtful one hides it.
    monkeypatch.setattr(under_test, "_stretch", lambda doubt: np.ones(30))
    assert _chance(np.eye(30), 4.2, one, seed=0) > 10 * known


def test_the_tail_of_doubtful_noise_has_the_closed_form():
    """One direction whose ln(sd) is normal: the chance is an integral over it, far beyond any draw."""
    much, far = 0.3, 9.0
    scale = np.linspace(-4, 4, 4001)
    want = 2 * np.trapezoid(norm.sf(far / np.exp(much * scale)) * norm.pdf(scale), scale)
    one = doubt(np.array([much]))
    assert want < 1e-5
    assert _chance(np.eye(1), far / _stretch(one)[0], one, seed=0) == pytest.approx(want, rel=0.35)
    # Able to fail: the tail of known noise from the last draws on is far too short.
    edge = far / 3
    assert want > 1e3 * 50 / 20000 * norm.sf(far) / norm.sf(edge)


def test_noise_found_from_few_squares_makes_a_deviation_less_surprising():
    """One direction under Student's noise: the closed form."""
    gram = np.eye(1)
    for deviation, freedom in ((3.0, 3.0), (25.0, 3.0), (25.0, 2.0)):
        want = 2 * t.sf(deviation, freedom)
        assert _chance(gram, deviation, sure(1), freedom, 0) == pytest.approx(want, rel=0.25)
    # Able to fail: known noise calls the same deviation impossible.
    assert _chance(gram, 25.0, sure(1), np.inf, 0) < 1e-100


@pytest.mark.parametrize("freedom", [np.inf, 3.0])
@pytest.mark.parametrize("much", [0.3, 2.0])
def test_no_deviation_is_lost_to_a_tail_too_small_for_a_number(much, freedom):
    chances = [_chance(np.eye(5), x, doubt(np.full(5, much)), freedom, 0) for x in (1e4, 1e6, 1e8)]
    assert np.all(np.isfinite(chances))
    assert chances[0] >= chances[1] >= chances[2]
    assert chances[2] < 1e-6
