"""Pairs of mechanisms are ranked by least squares over both."""

from itertools import combinations

import numpy as np

from pamjax.diagnosis.detect.score_test import ScoreDirection
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.pair_swap import rank_pairs
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from tests.diagnosis.plain_fits import build_fit

ROWS = 300
SAME_PAIR_CHI2_SHARE = DEFAULT_SETTINGS.same_pair_chi2_share


def build_score_directions(directions) -> tuple[list[ScoreDirection], ModelFit]:
    """Return score directions of mechanisms a, b, … with one amplitude each, and a fit without mechanisms."""
    norms = np.linalg.norm(directions, axis=1)
    scored = [
        ScoreDirection(
            Candidate(id, (f"{id}.amplitude",), {}),
            0.0,
            np.zeros(1),
            direction[None] / norm,
            np.array([True]),
            np.array([norm]),
        )
        for id, direction, norm in zip("abcdef", directions, norms, strict=False)
    ]
    return scored, build_fit(n=ROWS)


def test_the_best_pair_is_that_of_least_squares_over_all_pairs():
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((5, ROWS))
    directions[4] = directions[0] + directions[1] + 0.3 * directions[4]
    # The directions c and d are nearly parallel: each alone explains more than b, and together hardly more.
    directions[2] = directions[3] + 0.3 * directions[2]
    residual = 2.0 * directions[1] - 3.0 * directions[3] + rng.standard_normal(ROWS)
    scored, fit = build_score_directions(directions)
    (first, second), *_ = rank_pairs(scored, fit, residual, SAME_PAIR_CHI2_SHARE)
    amplitudes = {direction.candidate.id: amplitude.item() for direction, amplitude in (first, second)}
    assert set(amplitudes) == {"b", "d"}
    solution = np.linalg.lstsq(directions[[1, 3]].T, residual, rcond=None)[0]
    np.testing.assert_allclose([amplitudes["b"], amplitudes["d"]], solution)


def test_only_one_of_two_identical_pairs_is_ranked():
    """The directions a and d are equal, as those of a pressure gain and a force gain may be."""
    directions = np.random.default_rng(4).standard_normal((3, ROWS))
    directions = np.concatenate([directions, directions[:1]])
    residual = directions[0] * 9 + directions[1] * 9
    scored, fit = build_score_directions(directions)
    pairs = [
        {direction.candidate.id for direction, _ in pair}
        for pair in rank_pairs(scored, fit, residual, SAME_PAIR_CHI2_SHARE)
    ]
    assert len(pairs) < len(list(combinations("abcd", 2)))
    assert ({"a", "b"} in pairs) != ({"d", "b"} in pairs)
