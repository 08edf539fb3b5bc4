"""Cross-validation of the selected mechanisms on blocks that the fit did not use.

Unmodelled physics is often absorbed by the nearest mechanism in the library: a saturated load cell resembles
a compliant rig. Such a fit fails on other blocks. Therefore each training block is left out once
(`explained_fraction.py`). If all mechanisms together explain less than 5/6 of the misfit of the left-out
blocks (setting `min_explained_fraction`), a part of the misfit is unexplained, even if their residual in the
fit is only noise.

In that case only the mechanism with the largest explained fraction keeps its name. Mechanisms beside it fit
what its equation leaves, and their fractions do not show which of them are real. If the set predicts the
left-out blocks but leaves a large residual in the fit, each mechanism is tested alone. Its probability is
multiplied by its explained fraction, and mechanisms below `established_probability` are dropped. This is
done once, with all mechanisms in the model.

If a part of the misfit is unexplained, the certainty of the remaining mechanisms, the distance of their
probability from even chances, is halved (setting `unexplained_certainty_share`).

Limits: a mechanism whose true equation has another form than the textbook's, and one that replaces physics
outside the library, can explain the same fraction. Both are named with a low probability, beside an
unexplained part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pamjax.diagnosis.crossval.explained_fraction import BlockCrossValidation
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import fit_candidate, switch_off_candidate
from pamjax.diagnosis.select.selection import (
    NamedMechanism,
    Selection,
    rank_mechanisms,
)
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.fitting.identifiability import format_list
from pamjax.records.blocks import Blocks


def cross_validate_selection(
    problem: LibraryProblem,
    blocks: Blocks,
    training_rows: np.ndarray,
    selection: Selection,
    *,
    judge_each: bool,
) -> tuple[Selection, bool]:
    """Return the selection with its cross-validated probabilities, and whether it predicts left-out blocks.

    Args:
        problem: the recording and the library.
        blocks: the blocks of the recording.
        training_rows: (n,) mask of the rows in use.
        selection: the selection from these rows.
        judge_each: whether to test each mechanism alone in any case; done if the residual of the fit is
            large.
    """
    cross_validation = BlockCrossValidation.from_blocks(problem, blocks, training_rows, selection.model)
    is_predictive = not cross_validation.fails_out_of_sample
    if is_predictive and not judge_each:
        return selection, is_predictive
    explained_fractions = cross_validation.explained_fraction_by_mechanism
    remaining = (
        _weight_each(selection.named_mechanisms, explained_fractions, problem.settings)
        if is_predictive
        else _keep_best(selection.named_mechanisms, explained_fractions, problem.settings)
    )
    return _restrict_selection(problem, training_rows, selection, remaining), is_predictive


def _weight_each(
    mechanisms: Sequence[NamedMechanism], fractions: dict[str, float], settings: DiagnosisSettings
) -> list[NamedMechanism]:
    """Return the mechanisms that are probable after multiplication by their explained fractions."""
    weighted = [replace(m, probability=m.probability * fractions[m.id]) for m in mechanisms]
    return [m for m in weighted if m.probability >= settings.established_probability]


def _keep_best(
    mechanisms: Sequence[NamedMechanism], fractions: dict[str, float], settings: DiagnosisSettings
) -> list[NamedMechanism]:
    """Return the mechanism with the largest explained fraction, or none if no fraction is above zero."""
    best = max(mechanisms, key=lambda m: fractions[m.id])
    return [_scale_certainty(best, fractions[best.id], settings)] if fractions[best.id] > 0 else []


def _scale_certainty(mechanism: NamedMechanism, share: float, settings: DiagnosisSettings) -> NamedMechanism:
    """Return the mechanism with a share of the distance of its probability from `established_probability`."""
    limit = settings.established_probability
    return replace(mechanism, probability=limit + share * (mechanism.probability - limit))


def reduce_certainty(selection: Selection, settings: DiagnosisSettings) -> Selection:
    """Return the selection with probabilities closer to `established_probability`."""
    new_mechanisms = [
        _scale_certainty(mechanism, settings.unexplained_certainty_share, settings)
        for mechanism in selection.named_mechanisms
    ]
    return replace(selection, named_mechanisms=rank_mechanisms(new_mechanisms))


def format_dropped_mechanisms(before: Selection, after: Selection) -> list[str]:
    """Return a note on the mechanisms that cross-validation dropped, if there are any."""
    named_ids = {name.id for name in after.named_mechanisms}
    dropped_ids = [f"`{name.id}`" for name in before.named_mechanisms if name.id not in named_ids]
    if not dropped_ids:
        return []
    explain, are = ("explains", "is") if len(dropped_ids) == 1 else ("explain", "are")
    return [
        f"{format_list(dropped_ids)} {explain} too little of the misfit of left-out blocks and {are} not"
        f" reported."
    ]


def _restrict_selection(
    problem: LibraryProblem,
    training_rows: np.ndarray,
    selection: Selection,
    named_mechanisms: Sequence[NamedMechanism],
) -> Selection:
    """Return the selection with some of its mechanisms only, refitted if others are dropped."""
    ids = {name.id for name in named_mechanisms}
    if len(ids) == len(selection.model.mechanisms):
        return replace(selection, named_mechanisms=rank_mechanisms(named_mechanisms))
    values = selection.start_values
    for candidate in selection.model.mechanisms:
        values = values if candidate.id in ids else switch_off_candidate(problem, values, candidate)
    mechanisms = [candidate for candidate in selection.model.mechanisms if candidate.id in ids]
    fit = fit_candidate(problem, training_rows, mechanisms, values) if mechanisms else selection.baseline
    return replace(
        selection,
        model=fit,
        named_mechanisms=rank_mechanisms(named_mechanisms),
        weighted_values=None,
        fit_before_small_effects=None,
    )
