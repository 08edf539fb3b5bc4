"""Selection of mechanisms: search, and the probability of each mechanism that was found."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model, switch_off_candidate
from pamjax.diagnosis.select.masked_effects import add_masked_effects
from pamjax.diagnosis.select.merge_mechanisms import merge_mechanisms
from pamjax.diagnosis.select.pair_swap import swap_pairs
from pamjax.diagnosis.select.redundant_mechanisms import remove_redundant_mechanisms
from pamjax.diagnosis.select.rivals import NamedMechanism, assess_mechanisms
from pamjax.diagnosis.select.search import MechanismSearch, search_mechanisms
from pamjax.diagnosis.select.small_effects import add_small_effects
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.progress import Progress, ignore_progress


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
        assess_mechanisms(problem, fit, candidates), problem.settings, masked_ids
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
    names = shrink_to_even_odds(
        assess_mechanisms(problem, fit, build_candidates(problem)),
        problem.settings,
        selection.masked_ids,
    )
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


def _rank_mechanisms(named_mechanisms: Sequence[NamedMechanism]) -> tuple[NamedMechanism, ...]:
    """Return mechanisms sorted by probability, then by the increase of χ² without them."""
    return tuple(
        sorted(
            named_mechanisms,
            key=lambda mechanism: (-round(mechanism.probability, 2), -mechanism.chi2_increase),
        )
    )


def format_masked_mechanisms(selection: Selection, settings: DiagnosisSettings) -> list[str]:
    """Return a note on each named mechanism that a form error can explain."""
    return [
        f"A form error of another mechanism can also explain the effect of `{mechanism.id}`:"
        f" its certainty is multiplied by {settings.doubtful_certainty_share:.2g}."
        for mechanism in selection.named_mechanisms
        if mechanism.id in selection.masked_ids
    ]
