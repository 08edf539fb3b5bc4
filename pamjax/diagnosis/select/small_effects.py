"""Look on where names leave more than noise: effects that are small beside a large one.

No textbook wall is right to the noise of a load cell. What it leaves is smooth, and rows that repeat one
mistake a thousand times bend the lab's rulers and every further name to it. So such a model is weighed by
its own misfit first (`misfit_weighting.py`), and the question is asked again with what its rows are worth
then: which
further form takes away a good part of what is left?

significant   beyond what as many independent samples of the misfit as there are show by chance, over all
              forms that were tried
substantial   a fifth of the misfit that is left, and a tenth of what was left at first: no patch on a patch
together      all that join leave less than a third of what was left before, and let the lab's own numbers be
              what it believes, and none needs more than any bench has: otherwise none of them is told;
              nor where something stays unexplained beside them (`diagnose.py`)

What it leaves out: a misfit that differs between parts of a recording; names that only a different first
one would have let in.
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
from pamjax.diagnosis.refit.candidate_fit import (
    CandidateFit,
    get_free_indices,
    switch_off_candidate,
    switch_on_candidate,
)
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit, fit_parameters
from pamjax.diagnosis.refit.misfit_weighting import reweight_by_misfit
from pamjax.diagnosis.select.search import (
    FINAL_REFIT_COUNT,
    MAX_MECHANISMS,
    MIN_EXCESS_SHARE,
    ROUGH_EVALUATIONS,
    is_reduction_significant,
    shortlist_candidates,
)
from pamjax.progress import Progress, ignore_progress

#: Share of what names leave at first that all further ones must take away together, and each at least.
MIN_JOINT_EXCESS_SHARE, MIN_SINGLE_EXCESS_SHARE = 2 / 3, 0.1
#: Chance that a smooth misfit alone brings in a name, over everything that was tried; its χ² is that of so
#: few samples that a smaller one would mean nothing.
FALSE_ADDITION_PROBABILITY = 0.01
#: Chance that a lab's own statement of its muscle is as far off as a model has it.
MIN_PRIOR_P_VALUE = 0.01


def add_small_effects(
    problem: LibraryProblem,
    fit: CandidateFit,
    candidates: Sequence[Candidate],
    progress: Progress = ignore_progress,
) -> CandidateFit:
    """The model with further names, weighed by its own misfit; as it is where none are to be told.

    Args:
        problem: the recording before the library.
        fit: with the names that a search found.
        candidates: the forms that may join.
        progress: called with what is being done and the share done.
    """
    start_fit = reweight_by_misfit(problem, fit)
    if not fit.mechanisms or start_fit.noise.weight == 1:
        return fit
    search = _SmallEffectSearch(problem, candidates, compute_excess_mean_square(start_fit))
    extended_fit = start_fit
    while len(extended_fit.mechanisms) < MAX_MECHANISMS:
        progress("naming what is small", 0.7)
        better = search.find_better_fit(extended_fit)
        if better is None:
            break
        extended_fit = better
    extended_fit = search.prune(extended_fit, len(fit.mechanisms))
    added = extended_fit.mechanisms[len(fit.mechanisms) :]
    explains_enough = (
        compute_excess_mean_square(extended_fit) < (1 - MIN_JOINT_EXCESS_SHARE) * search.initial_excess
    )
    return (
        extended_fit
        if explains_enough
        and is_prior_consistent(problem, extended_fit)
        and not has_extreme_amplitude(problem, extended_fit, added)
        else fit
    )


def compute_excess_mean_square(fit: CandidateFit) -> float:
    """Mean square of what a model leaves beyond noise, in noise variances, whatever its rows are worth."""
    residual = fit.estimate.residual / fit.noise.weight
    return max(float(np.mean(residual**2)) - 1, 0.0)


def is_prior_consistent(problem: LibraryProblem, fit: CandidateFit) -> bool:
    """Whether the baseline's own numbers lie, all together, where the lab believes them."""
    baseline_indices = np.flatnonzero(problem.is_baseline & np.isfinite(problem.prior_sd))
    off = (fit.estimate.values[baseline_indices] - problem.start[baseline_indices]) / problem.prior_sd[
        baseline_indices
    ]
    return bool(chi2.sf(off @ off, max(baseline_indices.size, 1)) > MIN_PRIOR_P_VALUE)


def has_extreme_amplitude(problem: LibraryProblem, fit: CandidateFit, added: Sequence[Candidate]) -> bool:
    """Whether what some forms need is more than any bench has: an amplitude at an end of its range."""
    ends = {problem.names[fit.estimate.free[k]] for k in find_parameters_at_limit(problem, fit.estimate)}
    return any(
        name in ends
        for candidate in added
        for name in candidate.amplitudes
        if _is_amplitude_extreme(problem, fit, name)
    )


def _is_amplitude_extreme(problem: LibraryProblem, fit: CandidateFit, name: str) -> bool:
    """Whether an amplitude is not just switched off."""
    k = problem.index(name)
    return bool(abs(fit.estimate.values[k] - problem.neutral[k]) > (problem.high[k] - problem.low[k]) / 4)


@dataclass(frozen=True, eq=False)
class _SmallEffectSearch:
    """What does not change while further names are looked for.

    Attributes:
        problem: the recording before the library.
        candidates: the forms that may join.
        initial_excess: what is left of the recording before any does.
    """

    problem: LibraryProblem
    candidates: Sequence[Candidate]
    initial_excess: float

    def find_better_fit(self, fit: CandidateFit) -> CandidateFit | None:
        """The model with the best further form, weighed anew; None where none is worth its place."""
        scored = compute_score_directions(self.problem, fit.noise, fit.estimate, self.candidates)
        promising = [
            s
            for s in shortlist_candidates(scored, fit.ids)
            if self._is_significant(s.chi2_reduction, s.candidate)
        ]
        rough = sorted(
            parallel_map(partial(self._fit_with_candidate, fit), promising), key=attrgetter("bic")
        )[:FINAL_REFIT_COUNT]
        ends = sorted(parallel_map(self._refit_fully, rough), key=attrgetter("bic"))
        if not ends or not self._is_worthwhile(fit, ends[0], ends[0].mechanisms[-1]):
            return None
        return reweight_by_misfit(self.problem, ends[0])

    def prune(self, fit: CandidateFit, fixed_count: int) -> CandidateFit:
        """Without those after the first few names that are no longer worth their place."""
        while len(fit.mechanisms) > fixed_count:
            reduced_fits = parallel_map(
                partial(self._fit_without_mechanism, fit), range(fixed_count, len(fit.mechanisms))
            )
            k = int(np.argmin([reduced_fit.estimate.cost for reduced_fit in reduced_fits]))
            if self._is_worthwhile(reduced_fits[k], fit, fit.mechanisms[fixed_count + k]):
                break
            fit = reweight_by_misfit(self.problem, self._refit_fully(reduced_fits[k]))
        return fit

    def _is_worthwhile(self, reduced: CandidateFit, extended: CandidateFit, candidate: Candidate) -> bool:
        taken = compute_excess_mean_square(reduced) - compute_excess_mean_square(extended)
        substantial = taken > max(
            MIN_EXCESS_SHARE * compute_excess_mean_square(reduced),
            MIN_SINGLE_EXCESS_SHARE * self.initial_excess,
        )
        return substantial and self._is_significant(reduced.estimate.cost - extended.estimate.cost, candidate)

    def _is_significant(self, gain: float, candidate: Candidate) -> bool:
        return is_reduction_significant(
            gain, len(candidate.free_parameters), len(self.candidates), FALSE_ADDITION_PROBABILITY
        )

    def _fit_with_candidate(self, fit: CandidateFit, direction: ScoreDirection) -> CandidateFit:
        values = switch_on_candidate(
            self.problem, fit.estimate.values, direction.candidate, direction.amplitudes
        )
        return self._fit_mechanisms(fit, (*fit.mechanisms, direction.candidate), values, ROUGH_EVALUATIONS)

    def _fit_without_mechanism(self, fit: CandidateFit, k: int) -> CandidateFit:
        values = switch_off_candidate(self.problem, fit.estimate.values, fit.mechanisms[k])
        return self._fit_mechanisms(
            fit, fit.mechanisms[:k] + fit.mechanisms[k + 1 :], values, 2 * ROUGH_EVALUATIONS
        )

    def _refit_fully(self, fit: CandidateFit) -> CandidateFit:
        return CandidateFit(
            fit.mechanisms,
            fit.noise,
            fit_parameters(self.problem, fit.noise, fit.estimate.free, fit.estimate.values),
        )

    def _fit_mechanisms(
        self, fit: CandidateFit, mechanisms: tuple[Candidate, ...], values: np.ndarray, max_evaluations: int
    ) -> CandidateFit:
        estimate = fit_parameters(
            self.problem, fit.noise, get_free_indices(self.problem, mechanisms), values, max_evaluations
        )
        return CandidateFit(mechanisms, fit.noise, estimate)
