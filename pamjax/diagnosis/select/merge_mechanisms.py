"""Replacement of two mechanisms by one.

Two wrong mechanisms often imitate one: rubber and a force offset, for example, imitate jammed threads. Every
two mechanisms of a model are therefore replaced by one other mechanism. The smaller model is better if its
BIC with form errors is lower. It is refitted with the noise of the larger one.
"""

from __future__ import annotations

from functools import partial
from itertools import chain, combinations

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_refits import (
    fit_with_candidate,
    fit_without_mechanisms,
    refit_fully,
    shortlist_candidates,
)
from pamjax.diagnosis.select.search import MechanismSearch


def merge_mechanisms(search: MechanismSearch, fit: ModelFit) -> ModelFit:
    """Return the model with one mechanism in the place of two, where that is better.

    Args:
        search: inputs of the search.
        fit: result of the search.
    """
    while len(fit.mechanisms) > 1:
        pairs = combinations(range(len(fit.mechanisms)), 2)
        trials = chain.from_iterable(parallel_map(partial(_fit_in_place_of_two, search, fit), pairs))
        best = min(trials, key=search.compute_bic, default=fit)
        if search.compute_bic(best) >= search.compute_bic(fit):
            break
        fit = search.refit(best)
    return fit


def _fit_in_place_of_two(
    search: MechanismSearch, fit: ModelFit, positions: tuple[int, int]
) -> list[ModelFit]:
    """Return the most promising models with another mechanism in the place of two."""
    reduced_fit = fit_without_mechanisms(search.problem, fit, positions)
    directions = [s for s in search.score_candidates(reduced_fit) if s.candidate.id not in fit.ids]
    trials = parallel_map(
        partial(fit_with_candidate, search.problem, reduced_fit),
        shortlist_candidates(directions, search.settings.rivals_refitted),
    )
    best = sorted(trials, key=lambda trial: trial.bic)[: search.settings.final_refit_count]
    return refit_fully(search.problem, best)
