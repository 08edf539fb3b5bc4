"""One global p-value of a residual over all tested directions.

The K directions are the score direction of every candidate and the shift of every subset of the recording.
They are whitened unit vectors, without the part that the baseline's parameters absorb. If the baseline is
right, the residual along each is a standard normal variable, with the correlations of the directions. For an
amplitude that cannot be negative only the positive side counts. The noise is estimated from the recording, so
the standard deviations σ are uncertain too. The p-value is the probability that the largest deviation reaches
the observed d, a union of events:

    P = Σ_jk w_j s_k Q(d / σ_jk) · E[1 / N],

summed over noise levels j with weight w and directions k with s sides. Noise and direction are drawn in
proportion to their term, and the deviation along that direction from its tail beyond d. N is the number of
all K directions beyond d. The mean square of the residual is tested in addition, for misfit without a
direction (`mean_square.py`). It gets the part `mean_square_level_share` of the significance level.
Source: probability of a union by sampling its events, R. M. Karp, M. Luby & N. Madras, J. Algorithms 10, 429
(1989).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtri_exp, softmax
from scipy.stats import norm
from scipy.stats import t as student

from pamjax.diagnosis.detect.mean_square import compute_mean_square_significance
from pamjax.diagnosis.detect.score_test import NuisanceProjection, ScoreDirection
from pamjax.diagnosis.detect.tested_subsets import compute_subset_shifts
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.uncertainty import NORMAL_NODES, NoiseUncertainty, estimate_noise_uncertainty
from pamjax.diagnosis.refit.least_squares import MapEstimate
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.noise_model import NoiseModel

#: Largest size of the array of random numbers in one batch.
_MAX_NUMBERS_PER_BATCH = 10**6


@dataclass(frozen=True)
class ResidualTest:
    """Result of the test of a residual against noise.

    Attributes:
        p_value: global p-value of the largest deviation, over all directions.
        largest_deviation: largest deviation in standard deviations, reduced where its noise is uncertain.
        direction_count: number of tested directions.
        mean_square: mean squared residual over the noise variance, of the channel in which it exceeds 1 most
            significantly; 1 for pure noise.
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
) -> ResidualTest:
    """Return the test of a refit's residual against noise.

    Args:
        problem: the recording and the library.
        noise: noise model of the refit.
        estimate: the refit.
        score_directions: score directions of the tested candidates.
        seed: seed of the random draws.
    """
    projection = NuisanceProjection(estimate)
    score_directions = [
        score_direction for score_direction in score_directions if score_direction.unit_vectors.size
    ]
    subset_shifts = _normalise_rows(projection.remove_from(compute_subset_shifts(problem, noise)))
    directions = np.concatenate(
        [*(score_direction.unit_vectors for score_direction in score_directions), subset_shifts]
    )
    is_two_sided = np.concatenate(
        [*(s.is_two_sided for s in score_directions), np.ones(len(subset_shifts), dtype=bool)]
    )
    has_direction = np.linalg.norm(directions, axis=1) > 0.5
    directions, is_two_sided = directions[has_direction], is_two_sided[has_direction]
    projections = directions[:, : estimate.residual.size] @ estimate.residual
    uncertainty = estimate_noise_uncertainty(noise, directions, problem.settings)
    largest = float(
        np.max(_compute_deviation(projections, is_two_sided) / _compute_sd_bound(uncertainty), initial=0.0)
    )
    p = _estimate_tail_probability(
        directions @ directions.T,
        largest,
        uncertainty,
        _find_degrees_of_freedom(noise),
        seed,
        is_two_sided,
        problem.settings.significance_draws,
    )
    mean_square, mean_square_p = compute_mean_square_significance(problem, noise, estimate)
    p_value = min(
        p / (1 - problem.settings.mean_square_level_share),
        mean_square_p / problem.settings.mean_square_level_share,
        1.0,
    )
    return ResidualTest(float(max(p_value, 1e-300)), largest, len(directions), mean_square)


def _normalise_rows(rows: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    # A direction that the parameters absorb almost completely is not tested.
    return np.where(norms > 1e-6, rows / np.where(norms > 0, norms, 1.0), 0.0)


def _compute_deviation(projections: np.ndarray, is_two_sided: np.ndarray | bool) -> np.ndarray:
    """Return the deviations; of a one-sided direction a negative value stays negative."""
    return np.where(is_two_sided, np.abs(projections), projections)


def _compute_sd_bound(uncertainty: NoiseUncertainty) -> np.ndarray:
    """Return the divisor of each deviation: its standard deviation at the upper end of the uncertainty.

    Without it, a direction with uncertain noise would hide deviations of directions with known noise.
    """
    ends = uncertainty.variance_by_channel[..., [int(np.argmin(abs(NORMAL_NODES - z))) for z in (-2.0, 2.0)]]
    return np.sqrt(np.maximum(uncertainty.known_variance + ends.max(axis=2).sum(axis=1), 1.0))


def _estimate_tail_probability(
    gram: np.ndarray,
    largest: float,
    uncertainty: NoiseUncertainty,
    degrees_of_freedom: float = math.inf,
    seed: int = 0,
    is_two_sided: np.ndarray | bool = True,
    draws: int = DEFAULT_SETTINGS.significance_draws,
) -> float:
    """Return the probability that the largest of correlated normal variables reaches a value.

    Their standard deviations are uncertain, and each variable is divided by its bound (`_compute_sd_bound`).
    If the noise was estimated with few degrees of freedom, they are Student's t variables.
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
    # All in logarithms: a tail probability can be smaller than the smallest floating-point number.
    part = (weight - logsumexp(weight))[:, None] + np.log(1.0 + is_two_sided)
    part += _compute_log_tail(largest / np.maximum(sigma, 1e-300), degrees_of_freedom)
    flat_index = rng.choice(part.size, draws, p=softmax(part).ravel())
    node, k = np.unravel_index(flat_index, part.shape)
    sign = np.where(is_two_sided[k], rng.choice([-1.0, 1.0], draws), 1.0)
    deviations = sign * _sample_tail(largest / sigma[node, k], degrees_of_freedom, rng)
    # All t variables share one variance estimate: draw it given one of the variables.
    square = (
        rng.chisquare(degrees_of_freedom + 1, draws) / (degrees_of_freedom + deviations**2)
        if degrees_of_freedom < math.inf
        else np.ones(draws)
    )
    root, inverse_counts = _compute_square_root(gram), np.empty(draws)
    for batch in np.array_split(
        np.arange(draws),
        draws * len(gram) // _MAX_NUMBERS_PER_BATCH + 1,
    ):
        scale = np.sqrt(square[batch])[:, None]
        variables = _sample_conditional(gram, root, k[batch], deviations[batch] * scale[:, 0], rng) / scale
        is_beyond = _compute_deviation(sigma[node[batch]] * variables, is_two_sided) >= largest
        # In spite of rounding, the drawn direction always counts.
        inverse_counts[batch] = 1 / np.maximum(np.count_nonzero(is_beyond, axis=1), 1)
    log_probability = float(np.asarray(logsumexp(part))) + math.log(float(inverse_counts.mean()))
    return float(np.clip(math.exp(min(log_probability, 0.0)), 1e-300, 1.0))


def _sample_conditional(
    gram: np.ndarray, root: np.ndarray, k: np.ndarray, deviations: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return draws of correlated standard normal variables, (m, K), with a given value of the k-th."""
    sample = rng.standard_normal((k.size, len(gram))) @ root.T
    return sample + gram[k] * (deviations - sample[np.arange(k.size), k])[:, None]


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
    """Return draws of variables from the tails beyond some deviations."""
    rank = np.log(rng.uniform(size=deviation.shape)) + _compute_log_tail(deviation, degrees_of_freedom)
    out = (
        student(degrees_of_freedom).isf(np.exp(rank))
        if math.isfinite(degrees_of_freedom)
        else -ndtri_exp(rank)
    )
    # Rounding must not move a variable below its limit.
    return np.maximum(out, deviation)


def _find_degrees_of_freedom(noise: NoiseModel) -> float:
    """Return the lowest degrees of freedom of a channel's noise estimate; infinite if all are stated."""
    return min((channel.degrees_of_freedom for channel in noise.by_channel if channel), default=math.inf)
