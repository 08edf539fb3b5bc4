"""Replacement of two, one or no mechanism by a pair of mechanisms.

A stepwise search detects a wrong first mechanism only if the residual is large. Two wrong mechanisms often
leave a small residual: bladder and friction imitate a wrong gain and an offset of a sensor to a tenth of
the noise. Therefore every two mechanisms are replaced together. If the residual exceeds the noise, one and
none are replaced as well. Of three effects, a search may have identified one and a substitute for the other
two. In the linear approximation the reduction of χ² by all pairs of candidates a, b follows from the score
directions d and the residual r,

    Δχ²(a, b) = yᵀ G⁻¹ y,     y = D r,     G = D Dᵀ,     D = (d_a, d_b).

The best pairs are refitted. The search continues from a pair whose BIC, with form errors, is clearly lower
than that of the model, and its result replaces the model. If the residual was large, or if there are more
mechanisms than before, the result must leave little more than noise.
Neglects: limits of amplitudes before the refit; replacement of three mechanisms by three.
Source: least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, combinations

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, stack_residual
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import (
    ModelFit,
    get_free_indices,
    switch_on_candidate,
)
from pamjax.diagnosis.select.mechanism_refits import build_rough_fit, fit_without_mechanisms
from pamjax.diagnosis.select.search import MechanismSearch, prune_mechanisms, search_mechanisms
from pamjax.model.registry import EXCLUSIVE_PAIRS
from pamjax.progress import ignore_progress


def swap_pairs(search: MechanismSearch, fit: ModelFit) -> ModelFit:
    """Return the model after replacement by pairs.

    Args:
        search: inputs of the search.
        fit: result of the search.
    """
    for _ in range(search.settings.pair_swap_rounds if fit.mechanisms else 0):
        search.progress("testing pairs", 0.7)
        better = _find_better_pair(replace(search, progress=ignore_progress), fit)
        if better is None:
            break
        fit = better
    return fit


def _find_better_pair(search: MechanismSearch, fit: ModelFit) -> ModelFit | None:
    """Return the model with a pair in the place of others, if its BIC is clearly lower; else None."""
    # Without stated noise, enough mechanisms can explain any residual.
    is_noise_stated = all(channel is None or channel.is_stated for channel in fit.noise.by_channel)
    removed_counts = range(3) if is_noise_stated and not search.leaves_only_noise(fit) else (2,)
    positions = chain.from_iterable(
        combinations(range(len(fit.mechanisms)), count) for count in removed_counts
    )
    trials = chain.from_iterable(parallel_map(partial(_fit_pair_replacements, search, fit), positions))
    promising = sorted(trials, key=lambda trial: trial.bic)[: search.settings.final_refit_count]
    limit = search.compute_bic(fit) - search.settings.tie_chi2
    refits = parallel_map(search.refit, promising)
    better = [refit for refit in refits if search.compute_bic(refit) < limit]
    results = [
        result
        for refit, result in zip(better, parallel_map(partial(_finish_search, search), better), strict=True)
        if search.compute_bic(result) < limit
        and _is_acceptable(
            search, fit, result, has_more_mechanisms=len(refit.mechanisms) > len(fit.mechanisms)
        )
    ]
    return min(results, key=search.compute_bic, default=None)


def _is_acceptable(
    search: MechanismSearch, fit: ModelFit, result: ModelFit, *, has_more_mechanisms: bool
) -> bool:
    """Return whether a pair is accepted.

    Many pairs can absorb unmodelled physics. If the residual was large, or there are more mechanisms than
    before, the pair must leave little more than noise.
    """
    if has_more_mechanisms or search.leaves_large_residual(fit):
        return search.is_complete(result, fit) or search.leaves_only_noise(result)
    return not search.leaves_large_residual(result)


def _finish_search(search: MechanismSearch, start_fit: ModelFit) -> ModelFit:
    """Return the result of a search from a fit; small effects stay if the residual is only noise."""
    result = search_mechanisms(search, start_fit)
    if not search.leaves_only_noise(start_fit):
        return result
    complete = prune_mechanisms(search, start_fit, may_be_small=True)
    is_better = search.leaves_only_noise(complete) and (
        search.compute_bic(complete) < search.compute_bic(result)
    )
    return complete if is_better else result


def _fit_pair_replacements(
    search: MechanismSearch, fit: ModelFit, positions: tuple[int, ...]
) -> list[ModelFit]:
    """Return models with a pair in the place of some mechanisms, roughly refitted."""
    if len(fit.mechanisms) - len(positions) + 2 > search.settings.max_mechanisms:
        return []
    problem = search.problem
    reduced_fit = fit_without_mechanisms(problem, fit, positions)
    scores = search.score_candidates(reduced_fit)
    removed_ids = frozenset(fit.mechanisms[k].id for k in positions)
    pairs = rank_pairs(
        scores,
        reduced_fit,
        stack_residual(problem, reduced_fit.estimate),
        search.settings.same_pair_chi2_share,
    )
    new_pairs = (pair for pair in pairs if frozenset(s.candidate.id for s, _ in pair) != removed_ids)
    return [
        _fit_with_pair(problem, reduced_fit, pair)
        for pair, _ in zip(new_pairs, range(search.settings.pairs_refitted), strict=False)
    ]


def rank_pairs(
    directions: Sequence[ScoreDirection],
    fit: ModelFit,
    residual: np.ndarray,
    same_pair_chi2_share: float,
) -> Iterator[tuple[tuple[ScoreDirection, np.ndarray], tuple[ScoreDirection, np.ndarray]]]:
    """Yield pairs of mechanisms with their amplitudes, SI, largest reduction of χ² first.

    Args:
        directions: score directions of the candidates that can be added to the model.
        fit: the model.
        residual: (size + priors,) its residual and the deviations of its parameters from their priors.
        same_pair_chi2_share: difference below which two pairs with a common mechanism count as the same.
    """
    rows = np.concatenate([s.unit_vectors for s in directions])
    ends = np.cumsum([len(s.unit_vectors) for s in directions])
    projections, gram, bic_penalty = rows @ residual, rows @ rows.T, np.log(max(fit.noise.sample_count, 2))
    ranked_pairs = []
    for a, b in combinations(range(len(directions)), 2):
        if directions[a].candidate.id == directions[b].candidate.id or _is_excluded(
            directions[a].candidate, [directions[b].candidate]
        ):
            continue
        rows_of_pair = np.r_[
            ends[a] - len(directions[a].unit_vectors) : ends[a],
            ends[b] - len(directions[b].unit_vectors) : ends[b],
        ]
        amplitudes = np.linalg.lstsq(
            gram[np.ix_(rows_of_pair, rows_of_pair)], projections[rows_of_pair], rcond=1e-9
        )[0]
        pair_penalty = bic_penalty * (
            len(directions[a].candidate.free_parameters) + len(directions[b].candidate.free_parameters)
        )
        ranked_pairs.append((float(projections[rows_of_pair] @ amplitudes) - pair_penalty, a, b, amplitudes))
    reported_pairs: list[tuple[float, set[str]]] = []
    for reduction, a, b, amplitudes in sorted(ranked_pairs, key=lambda ranked_pair: -ranked_pair[0]):
        ids = {directions[a].candidate.id, directions[b].candidate.id}
        if not any(
            ids == other_ids
            or (ids & other_ids and other_reduction - reduction < same_pair_chi2_share * other_reduction)
            for other_reduction, other_ids in reported_pairs
        ):
            reported_pairs.append((reduction, ids))
            amplitude_count = len(directions[a].unit_vectors)
            yield (
                (directions[a], amplitudes[:amplitude_count] / directions[a].norm),
                (directions[b], amplitudes[amplitude_count:] / directions[b].norm),
            )


def _is_excluded(candidate: Candidate, others: Sequence[Candidate]) -> bool:
    return any(frozenset({candidate.id, other.id}) in EXCLUSIVE_PAIRS for other in others)


def _fit_with_pair(
    problem: LibraryProblem, fit: ModelFit, pair: Sequence[tuple[ScoreDirection, np.ndarray]]
) -> ModelFit:
    """Return the model with a further pair, roughly refitted with the same noise."""
    mechanisms, values = (*fit.mechanisms, *(s.candidate for s, _ in pair)), fit.estimate.values
    for direction, amplitudes in pair:
        values = switch_on_candidate(problem, values, direction.candidate, amplitudes)
    free = get_free_indices(problem, mechanisms)
    evaluations = 2 * problem.settings.rough_evaluations
    estimate = fit_parameters(problem, fit.noise, free, values, evaluations, is_rough=True)
    return build_rough_fit(problem, mechanisms, fit.noise, estimate)
