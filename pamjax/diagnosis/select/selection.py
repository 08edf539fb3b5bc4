"""Selection of mechanisms: search, probability of each mechanism, and its rivals.

A rival is another mechanism in its place. A rival that fits as well is reported as indistinguishable. A rival
that fits nearly as well reduces the probability.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import evaluate_estimate
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model, switch_off_candidate
from pamjax.diagnosis.select.masked_effects import add_masked_effects
from pamjax.diagnosis.select.merge_mechanisms import merge_mechanisms
from pamjax.diagnosis.select.neighbour_fits import (
    compute_rough_limit,
    fit_replacements,
    fit_without_mechanism,
    refit_fully,
)
from pamjax.diagnosis.select.pair_swap import swap_pairs
from pamjax.diagnosis.select.redundant_mechanisms import remove_redundant_mechanisms
from pamjax.diagnosis.select.search import MechanismSearch, search_mechanisms
from pamjax.diagnosis.select.small_effects import add_small_effects
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.progress import Progress, ignore_progress


@dataclass(frozen=True, eq=False)
class RivalFit:
    """Refit of a model with a rival in the place of one of its mechanisms.

    Attributes:
        probability: probability that the rival is present instead.
        candidate: the rival, in its best starting form.
        values: (p,) refitted parameter values, SI.
    """

    probability: float
    candidate: Candidate
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class NamedMechanism:
    """An identified mechanism: a mechanism of the selected model, with its probability.

    Attributes:
        id: id of the mechanism.
        probability: probability that it, or one indistinguishable from it, is present.
        indistinguishable: ids of the mechanisms that explain this recording as well.
        chi2_increase: increase of χ² without it, after a refit.
        rival_bic_increase: increase of the BIC, with form errors, by each rival in its place.
        form_error: rms of its form error over the rms of its effect; None if its equation has none.
        indistinguishable_fits: the refit with each indistinguishable rival.
    """

    id: str
    probability: float
    indistinguishable: tuple[str, ...]
    chi2_increase: float
    rival_bic_increase: dict[str, float] = field(default_factory=dict)
    form_error: float | None = None
    indistinguishable_fits: tuple[RivalFit, ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """Selected mechanisms with their fit.

    Attributes:
        baseline: refit of the baseline.
        model: refit of the baseline with all selected mechanisms.
        named_mechanisms: these mechanisms, most probable first.
        weighted_values: (p,) values of the fit with misfit weights, SI; None without such a fit.
        fit_without_small_effects: the fit without small effects; None if `model` has none.
        masked_ids: ids of the mechanisms whose effect a form error of another one can explain.
    """

    baseline: ModelFit
    model: ModelFit
    named_mechanisms: tuple[NamedMechanism, ...]
    weighted_values: np.ndarray | None = None
    fit_without_small_effects: ModelFit | None = None
    masked_ids: frozenset[str] = frozenset()

    @property
    def start_values(self) -> np.ndarray:
        """Return the starting values for a refit of the model, (p,), SI."""
        return self.model.estimate.values if self.weighted_values is None else self.weighted_values


def select_mechanisms(
    problem: LibraryProblem,
    training_mask: np.ndarray,
    baseline: ModelFit,
    progress: Progress = ignore_progress,
) -> Selection:
    """Return the mechanisms that the baseline of a recording omits.

    Args:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fit.
        baseline: refit of the baseline to these rows.
        progress: called with the current step and the completed fraction.
    """
    candidates = build_candidates(problem)
    baseline_directions = compute_score_directions(problem, baseline.noise, baseline.estimate, candidates)
    search = MechanismSearch(problem, training_mask, baseline, candidates, progress)
    found_fit = swap_pairs(search, search_mechanisms(search, baseline, baseline_directions))
    unmasked_fit = remove_redundant_mechanisms(search, merge_mechanisms(search, found_fit))
    fit_without_small_effects = add_masked_effects(search, unmasked_fit)
    masked_ids = frozenset(fit_without_small_effects.ids) - frozenset(unmasked_fit.ids)
    fit = (
        fit_without_small_effects
        if search.leaves_only_noise(fit_without_small_effects)
        else add_small_effects(problem, fit_without_small_effects, candidates, progress)
    )
    progress("comparing rivals", 0.75)
    named_mechanisms = shrink_to_even_odds(
        _assess_mechanisms(problem, fit, candidates), problem.settings, masked_ids
    )
    if fit is fit_without_small_effects:
        return Selection(baseline, fit, named_mechanisms, masked_ids=masked_ids)
    # The residual is tested with the noise of the recording, without misfit weights.
    weighted_values = fit.estimate.values
    return Selection(
        baseline,
        fit_model(problem, training_mask, fit.mechanisms, weighted_values),
        named_mechanisms,
        weighted_values,
        fit_without_small_effects,
        masked_ids,
    )


def drop_small_effects(problem: LibraryProblem, selection: Selection) -> Selection:
    """Return the selection without small effects."""
    fit = selection.fit_without_small_effects
    assert fit is not None
    names = shrink_to_even_odds(_assess_mechanisms(problem, fit), problem.settings, selection.masked_ids)
    return Selection(selection.baseline, fit, names, masked_ids=selection.masked_ids)


def shrink_to_even_odds(
    named_mechanisms: Sequence[NamedMechanism], settings: DiagnosisSettings, ids: Container[str]
) -> tuple[NamedMechanism, ...]:
    """Return mechanisms; those with some ids have probabilities closer to `established_probability`.

    The setting `doubtful_certainty_share` states how much of the distance remains.
    """
    limit, share = settings.established_probability, settings.doubtful_certainty_share
    return _rank_mechanisms(
        [
            replace(mechanism, probability=limit + share * (mechanism.probability - limit))
            if mechanism.id in ids
            else mechanism
            for mechanism in named_mechanisms
        ]
    )


def restrict_selection(
    problem: LibraryProblem,
    training_mask: np.ndarray,
    selection: Selection,
    named_mechanisms: Sequence[NamedMechanism],
) -> Selection:
    """Return the selection with some of its mechanisms only, refitted if others are dropped."""
    ids = {mechanism.id for mechanism in named_mechanisms}
    if len(ids) == len(selection.model.mechanisms):
        return replace(selection, named_mechanisms=_rank_mechanisms(named_mechanisms))
    values = selection.start_values
    for candidate in selection.model.mechanisms:
        values = values if candidate.id in ids else switch_off_candidate(problem, values, candidate)
    mechanisms = [candidate for candidate in selection.model.mechanisms if candidate.id in ids]
    fit = fit_model(problem, training_mask, mechanisms, values) if mechanisms else selection.baseline
    return replace(
        selection,
        model=fit,
        named_mechanisms=_rank_mechanisms(named_mechanisms),
        weighted_values=None,
        fit_without_small_effects=None,
    )


def _assess_mechanisms(
    problem: LibraryProblem, fit: ModelFit, candidates: Sequence[Candidate] | None = None
) -> tuple[NamedMechanism, ...]:
    """Return the mechanisms of a model with their probabilities, most probable first.

    Args:
        problem: the recording and the library.
        fit: the fitted model.
        candidates: candidates of the rivals; all if omitted.
    """
    candidates = build_candidates(problem) if candidates is None else candidates
    named_mechanisms = parallel_map(
        lambda k: _assess_mechanism(problem, fit, k, candidates), range(len(fit.mechanisms))
    )
    return _rank_mechanisms(named_mechanisms)


def _rank_mechanisms(named_mechanisms: Sequence[NamedMechanism]) -> tuple[NamedMechanism, ...]:
    """Return mechanisms sorted by probability, then by the increase of χ² without them."""
    return tuple(
        sorted(
            named_mechanisms,
            key=lambda mechanism: (-round(mechanism.probability, 2), -mechanism.chi2_increase),
        )
    )


def _assess_mechanism(problem, fit: ModelFit, k: int, candidates) -> NamedMechanism:
    candidate = fit.mechanisms[k]
    reduced_fit = fit_without_mechanism(problem, fit, k)
    chi2_increase = reduced_fit.corrected_chi2 - fit.corrected_chi2
    trials = _fit_rivals(problem, fit, reduced_fit, candidate, candidates)
    # Refit rivals with a low BIC to the minimum; the rough refits of the others are sufficient.
    close_trials = [
        trial
        for trial in trials
        if trial.bic
        < max(fit.bic + problem.settings.rough_chi2_margin, compute_rough_limit(reduced_fit, fit))
    ]
    close_trials = sorted(close_trials, key=lambda trial: trial.bic)[: problem.settings.final_refit_count]
    fit_by_id = {m.mechanisms[-1].id: m for m in [*trials, *refit_fully(problem, close_trials)]}
    # Real effects depart from their equations: a rival must explain more than these form errors.
    form_fit = add_form_errors(problem, fit)
    bic_increase = {
        id: add_form_errors(problem, m).full_bic - form_fit.full_bic for id, m in fit_by_id.items()
    }
    # The misfit beyond form errors widens the scale of the comparison.
    scale = 1 + form_fit.excess_chi2 / problem.settings.comparison_excess_chi2
    weights = {id: np.exp(-0.5 * max(increase, 0.0) / scale) for id, increase in bic_increase.items()}
    indistinguishable = [
        id
        for id, increase in bic_increase.items()
        if increase < problem.settings.tie_chi2 + problem.settings.tie_excess_share * form_fit.excess_chi2
    ]
    tied_weight = sum(weights[id] for id in indistinguishable)
    probability = compute_probability(
        sum(weights.values()), tied_weight, problem.settings.unknown_rival_weight
    )
    indistinguishable_fits = tuple(
        RivalFit(weights[id] / (1 + tied_weight), fit_by_id[id].mechanisms[-1], fit_by_id[id].estimate.values)
        for id in indistinguishable
    )
    return NamedMechanism(
        candidate.id, probability, tuple(indistinguishable), float(chi2_increase), bic_increase,
        indistinguishable_fits=indistinguishable_fits,
    )  # fmt: skip


def _fit_rivals(
    problem: LibraryProblem,
    fit: ModelFit,
    reduced_fit: ModelFit,
    candidate: Candidate,
    candidates: Sequence[Candidate],
) -> list[ModelFit]:
    """Return models with a rival in the place of a candidate, roughly refitted: the better of two starts.

    The refit without the candidate can be far from the fit: other mechanisms then absorb its effect. The
    values of the fit are the second start.
    """
    values = switch_off_candidate(problem, fit.estimate.values, candidate)
    at_fit = replace(
        reduced_fit, estimate=evaluate_estimate(problem, fit.noise, reduced_fit.estimate.free, values)
    )
    best: dict[str, ModelFit] = {}
    for start in (reduced_fit, at_fit):
        for trial in fit_replacements(problem, start, candidate, candidates):
            id = trial.mechanisms[-1].id
            if id not in best or trial.bic < best[id].bic:
                best[id] = trial
    return list(best.values())


def compute_probability(rival_weight: float, tied_weight: float, unknown_weight: float) -> float:
    """Return the probability that a mechanism, or one indistinguishable from it, is present.

    Args:
        rival_weight: sum of the weights of all rivals, relative to the mechanism.
        tied_weight: sum of the weights of the indistinguishable ones.
        unknown_weight: weight of physics outside the library, relative to the mechanism or one of these.

    >>> round(compute_probability(1.25, 1.0, 0.0), 3), round(compute_probability(0.0, 0.0, 0.1), 3)
    (0.889, 0.909)
    """
    return float(1 / ((1 + rival_weight) / (1 + tied_weight) + unknown_weight))


def format_masked_mechanisms(selection: Selection, settings: DiagnosisSettings) -> list[str]:
    """Return a note on each named mechanism that a form error can explain."""
    return [
        f"A form error of another mechanism can also explain the effect of `{mechanism.id}`:"
        f" its certainty is multiplied by {settings.doubtful_certainty_share:.2g}."
        for mechanism in selection.named_mechanisms
        if mechanism.id in selection.masked_ids
    ]
