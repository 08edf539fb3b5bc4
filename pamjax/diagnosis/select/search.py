"""Stepwise search for mechanisms: add, refit, replace, and remove.

A candidate that is added must pass three tests:

significant   its reduction of χ² is improbable for noise, over all candidates
substantial   it explains a large part of the remaining misfit: textbook equations are not accurate to the
              noise, and the small residual of a large effect is no second effect
sizeable      the misfit that it alone explains is not small relative to that of the baseline, or it explains
              all of the remaining misfit

All three tests allow for the form errors of the mechanisms that are in the model already. At the end, each
mechanism is tested again. It stays if it passes with the form errors of the others, or without them.

The limit of the third test is smaller if small effects together leave only noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import ModelFit, build_corrected_fit, fit_model
from pamjax.diagnosis.select.mechanism_forms import choose_forms
from pamjax.diagnosis.select.mechanism_refits import (
    compute_rough_limit,
    fit_replacements,
    fit_with_candidate,
    fit_without_mechanism,
    is_reduction_significant,
    list_addable_candidates,
    refit_most_promising,
    shortlist_candidates,
)
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.progress import Progress


@dataclass(frozen=True, eq=False)
class MechanismSearch:
    """Constant inputs of a search, with its tests.

    Attributes:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fit.
        baseline: refit of the baseline.
        candidates: the candidates.
        progress: called with the current step and the completed fraction.
    """

    problem: LibraryProblem
    training_mask: np.ndarray
    baseline: ModelFit
    candidates: Sequence[Candidate]
    progress: Progress

    @property
    def settings(self) -> DiagnosisSettings:
        """Return the thresholds of the diagnosis."""
        return self.problem.settings

    def score_candidates(self, fit: ModelFit) -> list[ScoreDirection]:
        """Return the score directions at a fit of all candidates that can be added to it."""
        candidates = list_addable_candidates(self.candidates, fit.ids)
        return compute_score_directions(self.problem, fit.noise, fit.estimate, candidates)

    def refit(self, fit: ModelFit) -> ModelFit:
        """Return the fit, refitted with noise from its own residual."""
        return fit_model(self.problem, self.training_mask, fit.mechanisms, fit.estimate.values)

    def compute_bic(self, fit: ModelFit) -> float:
        """Return the BIC of a model with the form errors of its mechanisms."""
        return add_form_errors(self.problem, fit).full_bic

    def is_worthwhile(
        self,
        reduced_fit: ModelFit,
        extended_fit: ModelFit,
        may_be_small: bool,
        candidate: Candidate | None = None,
    ) -> bool:
        """Return whether a candidate is significant, substantial and sizeable.

        The limit of the size is smaller with `may_be_small`.

        Args:
            reduced_fit: the model without it.
            extended_fit: the model with it.
            may_be_small: whether it may be small relative to the misfit of the baseline.
            candidate: the candidate; the last of `extended_fit` if omitted.
        """
        chi2_reduction, samples = (
            reduced_fit.corrected_chi2 - extended_fit.corrected_chi2,
            self.baseline.noise.sample_count,
        )
        explained_mean_square, baseline_excess = chi2_reduction / samples, self.baseline.excess_chi2 / samples
        is_sizeable = (
            explained_mean_square
            > (self.settings.min_small_rms_share if may_be_small else self.settings.min_rms_share) ** 2
            * baseline_excess
        )
        is_sizeable = is_sizeable or (
            not may_be_small
            and chi2_reduction > self.settings.complete_excess_share * reduced_fit.excess_chi2
        )
        is_substantial = (
            chi2_reduction > self.settings.min_excess_share * reduced_fit.excess_chi2
            and explained_mean_square > self.settings.min_effect_rms**2
        )
        parameter_count = len((candidate or extended_fit.mechanisms[-1]).free_parameters)
        is_significant = is_reduction_significant(
            chi2_reduction, parameter_count, len(self.candidates), self.settings.false_inclusion_probability
        )
        return is_significant and is_substantial and is_sizeable

    def is_exhausted(self, fit: ModelFit, best: ScoreDirection) -> bool:
        """Return whether the residual, in total and along the best candidate, is too small for any effect."""
        min_chi2 = self.settings.min_effect_rms**2 * fit.noise.sample_count
        return (
            fit.excess_chi2 < min_chi2
            and best.chi2_reduction < self.settings.min_direction_chi2_share * min_chi2
        )

    def is_complete(self, fit: ModelFit, other: ModelFit) -> bool:
        """Return whether a model explains nearly all excess misfit of another model, with a lower BIC.

        Both have the form errors of their mechanisms.
        """
        fit, other = add_form_errors(self.problem, fit), add_form_errors(self.problem, other)
        return (
            fit.excess_chi2 < (1 - self.settings.complete_excess_share) * other.excess_chi2
            and fit.full_bic < other.full_bic
        )

    def is_excess_noise(self, fit: ModelFit) -> bool:
        """Return whether the excess χ² of a fit is that of noise, or too small for an effect."""
        return fit.excess_chi2 < max(
            self.settings.min_effect_rms**2 * fit.noise.sample_count,
            self.settings.max_noise_chi2_sd * np.sqrt(2 * fit.noise.size),
        )

    def leaves_only_noise(self, fit: ModelFit) -> bool:
        """Return whether the excess χ² beyond form errors is that of noise, or too small for an effect."""
        return self.is_excess_noise(add_form_errors(self.problem, fit))

    def leaves_large_residual(self, fit: ModelFit) -> bool:
        """Return whether the residual beyond form errors is large, compared with noise and baseline."""
        return add_form_errors(self.problem, fit).excess_chi2 > max(
            self.settings.min_unexplained_rms**2 * fit.noise.sample_count,
            self.settings.min_unexplained_rms_share**2 * self.baseline.excess_chi2,
        )


def search_mechanisms(
    search: MechanismSearch, start: ModelFit, directions: Sequence[ScoreDirection] | None = None
) -> ModelFit:
    """Return a model with the mechanisms that explain its misfit.

    Args:
        search: inputs of the search.
        start: the model, usually the baseline.
        directions: score directions of all candidates at this model; computed if omitted.
    """
    largest_fit, refused_fit = _add_candidates(search, start, directions)
    fit = prune_mechanisms(search, largest_fit)
    if not fit.mechanisms or fit.excess_chi2 < search.settings.min_effect_rms**2 * fit.noise.sample_count:
        return fit
    if fit is largest_fit and not (
        refused_fit
        and search.is_worthwhile(add_form_errors(search.problem, fit), refused_fit, may_be_small=True)
    ):
        return fit
    # Small effects stay if the residual is then only noise.
    best = refused_fit if fit is largest_fit else None
    complete = prune_mechanisms(
        search, _add_candidates(search, fit, may_be_small=True, best=best)[0], may_be_small=True
    )
    return complete if search.is_complete(complete, fit) else fit


def _add_candidates(
    search: MechanismSearch,
    fit: ModelFit,
    directions: Sequence[ScoreDirection] | None = None,
    may_be_small: bool = False,
    best: ModelFit | None = None,
) -> tuple[ModelFit, ModelFit | None]:
    """Return the model with further mechanisms, and the best extension that is not worthwhile.

    Mechanisms are added one at a time as long as each passes the tests with the form errors of the others.
    Known score directions at the model, or its known best extension, are not computed again.
    """
    while len(fit.mechanisms) < search.settings.max_mechanisms:
        search.progress("selecting mechanisms", 0.1 + 0.1 * len(fit.mechanisms))
        form_error_fit = add_form_errors(search.problem, fit)
        best = best or fit_best_candidate(search, form_error_fit, directions)
        if best is None or not search.is_worthwhile(form_error_fit, best, may_be_small):
            return fit, best
        added = search.refit(best)
        chosen = choose_forms(search.problem, added, search.candidates)
        fit = swap_mechanisms(search, added if chosen is added else search.refit(chosen))
        directions, best = None, None
    return fit, None


def fit_best_candidate(
    search: MechanismSearch, fit: ModelFit, directions: Sequence[ScoreDirection] | None = None
) -> ModelFit | None:
    """Return the model with the best further candidate, with the same noise; None if none is promising."""
    directions = search.score_candidates(fit) if directions is None else directions
    shortlist = _list_promising(search, directions)
    if not shortlist or search.is_exhausted(fit, shortlist[0]):
        return None
    return refit_most_promising(
        search.problem, fit, parallel_map(partial(fit_with_candidate, search.problem, fit), shortlist)
    )[0]


def _list_promising(search: MechanismSearch, directions: Sequence[ScoreDirection]) -> list[ScoreDirection]:
    """Return the best candidate of each promising mechanism, if its reduction of χ² is significant."""
    return [
        s
        for s in shortlist_candidates(directions, search.settings.shortlist_length)
        if is_reduction_significant(
            s.chi2_reduction,
            len(s.candidate.free_parameters),
            len(search.candidates),
            search.settings.false_inclusion_probability,
        )
    ]


def swap_mechanisms(search: MechanismSearch, fit: ModelFit) -> ModelFit:
    """Return the fit with rivals in place of mechanisms, where they now fit better.

    The last mechanism was chosen with the noise of the model without it. The residual of that model can have
    a large misfit, which changes its noise.
    """
    # A swap changes the order of the mechanisms, but not the ids of the others.
    for id in fit.ids:
        k = fit.ids.index(id)
        reduced_fit = fit_without_mechanism(search.problem, fit, k)
        rivals = fit_replacements(search.problem, reduced_fit, fit.mechanisms[k], search.candidates)
        trials = refit_most_promising(
            search.problem,
            reduced_fit,
            [rival for rival in rivals if rival.bic < compute_rough_limit(reduced_fit, fit)],
        )
        if trials and trials[0].bic < fit.bic - search.settings.tie_chi2:
            fit = search.refit(trials[0])
    return fit


def prune_mechanisms(search: MechanismSearch, fit: ModelFit, may_be_small: bool = False) -> ModelFit:
    """Return the model without mechanisms that are no longer worthwhile."""
    while len(fit.mechanisms) > 1:
        reduced_fits = parallel_map(
            partial(fit_without_mechanism, search.problem, fit), range(len(fit.mechanisms))
        )
        chi2_increases = [reduced_fit.corrected_chi2 - fit.corrected_chi2 for reduced_fit in reduced_fits]
        k = int(np.argmin(chi2_increases))
        candidate = fit.mechanisms[k]
        if search.is_worthwhile(reduced_fits[k], fit, may_be_small, candidate):
            break
        if _is_worthwhile_beside_form_errors(search, reduced_fits[k], fit, may_be_small, candidate):
            break
        fit = search.refit(reduced_fits[k])
    return fit


def _is_worthwhile_beside_form_errors(
    search: MechanismSearch,
    reduced_fit: ModelFit,
    fit: ModelFit,
    may_be_small: bool,
    candidate: Candidate,
) -> bool:
    """Return whether a mechanism explains enough of what the form errors of the others leave."""
    reduced_fit = add_form_errors(search.problem, reduced_fit)
    estimate = fit_parameters(
        search.problem,
        reduced_fit.noise,
        fit.estimate.free,
        fit.estimate.values,
        search.settings.rough_evaluations,
    )
    extended_fit = build_corrected_fit(search.problem, fit.mechanisms, reduced_fit.noise, estimate)
    return search.is_worthwhile(reduced_fit, extended_fit, may_be_small, candidate)
