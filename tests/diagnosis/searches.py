"""Searches of all rows of a recording, and models with given mechanisms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model
from pamjax.diagnosis.select.mechanism_refits import fit_with_candidate, refit_fully
from pamjax.diagnosis.select.search import MechanismSearch
from pamjax.progress import ignore_progress


def build_search(problem: LibraryProblem) -> MechanismSearch:
    """Return the search in all rows of a recording."""
    rows = np.ones(problem.n, dtype=bool)
    baseline = fit_model(problem, rows, (), problem.neutral)
    return MechanismSearch(problem, rows, baseline, build_candidates(problem), ignore_progress)


def fit_ids(search: MechanismSearch, ids: Sequence[str]) -> ModelFit:
    """Return the model with some mechanisms, added one by one."""
    fit = search.baseline
    for id in ids:
        directions = [s for s in search.score_candidates(fit) if s.candidate.id == id]
        trials = sorted((fit_with_candidate(search.problem, fit, s) for s in directions), key=lambda m: m.bic)
        fit = refit_fully(search.problem, trials[:3])[0]
    return search.refit(fit)
