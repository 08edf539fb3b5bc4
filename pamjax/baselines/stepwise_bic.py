"""Stepwise selection of mechanisms by BIC with independent noise: common practice, for comparison.

Samples are treated as independent. Mechanisms are added one at a time while Schwarz's criterion

    BIC = n ln(χ² / n) + k ln n

decreases, with k fitted parameters. The library, its derivatives, priors and limits are those of a diagnosis.
The differences are the noise model, no correction for the number of tested candidates, and no other
criterion than BIC.

The rows are those of the diagnosis' own fit. Another standard method, a Gaussian process on the residual of
the baseline, is in `gaussian_process.py`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.least_squares import MapEstimate, fit_parameters
from pamjax.diagnosis.refit.model_fit import switch_on_candidate
from pamjax.diagnosis.select.mechanism_refits import list_addable_candidates, shortlist_candidates
from pamjax.infer.noise.noise_model import NoiseModel

#: Largest number of mechanisms, refits in each step, and evaluations of a refit.
_MAX_STEPWISE_MECHANISMS, _TRIALS_PER_STEP, _STEPWISE_EVALUATIONS = 6, 2, 15


@dataclass(frozen=True, eq=False)
class StepwiseSelection:
    """Mechanisms selected by BIC with independent noise.

    Attributes:
        ids: ids in the order of selection.
        force: (n,) predicted force, N.
    """

    ids: tuple[str, ...]
    force: np.ndarray


def select_by_bic(problem: LibraryProblem, training_mask: np.ndarray) -> StepwiseSelection:
    """Select mechanisms by forward selection with BIC and independent noise.

    Args:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fit.
    """
    candidates = build_candidates(problem)
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    noise = _remove_correlation(estimate_noise(problem, problem.neutral, training_mask))
    estimate = fit_parameters(problem, noise, baseline_indices, problem.neutral)
    noise = _remove_correlation(estimate_noise(problem, estimate.values, training_mask))
    estimate = fit_parameters(problem, noise, baseline_indices, estimate.values)
    mechanisms: list[Candidate] = []
    while len(mechanisms) < _MAX_STEPWISE_MECHANISMS:
        addable = list_addable_candidates(candidates, [candidate.id for candidate in mechanisms])
        score_directions = compute_score_directions(problem, noise, estimate, addable)
        shortlist = shortlist_candidates(score_directions, _TRIALS_PER_STEP)
        trials = [
            (s.candidate, _fit_with_candidate(problem, noise, estimate, baseline_indices, mechanisms, s))
            for s in shortlist
        ]
        candidate, best_estimate = min(trials, key=lambda pair: pair[1].chi2)
        if compute_bic(best_estimate.chi2, noise.size, len(best_estimate.free)) >= compute_bic(
            estimate.chi2, noise.size, len(estimate.free)
        ):
            break
        estimate, mechanisms = best_estimate, [*mechanisms, candidate]
    return StepwiseSelection(
        tuple(candidate.id for candidate in mechanisms), problem.predict(estimate.values)[0]
    )


def compute_bic(chi2: float, samples: int, parameters: int) -> float:
    """Return Schwarz's criterion with the maximum likelihood noise level."""
    return samples * float(np.log(chi2 / samples)) + parameters * float(np.log(samples))


def _remove_correlation(noise: NoiseModel) -> NoiseModel:
    channels = tuple(c and dataclasses.replace(c, correlation=0.0) for c in noise.by_channel)
    return dataclasses.replace(noise, by_channel=channels)


def _fit_with_candidate(
    problem: LibraryProblem,
    noise: NoiseModel,
    estimate: MapEstimate,
    baseline_indices,
    mechanisms,
    direction: ScoreDirection,
) -> MapEstimate:
    start = switch_on_candidate(problem, estimate.values, direction.candidate, direction.amplitudes)
    names = [name for candidate in (*mechanisms, direction.candidate) for name in candidate.free_parameters]
    free = sorted({*baseline_indices, *(problem.index(name) for name in names)})
    return fit_parameters(problem, noise, free, start, _STEPWISE_EVALUATIONS)
