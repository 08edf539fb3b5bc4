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

from pamjax.diagnosis.detect.regions import compute_region_shifts
from pamjax.diagnosis.detect.score_test import ProjectedOut, ScoreDirection
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import SENSOR_VARIANCE_SD_SHARE, NoiseModel
from pamjax.diagnosis.noise.uncertainty import NORMAL_NODES, NoiseUncertainty, estimate_noise_uncertainty
from pamjax.diagnosis.refit.least_squares import MapEstimate

#: Draws behind a p-value.
SIGNIFICANCE_DRAWS = 10000

#: How many numbers are held at once.
MAX_NUMBERS_PER_BATCH = 10**6

#: Share of the level that goes to the mean square of the residual, rather than to the largest direction.
MEAN_SQUARE_LEVEL_SHARE = 0.05

#: p-value below which a mismatch counts as detected.
DETECTION_P_VALUE = 0.01


@dataclass(frozen=True)
class Significance:
    """How far a residual is from noise.

    Attributes:
        p_value: of the largest deviation, over everything that was looked at.
        largest_deviation: standard deviations of the largest direction, fewer where its noise is in doubt.
        direction_count: how many directions were looked along.
        mean_square: mean square of the residual over its noise variance, 1 when only noise is left.
    """

    p_value: float
    largest_deviation: float
    direction_count: int
    mean_square: float


def compute_significance(
    problem: LibraryProblem,
    noise: NoiseModel,
    estimate: MapEstimate,
    score_directions: list[ScoreDirection],
    seed: int = 0,
) -> Significance:
    """Judge the residual of a refit.

    Args:
        problem: the recording before the library.
        noise: its noise.
        estimate: the refit.
        score_directions: the signatures that were looked at.
        seed: of the draws.
    """
    projected_out = ProjectedOut(estimate)
    score_directions = [
        score_direction for score_direction in score_directions if score_direction.unit_vectors.size
    ]
    region_shifts = _normalise_rows(projected_out.project_out(compute_region_shifts(problem, noise)))
    directions = np.concatenate(
        [*(score_direction.unit_vectors for score_direction in score_directions), region_shifts]
    )
    is_two_sided = np.concatenate(
        [*(s.is_two_sided for s in score_directions), np.ones(len(region_shifts), dtype=bool)]
    )
    has_direction = np.linalg.norm(directions, axis=1) > 0.5
    directions, is_two_sided = directions[has_direction], is_two_sided[has_direction]
    along = directions[:, : estimate.residual.size] @ estimate.residual
    uncertainty = estimate_noise_uncertainty(noise, directions)
    largest = float(
        np.max(_compute_deviation(along, is_two_sided) / _compute_sd_bound(uncertainty), initial=0.0)
    )
    p = _estimate_tail_probability(
        directions @ directions.T, largest, uncertainty, _find_degrees_of_freedom(noise), seed, is_two_sided
    )
    mean_square, beyond = _find_largest_mean_square(problem, noise, estimate)
    p_value = min(p / (1 - MEAN_SQUARE_LEVEL_SHARE), float(norm.sf(beyond)) / MEAN_SQUARE_LEVEL_SHARE, 1.0)
    return Significance(float(max(p_value, 1e-300)), largest, len(directions), mean_square)


def _normalise_rows(rows: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    # What is absorbed all but wholly has no direction of its own.
    return np.where(norms > 1e-6, rows / np.where(norms > 0, norms, 1.0), 0.0)


def _compute_deviation(along: np.ndarray, is_two_sided: np.ndarray | bool) -> np.ndarray:
    """Along what has one sign only, the other sign is no deviation towards it."""
    return np.where(is_two_sided, np.abs(along), along)


def _compute_sd_bound(uncertainty: NoiseUncertainty) -> np.ndarray:
    """By what a deviation is divided, so that one of doubtful noise hides none of noise that is known."""
    ends = uncertainty.variance_by_channel[..., [int(np.argmin(abs(NORMAL_NODES - z))) for z in (-2.0, 2.0)]]
    return np.sqrt(np.maximum(uncertainty.known_variance + ends.max(axis=2).sum(axis=1), 1.0))


def _estimate_tail_probability(
    gram: np.ndarray,
    largest: float,
    uncertainty: NoiseUncertainty,
    degrees_of_freedom: float = math.inf,
    seed: int = 0,
    is_two_sided: np.ndarray | bool = True,
) -> float:
    """Chance that the largest of correlated normal variables is as large as this.

    Their standard deviations are in doubt, and each is divided by what that may stretch it. Where the noise
    itself was found from few squares, they are correlated variables of Student.
    """
    if not len(gram):
        return 1.0
    rng = np.random.default_rng(seed)
    channels, is_two_sided = (
        uncertainty.variance_by_channel.shape[1],
        np.broadcast_to(is_two_sided, len(gram)),
    )
    nodes = np.stack(np.meshgrid(*[NORMAL_NODES] * channels), axis=-1).reshape(-1, channels)
    sigma = uncertainty.compute_sd(nodes) / _compute_sd_bound(uncertainty)
    weight = norm.logpdf(nodes).sum(axis=1)
    # In logarithms throughout: a tail may be beyond what a number can hold.
    part = (weight - logsumexp(weight))[:, None] + np.log(1.0 + is_two_sided)
    part += _compute_log_tail(largest / np.maximum(sigma, 1e-300), degrees_of_freedom)
    drawn = rng.choice(part.size, SIGNIFICANCE_DRAWS, p=softmax(part).ravel())
    node, k = np.unravel_index(drawn, part.shape)
    sign = np.where(is_two_sided[k], rng.choice([-1.0, 1.0], SIGNIFICANCE_DRAWS), 1.0)
    deviations = sign * _sample_tail(largest / sigma[node, k], degrees_of_freedom, rng)
    # The square that a noise was found from is shared by all variables of Student: what it is, given one.
    square = (
        rng.chisquare(degrees_of_freedom + 1, SIGNIFICANCE_DRAWS) / (degrees_of_freedom + deviations**2)
        if degrees_of_freedom < math.inf
        else np.ones(SIGNIFICANCE_DRAWS)
    )
    root, over = _compute_square_root(gram), np.empty(SIGNIFICANCE_DRAWS)
    for some in np.array_split(
        np.arange(SIGNIFICANCE_DRAWS), SIGNIFICANCE_DRAWS * len(gram) // MAX_NUMBERS_PER_BATCH + 1
    ):
        scale = np.sqrt(square[some])[:, None]
        all_of_them = _sample_conditional(gram, root, k[some], deviations[some] * scale[:, 0], rng) / scale
        beyond = _compute_deviation(sigma[node[some]] * all_of_them, is_two_sided) >= largest
        # The one that was drawn is beyond, whatever its last digit says.
        over[some] = 1 / np.maximum(np.count_nonzero(beyond, axis=1), 1)
    log_chance = float(np.asarray(logsumexp(part))) + math.log(float(over.mean()))
    return float(np.clip(math.exp(min(log_chance, 0.0)), 1e-300, 1.0))


def _sample_conditional(
    gram: np.ndarray, root: np.ndarray, k: np.ndarray, deviations: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Correlated standard normal variables, (m, K), of which the k-th is what it is."""
    drawn = rng.standard_normal((k.size, len(gram))) @ root.T
    return drawn + gram[k] * (deviations - drawn[np.arange(k.size), k])[:, None]


def _compute_square_root(gram: np.ndarray) -> np.ndarray:
    weights, vectors = np.linalg.eigh(gram)
    return vectors * np.sqrt(np.maximum(weights, 0.0))


def _compute_log_tail(deviation: np.ndarray, degrees_of_freedom: float) -> np.ndarray:
    return (
        student(degrees_of_freedom).logsf(deviation)
        if math.isfinite(degrees_of_freedom)
        else log_ndtr(-deviation)
    )


def _sample_tail(deviation: np.ndarray, degrees_of_freedom: float, rng: np.random.Generator) -> np.ndarray:
    """Variables drawn from beyond some deviations."""
    rank = np.log(rng.uniform(size=deviation.shape)) + _compute_log_tail(deviation, degrees_of_freedom)
    out = (
        student(degrees_of_freedom).isf(np.exp(rank))
        if math.isfinite(degrees_of_freedom)
        else -ndtri_exp(rank)
    )
    # At the edge of what numbers can tell apart.
    return np.maximum(out, deviation)


def _find_degrees_of_freedom(noise: NoiseModel) -> float:
    """Fewest independent squares that told the noise of a channel; infinite where it was stated."""
    return min((channel.degrees_of_freedom for channel in noise.channels if channel), default=math.inf)


def _find_largest_mean_square(
    problem: LibraryProblem, noise: NoiseModel, estimate: MapEstimate
) -> tuple[float, float]:
    """Largest mean square of a channel's residual, and by how many standard errors it is above one."""
    residual = problem.measured - problem.predict(estimate.values)
    worst = (1.0, -math.inf)
    for c, channel in enumerate(noise.channels):
        if channel is None or not channel.stated:
            continue
        standard = noise.standardise(residual, c)[noise.rows[c]]
        mean = float(np.mean(standard**2))
        repeated = 1 + 2 * channel.ar1_fraction**2 * channel.correlation**2 / max(
            1 - channel.correlation**2, 1e-3
        )
        error = math.sqrt(2 * repeated / standard.size + SENSOR_VARIANCE_SD_SHARE**2)
        worst = max(worst, (mean, (mean - 1) / error), key=lambda pair: pair[1])
    return worst
