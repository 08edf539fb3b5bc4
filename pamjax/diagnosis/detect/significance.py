"""One p-value for everything that was looked at.

Looked at are the signature of every form in the library and the shift of every part of the recording,
each freed of what the baseline's numbers absorb: K unit directions, white. If the baseline is right, the
residual along each is a standard normal variable, and all of them together are correlated as the
directions themselves are; of an amplitude that cannot be negative only the positive side counts. Noise was
read off the recording, and is known no better than that: the standard deviations σ have a distribution of
their own. The chance that the largest comes out as large as the d that was seen is that of a union,

    P = Σ_jk w_j s_k Q(d / σ_jk) · E[1 / N],

over what the noise may be (j, weight w) and directions (k, sides s): for noise and direction drawn by their
part of the sum and the deviation there beyond d, N is how many of all K are beyond. Beside the directions
stands the mean square of the residual itself, for what none of them shows. It allows for a sensor that is
worse than stated and so hardly ever alarms: it gets a twentieth of the level.
Source: the chance of a union by sampling its events, R. M. Karp, M. Luby & N. Madras, J. Algorithms 10, 429
(1989).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtri_exp, softmax
from scipy.stats import norm
from scipy.stats import t as student

from pamjax.diagnosis.detect.regions import shifts
from pamjax.diagnosis.detect.score_test import Absorbed, Signature
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import SENSOR, Whitening
from pamjax.diagnosis.noise.uncertainty import SCALE, Doubt, doubt_of
from pamjax.diagnosis.refit.least_squares import Refit

#: Draws behind a p-value.
DRAWS = 10000

#: How many numbers are held at once.
AT_ONCE = 10**6

#: Share of the level that goes to the mean square of the residual, rather than to the largest direction.
OF_SQUARE = 0.05

#: p-value below which a mismatch counts as detected.
DETECTED = 0.01


@dataclass(frozen=True)
class Significance:
    """How far a residual is from noise.

    Attributes:
        p_value: of the largest deviation, over everything that was looked at.
        largest: standard deviations of the largest direction, fewer where its noise is in doubt.
        looked: how many directions were looked along.
        square: mean square of the residual over its noise variance, 1 when only noise is left.
    """

    p_value: float
    largest: float
    looked: int
    square: float


def significance(
    found: Problem, white: Whitening, at: Refit, seen: list[Signature], seed: int = 0
) -> Significance:
    """Judge the residual of a refit.

    Args:
        found: the recording before the library.
        white: its noise.
        at: the refit.
        seen: the signatures that were looked at.
        seed: of the draws.
    """
    absorbed = Absorbed(at)
    seen = [signature for signature in seen if signature.directions.size]
    shifted = _unit(absorbed.out_of(shifts(found, white)))
    directions = np.concatenate([*(signature.directions for signature in seen), shifted])
    either = np.concatenate([*(s.either_sign for s in seen), np.ones(len(shifted), dtype=bool)])
    there = np.linalg.norm(directions, axis=1) > 0.5
    directions, either = directions[there], either[there]
    along = directions[:, : at.residual.size] @ at.residual
    doubt = doubt_of(white, directions)
    largest = float(np.max(_deviation(along, either) / _stretch(doubt), initial=0.0))
    p = _chance(directions @ directions.T, largest, doubt, _freedom(white), seed, either)
    square, beyond = _square(found, white, at)
    chance = min(p / (1 - OF_SQUARE), float(norm.sf(beyond)) / OF_SQUARE, 1.0)
    return Significance(float(max(chance, 1e-300)), largest, len(directions), square)


def _unit(rows: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    # What is absorbed all but wholly has no direction of its own.
    return np.where(norms > 1e-6, rows / np.where(norms > 0, norms, 1.0), 0.0)


def _deviation(along: np.ndarray, either: np.ndarray | bool) -> np.ndarray:
    """Along what has one sign only, the other sign is no deviation towards it."""
    return np.where(either, np.abs(along), along)


def _stretch(doubt: Doubt) -> np.ndarray:
    """By what a deviation is divided, so that one of doubtful noise hides none of noise that is known."""
    ends = doubt.by_channel[..., [int(np.argmin(abs(SCALE - z))) for z in (-2.0, 2.0)]]
    return np.sqrt(np.maximum(doubt.sure + ends.max(axis=2).sum(axis=1), 1.0))


def _chance(
    gram: np.ndarray,
    largest: float,
    doubt: Doubt,
    freedom: float = math.inf,
    seed: int = 0,
    either: np.ndarray | bool = True,
) -> float:
    """Chance that the largest of correlated normal variables is as large as this.

    Their standard deviations are in doubt, and each is divided by what that may stretch it. Where the noise
    itself was found from few squares, they are correlated variables of Student.
    """
    if not len(gram):
        return 1.0
    rng = np.random.default_rng(seed)
    channels, either = doubt.by_channel.shape[1], np.broadcast_to(either, len(gram))
    nodes = np.stack(np.meshgrid(*[SCALE] * channels), axis=-1).reshape(-1, channels)
    sigma = doubt.sd(nodes) / _stretch(doubt)
    weight = norm.logpdf(nodes).sum(axis=1)
    # In logarithms throughout: a tail may be beyond what a number can hold.
    part = (weight - logsumexp(weight))[:, None] + np.log(1.0 + either)
    part += _log_tail(largest / np.maximum(sigma, 1e-300), freedom)
    drawn = rng.choice(part.size, DRAWS, p=softmax(part).ravel())
    node, k = np.unravel_index(drawn, part.shape)
    sign = np.where(either[k], rng.choice([-1.0, 1.0], DRAWS), 1.0)
    there = sign * _beyond(largest / sigma[node, k], freedom, rng)
    # The square that a noise was found from is shared by all variables of Student: what it is, given one.
    square = (
        rng.chisquare(freedom + 1, DRAWS) / (freedom + there**2) if freedom < math.inf else np.ones(DRAWS)
    )
    root, over = _root(gram), np.empty(DRAWS)
    for some in np.array_split(np.arange(DRAWS), DRAWS * len(gram) // AT_ONCE + 1):
        scale = np.sqrt(square[some])[:, None]
        all_of_them = _given(gram, root, k[some], there[some] * scale[:, 0], rng) / scale
        beyond = _deviation(sigma[node[some]] * all_of_them, either) >= largest
        # The one that was drawn is beyond, whatever its last digit says.
        over[some] = 1 / np.maximum(np.count_nonzero(beyond, axis=1), 1)
    log_chance = float(np.asarray(logsumexp(part))) + math.log(float(over.mean()))
    return float(np.clip(math.exp(min(log_chance, 0.0)), 1e-300, 1.0))


def _given(
    gram: np.ndarray, root: np.ndarray, k: np.ndarray, there: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Correlated standard normal variables, (m, K), of which the k-th is what it is."""
    drawn = rng.standard_normal((k.size, len(gram))) @ root.T
    return drawn + gram[k] * (there - drawn[np.arange(k.size), k])[:, None]


def _root(gram: np.ndarray) -> np.ndarray:
    weights, vectors = np.linalg.eigh(gram)
    return vectors * np.sqrt(np.maximum(weights, 0.0))


def _log_tail(deviation: np.ndarray, freedom: float) -> np.ndarray:
    return student(freedom).logsf(deviation) if math.isfinite(freedom) else log_ndtr(-deviation)


def _beyond(deviation: np.ndarray, freedom: float, rng: np.random.Generator) -> np.ndarray:
    """Variables drawn from beyond some deviations."""
    rank = np.log(rng.uniform(size=deviation.shape)) + _log_tail(deviation, freedom)
    out = student(freedom).isf(np.exp(rank)) if math.isfinite(freedom) else -ndtri_exp(rank)
    # At the edge of what numbers can tell apart.
    return np.maximum(out, deviation)


def _freedom(white: Whitening) -> float:
    """Fewest independent squares that told the noise of a channel; infinite where it was stated."""
    return min((colour.freedom for colour in white.colours if colour), default=math.inf)


def _square(found: Problem, white: Whitening, at: Refit) -> tuple[float, float]:
    """Largest mean square of a channel's residual, and by how many standard errors it is above one."""
    residual = found.measured - found.shows(at.values)
    worst = (1.0, -math.inf)
    for c, colour in enumerate(white.colours):
        if colour is None or not colour.given:
            continue
        standard = white.standard(residual, c)[white.rows[c]]
        mean = float(np.mean(standard**2))
        repeated = 1 + 2 * colour.shared**2 * colour.correlation**2 / max(1 - colour.correlation**2, 1e-3)
        error = math.sqrt(2 * repeated / standard.size + SENSOR**2)
        worst = max(worst, (mean, (mean - 1) / error), key=lambda pair: pair[1])
    return worst
