"""What common practice selects from the same library on the same recording, to compare with.

Samples count as independent, mechanisms are added one at a time while Schwarz's criterion

    BIC = n ln(χ² / n) + k ln n

falls, with k numbers fitted. The library, its derivatives, priors and limits are pamjax's own: what differs
is the noise model, that nothing accounts for how many forms were tried, and that nothing is asked of a name
but that BIC falls.

It sees the rows that pamjax's own fit sees. The other common practice, a flexible curve on what the baseline
leaves, is in `gaussian_process.py`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import NoiseModel, estimate_noise
from pamjax.diagnosis.refit.candidate_fit import switch_on_candidate
from pamjax.diagnosis.refit.least_squares import MapEstimate, fit_parameters
from pamjax.diagnosis.select.search import shortlist_candidates

#: Most names; how many mechanisms are refitted at each step, and evaluations of such a refit.
MAX_STEPWISE_MECHANISMS, TRIALS_PER_STEP, STEPWISE_EVALUATIONS = 6, 2, 15


@dataclass(frozen=True, eq=False)
class StepwiseSelection:
    """What independent noise and BIC select.

    Attributes:
        ids: in the order in which they came.
        force: (n,) what it predicts, N.
    """

    ids: tuple[str, ...]
    force: np.ndarray


def select_by_bic(problem: LibraryProblem, training_rows: np.ndarray) -> StepwiseSelection:
    """Forward selection by BIC under independent noise.

    Args:
        problem: the recording before the library.
        training_rows: (n,) the rows that may be looked at.
    """
    candidates = build_candidates(problem)
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    noise = _remove_correlation(estimate_noise(problem, problem.neutral, training_rows))
    estimate = fit_parameters(problem, noise, baseline_indices, problem.neutral)
    noise = _remove_correlation(estimate_noise(problem, estimate.values, training_rows))
    estimate = fit_parameters(problem, noise, baseline_indices, estimate.values)
    mechanisms: list[Candidate] = []
    while len(mechanisms) < MAX_STEPWISE_MECHANISMS:
        scored = compute_score_directions(problem, noise, estimate, candidates)
        promising = shortlist_candidates(scored, [candidate.id for candidate in mechanisms], TRIALS_PER_STEP)
        trials = [
            (s.candidate, _fit_with_candidate(problem, noise, estimate, baseline_indices, mechanisms, s))
            for s in promising
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
    """Schwarz's criterion with the noise level profiled out."""
    return samples * float(np.log(chi2 / samples)) + parameters * float(np.log(samples))


def _remove_correlation(noise: NoiseModel) -> NoiseModel:
    channels = tuple(c and dataclasses.replace(c, correlation=0.0) for c in noise.channels)
    return dataclasses.replace(noise, channels=channels)


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
    return fit_parameters(problem, noise, free, start, STEPWISE_EVALUATIONS)
