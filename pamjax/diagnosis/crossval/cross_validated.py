"""Cross-validation of the selected mechanisms on blocks that the fit did not use.

Unmodelled physics is often absorbed by the nearest mechanism in the library: a saturated load cell resembles
a compliant rig. Such a fit fails on other blocks. Therefore each training block is left out once
(`explained_fraction.py`). If all mechanisms together explain less than 5/6 of the misfit of the left-out
blocks (setting `min_explained_fraction`), all are dropped, even if their residual in the fit is only noise.

If the residual of the fit is large, significant or not, each mechanism is also tested alone. Its probability
is multiplied by its explained fraction, and mechanisms below `established_probability` are dropped. This is
done once, with all mechanisms in the model.

If a part of the misfit stays unexplained, the remaining probabilities move halfway to even chances (setting
`unexplained_certainty_share`).

Limits: a mechanism is lost if unmodelled physics of half its size is present, because one
recording does not distinguish the two. A mechanism that is kept may still replace the unexplained physics.
The limit of 5/6 was chosen on simulated recordings with effects that differ from their equations or are
outside the library. Recordings of the validation were not used.
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
) -> Selection:
    """Return the selection with the mechanisms that pass cross-validation.

    Args:
        problem: the recording and the library.
        blocks: the blocks of the recording.
        training_rows: (n,) mask of the rows in use.
        selection: the selection from these rows.
        judge_each: whether to test each mechanism alone too; done if the residual of the fit is large.
    """
    cross_validation = BlockCrossValidation.from_blocks(problem, blocks, training_rows, selection.model)
    if cross_validation.fails_out_of_sample:
        return _restrict_selection(problem, training_rows, selection, [])
    if not judge_each:
        return selection
    explained_fractions = cross_validation.explained_fraction_by_mechanism
    weighted_mechanisms = [
        replace(mechanism, probability=mechanism.probability * explained_fractions[mechanism.id])
        for mechanism in selection.named_mechanisms
    ]
    return _restrict_selection(
        problem,
        training_rows,
        selection,
        [
            mechanism
            for mechanism in weighted_mechanisms
            if mechanism.probability >= problem.settings.established_probability
        ],
    )


def reduce_certainty(selection: Selection, settings: DiagnosisSettings) -> Selection:
    """Return the selection with probabilities closer to `established_probability`."""
    limit = settings.established_probability
    new_mechanisms = [
        replace(n, probability=limit + settings.unexplained_certainty_share * (n.probability - limit))
        for n in selection.named_mechanisms
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
