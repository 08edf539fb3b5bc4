"""Choice between the forms of a mechanism: its equation with one refinement or another.

A search adds a mechanism in the form with the largest score. The score is linear, and belongs to the model
before the addition. In the model with the mechanism, another form can fit better. A wrong form leaves a
misfit, which other mechanisms would explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_refits import (
    compute_rough_limit,
    fit_with_candidate,
    fit_without_mechanism,
    refit_fully,
)


def choose_forms(problem: LibraryProblem, fit: ModelFit, candidates: Sequence[Candidate]) -> ModelFit:
    """Return the model with each mechanism in its form with the lowest BIC, with the same noise.

    Args:
        problem: the recording and the library.
        fit: the model.
        candidates: all candidates of the problem.
    """
    for id in fit.ids:
        k = fit.ids.index(id)
        reduced_fit = fit_without_mechanism(problem, fit, k)
        trials = parallel_map(
            partial(fit_with_candidate, problem, reduced_fit),
            _score_other_forms(problem, reduced_fit, fit.mechanisms[k], candidates),
        )
        limit = compute_rough_limit(reduced_fit, fit)
        refits = refit_fully(problem, [trial for trial in trials if trial.bic < limit])
        if refits and refits[0].bic < fit.bic:
            fit = refits[0]
    return fit


def _score_other_forms(
    problem: LibraryProblem, reduced_fit: ModelFit, mechanism: Candidate, candidates: Sequence[Candidate]
) -> list[ScoreDirection]:
    """Return the best start of each other form of a mechanism, at the model without it."""
    other_forms = [
        candidate
        for candidate in candidates
        if candidate.id == mechanism.id and set(candidate.free_parameters) != set(mechanism.free_parameters)
    ]
    best: dict[frozenset[str], ScoreDirection] = {}
    for direction in compute_score_directions(problem, reduced_fit.noise, reduced_fit.estimate, other_forms):
        form = frozenset(direction.candidate.free_parameters)
        if form not in best or direction.chi2_reduction > best[form].chi2_reduction:
            best[form] = direction
    return list(best.values())
