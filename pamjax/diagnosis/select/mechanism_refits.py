"""Refits of a model with one mechanism more, one less, or another one in its place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2
from pamjax.diagnosis.refit.least_squares import MapEstimate, fit_parameters
from pamjax.diagnosis.refit.memoise import memoise_per_fit
from pamjax.diagnosis.refit.model_fit import (
    ModelFit,
    build_corrected_fit,
    get_free_indices,
    switch_off_candidate,
    switch_on_candidate,
)
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.model.registry import EXCLUSIVE_PAIRS


def is_reduction_significant(
    chi2_reduction: float, parameter_count: int, candidate_count: int, significance_level: float
) -> bool:
    """Return whether a reduction of χ² is improbable for noise, over all tested candidates."""
    return bool(
        chi2_reduction > 0 and candidate_count * chi2.sf(chi2_reduction, parameter_count) < significance_level
    )


def list_addable_candidates(candidates: Sequence[Candidate], mechanism_ids: Sequence[str]) -> list[Candidate]:
    """Return the candidates that can be added to some mechanisms."""
    excluded_ids = {
        *mechanism_ids,
        *(id for pair in EXCLUSIVE_PAIRS if pair & set(mechanism_ids) for id in pair),
    }
    return [candidate for candidate in candidates if candidate.id not in excluded_ids]


def shortlist_candidates(directions: Sequence[ScoreDirection], count: int) -> list[ScoreDirection]:
    """Return the best candidate of each of the most promising mechanisms."""
    best: dict[str, ScoreDirection] = {}
    for direction in directions:
        id = direction.candidate.id
        if id not in best or direction.chi2_reduction > best[id].chi2_reduction:
            best[id] = direction
    return sorted(best.values(), key=lambda s: -s.chi2_reduction)[:count]


def fit_with_candidate(problem: LibraryProblem, fit: ModelFit, direction: ScoreDirection) -> ModelFit:
    """Return the model with one more candidate, roughly refitted with the same noise.

    This candidate may have driven parameters of the baseline to their limits. In that case a second refit
    starts from the stated values.
    """
    starts = [fit.estimate.values]
    if not fit.mechanisms and _is_far_from_priors(problem, fit):
        starts.append(problem.neutral)
    mechanisms = (*fit.mechanisms, direction.candidate)
    free = get_free_indices(problem, mechanisms)
    estimates = []
    for start in starts:
        values = switch_on_candidate(problem, start, direction.candidate, direction.amplitudes)
        estimates.append(
            fit_parameters(
                problem, fit.noise, free, values, problem.settings.rough_evaluations, is_rough=True
            )
        )
    estimate = min(estimates, key=lambda estimate: estimate.chi2_with_priors)
    return build_rough_fit(problem, mechanisms, fit.noise, estimate)


def build_rough_fit(
    problem: LibraryProblem, mechanisms: tuple[Candidate, ...], noise: NoiseModel, estimate: MapEstimate
) -> ModelFit:
    """Return a rough fit: with the expected χ² due to input noise, but no correction of its bias."""
    chi2 = compute_input_noise_chi2(problem, noise.whiten, estimate.values)
    return ModelFit(mechanisms, noise, estimate, chi2)


def _is_far_from_priors(problem: LibraryProblem, fit: ModelFit) -> bool:
    """Return whether a baseline parameter is far from its stated value."""
    stated_indices = np.flatnonzero(problem.is_baseline & np.isfinite(problem.prior_sd))
    return bool(
        np.any(
            np.abs(fit.estimate.values[stated_indices] - problem.start[stated_indices])
            > problem.settings.strained_prior_sd * problem.prior_sd[stated_indices]
        )
    )


def refit_most_promising(
    problem: LibraryProblem, reduced_fit: ModelFit, trials: Sequence[ModelFit]
) -> list[ModelFit]:
    """Return the most promising rough refits, refitted to the minimum, best first.

    `reduced_fit` is the model without the added candidate.
    """
    first = sorted(trials, key=lambda trial: trial.bic)[: problem.settings.final_refit_count]
    return refit_fully(
        problem,
        [
            trial
            for trial in first
            if trial is first[0] or trial.bic < compute_rough_limit(reduced_fit, first[0])
        ],
    )


def refit_fully(problem: LibraryProblem, rough_fits: Sequence[ModelFit]) -> list[ModelFit]:
    """Return rough refits, refitted to the minimum, best first."""

    def refit_rough(m: ModelFit) -> ModelFit:
        return build_corrected_fit(
            problem,
            m.mechanisms,
            m.noise,
            fit_parameters(problem, m.noise, m.estimate.free, m.estimate.values),
        )

    return sorted(parallel_map(refit_rough, rough_fits), key=lambda trial: trial.bic)


def compute_rough_limit(reduced_fit: ModelFit, fit: ModelFit) -> float:
    """Return the BIC below which a rough refit with a rival is refitted to the minimum."""
    return (reduced_fit.bic + fit.bic) / 2


@memoise_per_fit(lambda candidate, candidates: candidate.id)
def fit_replacements(
    problem: LibraryProblem, reduced_fit: ModelFit, candidate: Candidate, candidates: Sequence[Candidate]
) -> list[ModelFit]:
    """Return models with a rival in the place of a candidate, roughly refitted.

    Results are memoised without `candidates`: a fit belongs to one problem, which has one list of them.

    Args:
        problem: the recording and the library.
        reduced_fit: the model without the candidate.
        candidate: the candidate.
        candidates: all candidates of the problem.
    """
    addable = list_addable_candidates(candidates, reduced_fit.ids)
    rivals = [other for other in addable if other.id != candidate.id]
    scores = compute_score_directions(problem, reduced_fit.noise, reduced_fit.estimate, rivals)
    return parallel_map(
        lambda s: fit_with_candidate(problem, reduced_fit, s),
        shortlist_candidates(scores, problem.settings.rivals_refitted),
    )


def fit_without_mechanism(problem: LibraryProblem, fit: ModelFit, k: int) -> ModelFit:
    """Return the model without its k-th mechanism, refitted with the same noise."""
    return fit_without_mechanisms(problem, fit, [k])


def refit_baseline(problem: LibraryProblem, fit: ModelFit) -> ModelFit:
    """Return the baseline of a model, refitted with the noise of the model."""
    return fit_without_mechanisms(problem, fit, range(len(fit.mechanisms)))


@memoise_per_fit(lambda positions: tuple(positions))
def fit_without_mechanisms(problem: LibraryProblem, fit: ModelFit, positions: Sequence[int]) -> ModelFit:
    """Return the model without the mechanisms at some positions, refitted with the same noise."""
    remaining = tuple(m for k, m in enumerate(fit.mechanisms) if k not in positions)
    values = fit.estimate.values
    for k in positions:
        values = switch_off_candidate(problem, values, fit.mechanisms[k])
    free = get_free_indices(problem, remaining)
    return build_corrected_fit(
        problem,
        remaining,
        fit.noise,
        fit_parameters(problem, fit.noise, free, values, 2 * problem.settings.rough_evaluations),
    )
