"""Search for small effects in addition to a large one, in a model whose residual is more than noise.

Textbook equations are not accurate to the noise of a load cell. Their misfit is smooth, and with thousands of
samples it would bias stated values and further mechanisms. Therefore the samples are first weighted by the
misfit of the model (`misfit_weighting.py`). Then further mechanisms are added if they are:

significant   beyond what the effective number of independent samples shows by chance, over all candidates
substantial   large enough a share of the remaining misfit and of the initial one
joint         together they explain most of the initial misfit, the baseline parameters are consistent
              with their priors, and no amplitude is at an extreme limit; otherwise all are dropped. They are
              also dropped if a part of the misfit stays unexplained (`run.py`).

Neglects: a misfit that differs between parts of a recording; mechanisms that are significant only
with another first mechanism.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np
from scipy.stats import chi2

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit, fit_parameters
from pamjax.diagnosis.refit.misfit_weighting import reweight_by_misfit
from pamjax.diagnosis.refit.model_fit import (
    ModelFit,
    get_free_indices,
    switch_off_candidate,
    switch_on_candidate,
)
from pamjax.diagnosis.select.mechanism_refits import (
    is_reduction_significant,
    list_addable_candidates,
    shortlist_candidates,
)
from pamjax.progress import Progress, ignore_progress


def add_small_effects(
    problem: LibraryProblem,
    fit: ModelFit,
    candidates: Sequence[Candidate],
    progress: Progress = ignore_progress,
) -> ModelFit:
    """Return the model with small effects, weighted by its misfit; unchanged if none pass the tests.

    Args:
        problem: the recording and the library.
        fit: the model of the search.
        candidates: the candidates.
        progress: called with the current step and the completed fraction.
    """
    start_fit = reweight_by_misfit(problem, fit)
    if not fit.mechanisms or start_fit.noise.weight == 1:
        return fit
    search = _SmallEffectSearch(problem, candidates, _compute_excess_mean_square(start_fit))
    extended_fit = start_fit
    while len(extended_fit.mechanisms) < problem.settings.max_mechanisms:
        progress("searching small effects", 0.7)
        better = search.find_better_fit(extended_fit)
        if better is None:
            break
        extended_fit = better
    extended_fit = search.prune(extended_fit, len(fit.mechanisms))
    added_candidates = extended_fit.mechanisms[len(fit.mechanisms) :]
    explains_enough = (
        _compute_excess_mean_square(extended_fit)
        < (1 - problem.settings.min_joint_excess_share) * search.initial_excess
    )
    return (
        extended_fit
        if explains_enough
        and is_prior_consistent(problem, extended_fit)
        and not _has_extreme_amplitude(problem, extended_fit, added_candidates)
        else fit
    )


def _compute_excess_mean_square(fit: ModelFit) -> float:
    """Return the mean squared residual above the noise, in noise variances, without misfit weights."""
    residual = fit.estimate.residual / fit.noise.weight
    return max(float(np.mean(residual**2)) - 1, 0.0)


def is_prior_consistent(problem: LibraryProblem, fit: ModelFit) -> bool:
    """Return whether the baseline parameters together are consistent with their priors."""
    baseline_indices = np.flatnonzero(problem.is_baseline & np.isfinite(problem.prior_sd))
    deviations = fit.estimate.values[baseline_indices] - problem.start[baseline_indices]
    deviations_in_sd = deviations / problem.prior_sd[baseline_indices]
    prior_chi2 = deviations_in_sd @ deviations_in_sd
    return bool(chi2.sf(prior_chi2, max(baseline_indices.size, 1)) > problem.settings.min_prior_p_value)


def _has_extreme_amplitude(
    problem: LibraryProblem, fit: ModelFit, added_candidates: Sequence[Candidate]
) -> bool:
    """Return whether an amplitude of the added candidates is at an extreme limit."""
    ends = {problem.names[fit.estimate.free[k]] for k in find_parameters_at_limit(problem, fit.estimate)}
    return any(
        name in ends
        for candidate in added_candidates
        for name in candidate.amplitudes
        if _is_amplitude_extreme(problem, fit, name)
    )


def _is_amplitude_extreme(problem: LibraryProblem, fit: ModelFit, name: str) -> bool:
    """Return whether an amplitude is far from its neutral value."""
    k = problem.index(name)
    return bool(
        abs(fit.estimate.values[k] - problem.neutral[k])
        > problem.settings.min_extreme_amplitude_share * (problem.high[k] - problem.low[k])
    )


@dataclass(frozen=True, eq=False)
class _SmallEffectSearch:
    """Constant inputs of the search for small effects.

    Attributes:
        problem: the recording and the library.
        candidates: the candidates.
        initial_excess: excess mean square of the model before the search.
    """

    problem: LibraryProblem
    candidates: Sequence[Candidate]
    initial_excess: float

    def find_better_fit(self, fit: ModelFit) -> ModelFit | None:
        """Return the model with the best further candidate, weighted anew; None if none is worthwhile."""
        candidates = list_addable_candidates(self.candidates, fit.ids)
        scores = compute_score_directions(self.problem, fit.noise, fit.estimate, candidates)
        promising = [
            s
            for s in shortlist_candidates(scores, self.problem.settings.shortlist_length)
            if self._is_significant(s.chi2_reduction, s.candidate)
        ]
        rough = sorted(
            parallel_map(partial(self._fit_with_candidate, fit), promising), key=attrgetter("bic")
        )[: self.problem.settings.final_refit_count]
        ends = sorted(parallel_map(self._refit_fully, rough), key=attrgetter("bic"))
        if not ends or not self._is_worthwhile(fit, ends[0], ends[0].mechanisms[-1]):
            return None
        return reweight_by_misfit(self.problem, ends[0])

    def prune(self, fit: ModelFit, fixed_count: int) -> ModelFit:
        """Return the model without added mechanisms that are no longer worthwhile."""
        while len(fit.mechanisms) > fixed_count:
            reduced_fits = parallel_map(
                partial(self._fit_without_mechanism, fit), range(fixed_count, len(fit.mechanisms))
            )
            k = int(np.argmin([reduced_fit.estimate.chi2_with_priors for reduced_fit in reduced_fits]))
            if self._is_worthwhile(reduced_fits[k], fit, fit.mechanisms[fixed_count + k]):
                break
            fit = reweight_by_misfit(self.problem, self._refit_fully(reduced_fits[k]))
        return fit

    def _is_worthwhile(self, reduced_fit: ModelFit, extended_fit: ModelFit, candidate: Candidate) -> bool:
        explained_excess = _compute_excess_mean_square(reduced_fit) - _compute_excess_mean_square(
            extended_fit
        )
        is_substantial = explained_excess > max(
            self.problem.settings.min_excess_share * _compute_excess_mean_square(reduced_fit),
            self.problem.settings.min_single_excess_share * self.initial_excess,
        )
        return is_substantial and self._is_significant(
            reduced_fit.estimate.chi2_with_priors - extended_fit.estimate.chi2_with_priors, candidate
        )

    def _is_significant(self, chi2_reduction: float, candidate: Candidate) -> bool:
        return is_reduction_significant(
            chi2_reduction,
            len(candidate.free_parameters),
            len(self.candidates),
            self.problem.settings.false_addition_probability,
        )

    def _fit_with_candidate(self, fit: ModelFit, direction: ScoreDirection) -> ModelFit:
        values = switch_on_candidate(
            self.problem, fit.estimate.values, direction.candidate, direction.amplitudes
        )
        return self._fit_mechanisms(
            fit, (*fit.mechanisms, direction.candidate), values, self.problem.settings.rough_evaluations
        )

    def _fit_without_mechanism(self, fit: ModelFit, k: int) -> ModelFit:
        values = switch_off_candidate(self.problem, fit.estimate.values, fit.mechanisms[k])
        return self._fit_mechanisms(
            fit,
            fit.mechanisms[:k] + fit.mechanisms[k + 1 :],
            values,
            2 * self.problem.settings.rough_evaluations,
        )

    def _refit_fully(self, fit: ModelFit) -> ModelFit:
        return ModelFit(
            fit.mechanisms,
            fit.noise,
            fit_parameters(self.problem, fit.noise, fit.estimate.free, fit.estimate.values),
        )

    def _fit_mechanisms(
        self, fit: ModelFit, mechanisms: tuple[Candidate, ...], values: np.ndarray, max_evaluations: int
    ) -> ModelFit:
        estimate = fit_parameters(
            self.problem, fit.noise, get_free_indices(self.problem, mechanisms), values, max_evaluations
        )
        return ModelFit(mechanisms, fit.noise, estimate)
