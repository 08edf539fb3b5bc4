"""Name what was left out: what a search found, what each name is worth, and what else it could be.

Whoever takes a name's place as well is told beside it, and whoever does so nearly as well takes of its
probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import ScoreDirection, compute_score_directions
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate
from pamjax.diagnosis.select.pair_swap import swap_pairs
from pamjax.diagnosis.select.search import (
    FINAL_REFIT_COUNT,
    TIE_CHI2,
    TIE_EXCESS_SHARE,
    MechanismSearch,
    compute_rough_limit,
    fit_replacements,
    fit_without_mechanism,
    refit_fully,
    search_mechanisms,
)
from pamjax.diagnosis.select.small_effects import add_small_effects
from pamjax.progress import Progress, ignore_progress

#: Probability from which a name counts as established.
ESTABLISHED_PROBABILITY = 0.5
#: χ² by which a rough refit that is pulled by noise may be too high.
ROUGH_CHI2_MARGIN = 36.0


@dataclass(frozen=True, eq=False)
class NamedMechanism:
    """A mechanism that a model holds.

    Attributes:
        id: which.
        probability: that this, or one of its ties, is it and none of the other rivals.
        indistinguishable: ids that explain this recording as well.
        chi2_increase: χ² that is lost when it is taken out and all others refitted.
        rival_chi2_increase: χ² lost when a rival takes its place, by id.
        alternatives: chance of each tie to be what is there, its form, and all numbers with it, (p,), SI.
    """

    id: str
    probability: float
    indistinguishable: tuple[str, ...]
    chi2_increase: float
    rival_chi2_increase: dict[str, float] = field(default_factory=dict)
    alternatives: tuple[tuple[float, Candidate, np.ndarray], ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """What was named.

    Attributes:
        baseline: the baseline's own refit.
        model: the baseline with all names.
        named_mechanisms: of all that the model holds, most probable first.
        baseline_directions: the signatures at the baseline, for its p-value.
        weighted_values: (p,) SI, where the model lies weighed by what it leaves; None where that is its own
            place.
        fit_before_small_effects: the model before small effects joined; None where none did.
    """

    baseline: CandidateFit
    model: CandidateFit
    named_mechanisms: tuple[NamedMechanism, ...]
    baseline_directions: tuple[ScoreDirection, ...]
    weighted_values: np.ndarray | None = None
    fit_before_small_effects: CandidateFit | None = None

    @property
    def established(self) -> tuple[NamedMechanism, ...]:
        """The names that are likelier right than wrong."""
        return tuple(name for name in self.named_mechanisms if name.probability >= ESTABLISHED_PROBABILITY)

    @property
    def start_values(self) -> np.ndarray:
        """Where a refit of the model begins, (p,), SI."""
        return self.model.estimate.values if self.weighted_values is None else self.weighted_values


def select_mechanisms(
    problem: LibraryProblem, training_rows: np.ndarray, progress: Progress = ignore_progress
) -> Selection:
    """Name what the baseline has left out of a recording.

    Args:
        problem: the recording before the library.
        training_rows: (n,) the rows that may be looked at.
        progress: called with what is being done and the share done.
    """
    candidates = build_candidates(problem)
    baseline = fit_candidate(problem, training_rows, (), problem.neutral)
    baseline_directions = compute_score_directions(problem, baseline.noise, baseline.estimate, candidates)
    search = MechanismSearch(problem, training_rows, baseline, candidates, progress)
    fit_before_small_effects = swap_pairs(search, search_mechanisms(search, baseline_directions))
    fit = add_small_effects(problem, fit_before_small_effects, candidates, progress)
    progress("rivals", 0.75)
    named_mechanisms = assess_mechanisms(problem, fit, candidates)
    if fit is fit_before_small_effects:
        return Selection(baseline, fit, named_mechanisms, tuple(baseline_directions))
    # What stays unexplained is judged by the recording's noise.
    weighted_values = fit.estimate.values
    return Selection(
        baseline,
        fit_candidate(problem, training_rows, fit.mechanisms, weighted_values),
        named_mechanisms,
        tuple(baseline_directions),
        weighted_values,
        fit_before_small_effects,
    )


def drop_small_effects(problem: LibraryProblem, selection: Selection) -> Selection:
    """What was named before small effects joined."""
    assert selection.fit_before_small_effects is not None
    return Selection(
        selection.baseline,
        selection.fit_before_small_effects,
        assess_mechanisms(problem, selection.fit_before_small_effects),
        selection.baseline_directions,
    )


def assess_mechanisms(
    problem: LibraryProblem, fit: CandidateFit, candidates: Sequence[Candidate] | None = None
) -> tuple[NamedMechanism, ...]:
    """What each of a model's names is worth beside its rivals, most probable first.

    Args:
        problem: the recording before the library.
        fit: with the names.
        candidates: the forms of the rivals; None for all.
    """
    candidates = build_candidates(problem) if candidates is None else candidates
    named_mechanisms = parallel_map(
        lambda k: _assess_mechanism(problem, fit, k, candidates), range(len(fit.mechanisms))
    )
    return rank_mechanisms(named_mechanisms)


def rank_mechanisms(named_mechanisms: Sequence[NamedMechanism]) -> tuple[NamedMechanism, ...]:
    """Names, most probable first; of those as probable, the one whose loss costs most."""
    return tuple(
        sorted(named_mechanisms, key=lambda name: (-round(name.probability, 2), -name.chi2_increase))
    )


def _assess_mechanism(problem, fit: CandidateFit, k: int, candidates) -> NamedMechanism:
    candidate = fit.mechanisms[k]
    reduced_fit = fit_without_mechanism(problem, fit, k)
    chi2_increase = reduced_fit.corrected_chi2 - fit.corrected_chi2
    trials = fit_replacements(problem, reduced_fit, candidate, candidates)
    # Who comes near gets every chance: noise may have pulled it too high. The others are far behind already.
    near = [
        trial
        for trial in trials
        if trial.bic < max(fit.bic + ROUGH_CHI2_MARGIN, compute_rough_limit(reduced_fit, fit))
    ]
    near = sorted(near, key=lambda trial: trial.bic)[:FINAL_REFIT_COUNT]
    ends = {m.mechanisms[-1].id: m for m in [*trials, *refit_fully(problem, near)]}
    rivals = {id: m.bic - fit.bic for id, m in ends.items()}
    # What is left unexplained shows how far off textbook forms are here: it blurs a comparison.
    blur = 1 + fit.excess_chi2 / 8
    weights = {id: np.exp(-0.5 * max(loss, 0.0) / blur) for id, loss in rivals.items()}
    indistinguishable = [
        id for id, loss in rivals.items() if loss < TIE_CHI2 + TIE_EXCESS_SHARE * fit.excess_chi2
    ]
    alike = sum(weights[id] for id in indistinguishable)
    alternatives = tuple(
        (weights[id] / (1 + alike), ends[id].mechanisms[-1], ends[id].estimate.values)
        for id in indistinguishable
    )
    probability = float((1 + alike) / (1 + sum(weights.values())))
    return NamedMechanism(
        candidate.id, probability, tuple(indistinguishable), float(chi2_increase), rivals, alternatives
    )
