"""One p-value for everything that was looked at.

Looked at are the signature of every form in the library and the shift of every part of the recording,
each freed of what the baseline's numbers absorb: K unit directions, white. If the baseline is right, the
residual along each is a standard normal variable, and all of them together are correlated as the
directions themselves are; of an amplitude that cannot be negative only the positive side counts. The
chance that the largest comes out as large as seen is found by drawing them; beyond what can be drawn, as
that of as many independent ones as have the same tail.

Noise was read off the recording, and is known no better than that: each draw is made with a noise of its
own, as wide as that knowledge. Beside the directions stands the mean square of the residual itself, for
what none of them shows. It allows for a sensor that is worse than stated and so hardly ever alarms: it gets
a twentieth of the level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm
from scipy.stats import t as student

from pamjax.study.cells import shifts
from pamjax.study.noise_doubt import SCALE, Doubt, doubt_of
from pamjax.study.problem import Problem
from pamjax.study.refit import Refit
from pamjax.study.signature import Absorbed, Signature
from pamjax.study.whiten import Whitening

#: Draws of the largest of all directions.
DRAWS = 20000

#: How well a lab knows its sensors' noise, as a share of its variance.
SENSOR = 0.1

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
    ends = np.full((2, doubt.by_channel.shape[1]), [[-2.0], [2.0]])
    return np.maximum(doubt.sd(ends).max(axis=0), 1.0)


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
    weights, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(weights, 0.0))
    channels, stretch = doubt.by_channel.shape[1], _stretch(doubt)
    rng = np.random.default_rng(seed)
    most = np.empty(DRAWS)
    for k in range(0, DRAWS, 2000):
        drawn = _deviation(rng.standard_normal((2000, root.shape[1])) @ root.T, either)
        drawn *= doubt.sd(rng.standard_normal((2000, channels))) / stretch
        most[k : k + 2000] = drawn.max(axis=1)
        if math.isfinite(freedom):
            most[k : k + 2000] /= np.sqrt(rng.chisquare(freedom, 2000) / freedom)
    above = np.count_nonzero(most >= largest)
    if above >= 50:
        return above / DRAWS
    # As many independent variables as have the 50th largest draw at the same chance.
    edge = float(np.partition(most, -50)[-50])
    beyond = _tail(largest, doubt, freedom) - _tail(edge, doubt, freedom)
    return float(np.clip(50 / DRAWS * math.exp(min(beyond, 0.0)), 1e-300, 1.0))


def _tail(deviation: float, doubt: Doubt, freedom: float) -> float:
    """Logarithm of the chance of so much along any of the directions, but for a factor.

    Over all that the noise may be; in logarithms, as the tail may be beyond what a number can hold.
    """
    channels = doubt.by_channel.shape[1]
    nodes = np.stack(np.meshgrid(*[SCALE] * channels), axis=-1).reshape(-1, channels)
    scale = doubt.sd(nodes) / _stretch(doubt)
    logsf = student(freedom).logsf if math.isfinite(freedom) else norm.logsf
    # What is divided by nothing is nowhere.
    far = logsf(deviation / np.maximum(scale, 1e-300)) + norm.logpdf(nodes).sum(axis=1)[:, None]
    return float(logsumexp(far))


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
