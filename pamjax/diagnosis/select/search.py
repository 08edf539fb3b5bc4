"""Search for what explains a misfit: add, refit, look again, and try to take out again.

A form that joins must pass three questions, none of which another recording was asked to answer:

significant   the χ² it takes away is out of reach of noise, over all forms that were tried
substantial   it explains a good part of the misfit that is left: textbook forms do not fit nature to the
              noise, and the small rest of a large effect is no second effect
sizeable      what it alone can explain is not small beside the whole misfit, or is all that was left

Where forms that are small beside the whole leave nothing but noise together, textbook forms do fit here, and
the third question is not asked. A first form that was wrong leads astray: a search that ends far from the
noise begins again from the pairs that came nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np
from scipy.stats import chi2

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.residual_test import MIN_UNEXPLAINED_RMS, MIN_UNEXPLAINED_RMS_SHARE
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2
from pamjax.diagnosis.refit.candidate_fit import (
    CandidateFit,
    build_corrected_fit,
    fit_candidate,
    get_free_indices,
    switch_off_candidate,
    switch_on_candidate,
)
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.model.registry import EXCLUSIVE_PAIRS
from pamjax.progress import Progress, ignore_progress

#: Chance that noise alone brings in a name, over everything that was tried.
FALSE_INCLUSION_PROBABILITY = 1e-4
#: Share of the excess misfit that a name must explain.
MIN_EXCESS_SHARE = 0.2
#: Share of the baseline's whole misfit, as rms, that a name alone must account for ...
MIN_RMS_SHARE = 0.1
#: ... unless it accounts for so much of what is left that nothing but noise is then ...
COMPLETE_EXCESS_SHARE = 0.95
#: ... or others that are small as well do. No law is believed to be as good as this share of the whole.
MIN_SMALL_RMS_SHARE = 0.025
#: The least of it in standard deviations of a sample: textbook forms are not known better than that.
MIN_EFFECT_RMS = 0.25
#: How many mechanisms are refitted roughly at each step, how many of them to the end, and what is rough.
SHORTLIST_LENGTH, FINAL_REFIT_COUNT, ROUGH_EVALUATIONS = 6, 2, 7
#: A baseline's number farther from what the lab believes than this, in sd, was driven there.
STRAINED_PRIOR_SD = 2.5
#: Most names.
MAX_MECHANISMS = 4
#: Rivals whose fit is worse by less than this, and a share of what is left unexplained, are not told apart.
TIE_CHI2, TIE_EXCESS_SHARE = 12.0, 0.1
#: From how many pairs a search begins again, and how many seconds are tried beside each first form.
RESTART_PAIR_COUNT, SECOND_CANDIDATE_COUNT = 3, 3


@dataclass(frozen=True, eq=False)
class MechanismSearch:
    """What does not change while a recording is searched.

    Attributes:
        problem: the recording before the library.
        training_rows: (n,) the rows that may be looked at.
        baseline: its refit.
        candidates: the forms that may join.
        progress: called with what is being done and the share done.
    """

    problem: LibraryProblem
    training_rows: np.ndarray
    baseline: CandidateFit
    candidates: Sequence[Candidate]
    progress: Progress

    def score_candidates(self, fit: CandidateFit) -> list[ScoreDirection]:
        return compute_score_directions(self.problem, fit.noise, fit.estimate, self.candidates)

    def refit(self, fit: CandidateFit) -> CandidateFit:
        return fit_candidate(self.problem, self.training_rows, fit.mechanisms, fit.estimate.values)

    def is_worthwhile(
        self, reduced: CandidateFit, extended: CandidateFit, small: bool, candidate: Candidate | None = None
    ) -> bool:
        """Whether a form is significant, substantial and, unless it may be small, sizeable.

        Args:
            reduced: the model without it.
            extended: the model with it.
            small: whether it may be small beside the whole misfit.
            candidate: which, the last of `extended` by itself.
        """
        gain, samples = reduced.corrected_chi2 - extended.corrected_chi2, self.baseline.noise.size
        alone, whole = gain / samples, self.baseline.excess_chi2 / samples
        sizeable = alone > (MIN_SMALL_RMS_SHARE if small else MIN_RMS_SHARE) ** 2 * whole
        sizeable = sizeable or (not small and gain > COMPLETE_EXCESS_SHARE * reduced.excess_chi2)
        substantial = gain > MIN_EXCESS_SHARE * reduced.excess_chi2 and alone > MIN_EFFECT_RMS**2
        numbers = len((candidate or extended.mechanisms[-1]).free_parameters)
        return is_reduction_significant(gain, numbers, len(self.candidates)) and substantial and sizeable

    def is_exhausted(self, fit: CandidateFit, best: ScoreDirection) -> bool:
        """Whether too little is left, in all and along the best form, for any form to be worth its place."""
        least = MIN_EFFECT_RMS**2 * fit.noise.size
        return fit.excess_chi2 < least and best.chi2_reduction < least / 2

    def is_complete(self, fit: CandidateFit, other: CandidateFit) -> bool:
        """Whether hardly anything but noise is left of what another model leaves, and that is likelier."""
        return (
            fit.excess_chi2 < (1 - COMPLETE_EXCESS_SHARE) * other.excess_chi2
            and fit.full_bic < other.full_bic
        )

    def leaves_large_residual(self, fit: CandidateFit) -> bool:
        """Whether a model leaves much more than noise and the rough edges of forms."""
        return fit.excess_chi2 > max(
            MIN_UNEXPLAINED_RMS**2 * fit.noise.size, MIN_UNEXPLAINED_RMS_SHARE**2 * self.baseline.excess_chi2
        )


def search_mechanisms(search: MechanismSearch, directions: Sequence[ScoreDirection]) -> CandidateFit:
    """The baseline with the forms that explain what it leaves.

    Args:
        search: the recording, and what may join.
        directions: the signatures of all forms that may join, at the baseline.
    """
    fit = run_search(search, search.baseline, directions)
    if not search.leaves_large_residual(fit):
        return fit
    begins = _find_restart_pairs(search, fit, directions)
    again = replace(search, progress=ignore_progress)
    for k, begin in enumerate(begins):
        search.progress("naming again", 0.5 + 0.2 * k / len(begins))
        other = run_search(again, again.refit(begin))
        # Many pairs bend towards what is in no catalogue: only what leaves nothing but noise is believed.
        if search.is_complete(other, fit):
            fit = other
        if not search.leaves_large_residual(fit):
            break
    return fit


def run_search(
    search: MechanismSearch, begin: CandidateFit, directions: Sequence[ScoreDirection] | None = None
) -> CandidateFit:
    """Where a search ends that begins here."""
    grown, refused = _add_candidates(search, begin, directions)
    fit = prune_mechanisms(search, grown)
    if not fit.mechanisms or fit.excess_chi2 < MIN_EFFECT_RMS**2 * fit.noise.size:
        return fit
    if fit is grown and not (refused and search.is_worthwhile(fit, refused, small=True)):
        return fit
    # What is small beside the whole may stay if nothing but noise is left then.
    best = refused if fit is grown else None
    whole = prune_mechanisms(search, _add_candidates(search, fit, small=True, best=best)[0], small=True)
    return whole if search.is_complete(whole, fit) else fit


def _add_candidates(
    search: MechanismSearch,
    fit: CandidateFit,
    directions: Sequence[ScoreDirection] | None = None,
    small: bool = False,
    best: CandidateFit | None = None,
) -> tuple[CandidateFit, CandidateFit | None]:
    """The model with further forms, one at a time, as long as each is worth it; and the best that was not.

    Signatures at the model, or the best model with one form more, need not be found twice.
    """
    while len(fit.mechanisms) < MAX_MECHANISMS:
        search.progress("naming", 0.1 + 0.1 * len(fit.mechanisms))
        best = best or _fit_best_candidate(
            search, fit, search.score_candidates(fit) if directions is None else directions
        )
        if best is None or not search.is_worthwhile(fit, best, small):
            return fit, best
        fit, directions, best = _swap_mechanisms(search, search.refit(best)), None, None
    return fit, None


def _fit_best_candidate(
    search: MechanismSearch, fit: CandidateFit, directions: Sequence[ScoreDirection]
) -> CandidateFit | None:
    """The model with the best further form, not settled; None where none could be worth its place."""
    listed = _list_promising(search, fit, directions)
    if not listed or search.is_exhausted(fit, listed[0]):
        return None
    return refit_most_promising(
        search.problem, fit, parallel_map(partial(_fit_with_candidate, search.problem, fit), listed)
    )[0]


def _list_promising(
    search: MechanismSearch,
    fit: CandidateFit,
    directions: Sequence[ScoreDirection],
    many: int = SHORTLIST_LENGTH,
) -> list[ScoreDirection]:
    tried = len(search.candidates)
    return [
        s
        for s in shortlist_candidates(directions, fit.ids, many)
        if is_reduction_significant(s.chi2_reduction, len(s.candidate.free_parameters), tried)
    ]


def _swap_mechanisms(search: MechanismSearch, fit: CandidateFit) -> CandidateFit:
    """Put another in the place of an earlier form where that fits better now."""
    for k in range(len(fit.mechanisms) - 1):
        reduced_fit = fit_without_mechanism(search.problem, fit, k)
        rivals = fit_replacements(search.problem, reduced_fit, fit.mechanisms[k], search.candidates)
        trials = refit_most_promising(
            search.problem,
            reduced_fit,
            [rival for rival in rivals if rival.bic < compute_rough_limit(reduced_fit, fit)],
        )
        if trials and trials[0].bic < fit.bic - TIE_CHI2:
            fit = search.refit(trials[0])
    return fit


def prune_mechanisms(search: MechanismSearch, fit: CandidateFit, small: bool = False) -> CandidateFit:
    """Take out again what is no longer worth its place."""
    while len(fit.mechanisms) > 1:
        reduced_fits = parallel_map(
            partial(fit_without_mechanism, search.problem, fit), range(len(fit.mechanisms))
        )
        losses = [reduced_fit.corrected_chi2 - fit.corrected_chi2 for reduced_fit in reduced_fits]
        k = int(np.argmin(losses))
        if search.is_worthwhile(reduced_fits[k], fit, small, fit.mechanisms[k]):
            break
        fit = search.refit(reduced_fits[k])
    return fit


def _find_restart_pairs(
    search: MechanismSearch, fit: CandidateFit, directions: Sequence[ScoreDirection]
) -> list[CandidateFit]:
    """Pairs, roughly refitted, that come nearer than any that a model began with or might have gone on to."""
    singles = parallel_map(
        partial(_fit_with_candidate, search.problem, search.baseline),
        _list_promising(search, search.baseline, directions),
    )

    def extend_to_pairs(single: CandidateFit) -> list[CandidateFit]:
        return [
            _fit_with_candidate(search.problem, single, s)
            for s in _list_promising(search, single, search.score_candidates(single), SECOND_CANDIDATE_COUNT)
        ]

    begins: list[CandidateFit] = []
    for pair in sorted(
        chain.from_iterable(parallel_map(extend_to_pairs, singles)), key=lambda pair: pair.bic
    ):
        ids = set(pair.ids)
        if fit.ids and (ids <= set(fit.ids) or ids >= set(fit.ids)):
            break
        if not any(ids == set(other.ids) for other in begins):
            begins.append(pair)
    return begins[:RESTART_PAIR_COUNT]


def is_reduction_significant(
    gain: float, numbers: int, tried: int, chance: float = FALSE_INCLUSION_PROBABILITY
) -> bool:
    """Whether noise alone would hardly ever take so much χ² away, over all forms that were tried."""
    return bool(gain > 0 and tried * chi2.sf(gain, numbers) < chance)


def shortlist_candidates(
    directions: Sequence[ScoreDirection], mechanism_ids: Sequence[str], count: int = SHORTLIST_LENGTH
) -> list[ScoreDirection]:
    """The best form of each of the most promising mechanisms that may join the chosen ones."""
    best: dict[str, ScoreDirection] = {}
    barred = {*mechanism_ids, *(id for pair in EXCLUSIVE_PAIRS if pair & set(mechanism_ids) for id in pair)}
    for direction in directions:
        id = direction.candidate.id
        if id not in barred and (id not in best or direction.chi2_reduction > best[id].chi2_reduction):
            best[id] = direction
    return sorted(best.values(), key=lambda s: -s.chi2_reduction)[:count]


def _fit_with_candidate(
    problem: LibraryProblem, fit: CandidateFit, direction: ScoreDirection
) -> CandidateFit:
    """The model with one more form, roughly refitted under the model's noise.

    A baseline whose numbers were driven to their limits is a bad place to begin from: what drove them there
    may be this form. Then it begins once more from what the lab believes.
    """
    begins = [fit.estimate.values]
    if not fit.mechanisms and _is_strained(problem, fit):
        begins.append(problem.neutral)
    mechanisms = (*fit.mechanisms, direction.candidate)
    free = get_free_indices(problem, mechanisms)
    ends = []
    for begin in begins:
        values = switch_on_candidate(problem, begin, direction.candidate, direction.amplitudes)
        ends.append(fit_parameters(problem, fit.noise, free, values, ROUGH_EVALUATIONS))
    estimate = min(ends, key=lambda estimate: estimate.cost)
    # Rough: what noise alone leaves there is told, its pull on the minimum is not.
    return CandidateFit(
        mechanisms, fit.noise, estimate, compute_input_noise_chi2(problem, fit.noise.whiten, estimate.values)
    )


def _is_strained(problem: LibraryProblem, fit: CandidateFit) -> bool:
    """Whether a number of the baseline's own was driven far from what the lab believes."""
    own = np.flatnonzero(problem.is_baseline & np.isfinite(problem.prior_sd))
    return bool(
        np.any(
            np.abs(fit.estimate.values[own] - problem.start[own]) > STRAINED_PRIOR_SD * problem.prior_sd[own]
        )
    )


def refit_most_promising(
    problem: LibraryProblem, reduced_fit: CandidateFit, trials: Sequence[CandidateFit]
) -> list[CandidateFit]:
    """The most promising of some rough refits, refitted to the end, best first; `reduced_fit` has a form
    fewer.
    """
    first = sorted(trials, key=lambda trial: trial.bic)[:FINAL_REFIT_COUNT]
    return refit_fully(
        problem,
        [
            trial
            for trial in first
            if trial is first[0] or trial.bic < compute_rough_limit(reduced_fit, first[0])
        ],
    )


def refit_fully(problem: LibraryProblem, rough_fits: Sequence[CandidateFit]) -> list[CandidateFit]:
    """Rough refits, refitted to the end; best first."""

    def refit_rough(m: CandidateFit) -> CandidateFit:
        return build_corrected_fit(
            problem,
            m.mechanisms,
            m.noise,
            fit_parameters(problem, m.noise, m.estimate.free, m.estimate.values),
        )

    return sorted(parallel_map(refit_rough, rough_fits), key=lambda trial: trial.bic)


def compute_rough_limit(reduced_fit: CandidateFit, fit: CandidateFit) -> float:
    """What a rough refit of `reduced_fit` with another form must reach for its end to come near that of a
    model.
    """
    return (reduced_fit.bic + fit.bic) / 2


def fit_replacements(
    problem, reduced_fit: CandidateFit, candidate: Candidate, candidates
) -> list[CandidateFit]:
    """Models in which another mechanism stands in the place of a form, roughly refitted."""
    scored = compute_score_directions(
        problem, reduced_fit.noise, reduced_fit.estimate, [c for c in candidates if c.id != candidate.id]
    )
    return parallel_map(
        lambda s: _fit_with_candidate(problem, reduced_fit, s),
        shortlist_candidates(scored, reduced_fit.ids, 5),
    )


def fit_without_mechanism(problem: LibraryProblem, fit: CandidateFit, k: int) -> CandidateFit:
    """The model without its k-th form, refitted under the same noise."""
    candidate = fit.mechanisms[k]
    remaining = fit.mechanisms[:k] + fit.mechanisms[k + 1 :]
    free = get_free_indices(problem, remaining)
    values = switch_off_candidate(problem, fit.estimate.values, candidate)
    return build_corrected_fit(
        problem, remaining, fit.noise, fit_parameters(problem, fit.noise, free, values, 2 * ROUGH_EVALUATIONS)
    )
