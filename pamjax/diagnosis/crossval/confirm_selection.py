"""Cross-validation of the selected mechanisms on blocks that the fit did not use.

Unmodelled physics is often absorbed by the nearest mechanism in the library: a saturated load cell resembles
a compliant rig. Such a fit fails on other blocks. Therefore each training block is left out once
(`block_cross_validation.py`), with the form errors of the mechanisms as noise. All mechanisms together must
explain most of the misfit of the left-out blocks (setting `min_explained_fraction`). Otherwise a part of the
misfit is unexplained, even if their residual in the fit is only noise.

Each mechanism is also tested alone. Its probability is multiplied by the fraction of its effect that left-out
blocks confirm. It is dropped if its probability is then below `established_probability`. If there are several
such mechanisms, the one without which the left-out blocks are predicted best is dropped, and the others are
tested again.

If a part of the misfit is unexplained, the certainty of the remaining mechanisms is reduced (setting
`doubtful_certainty_share`). Certainty is the distance of a probability from `established_probability`.

Limits: a mechanism that replaces physics outside the library can explain left-out blocks too. It is then
named with a low probability, and a part is unexplained.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pamjax.diagnosis.crossval.block_cross_validation import BlockCrossValidation
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.select.selection import (
    Selection,
    restrict_selection,
)
from pamjax.records.blocks import Blocks
from pamjax.text import join_words


def cross_validate_selection(
    problem: LibraryProblem,
    blocks: Blocks,
    training_mask: np.ndarray,
    selection: Selection,
) -> tuple[Selection, bool]:
    """Return the selection with its cross-validated probabilities, and whether it predicts left-out blocks.

    Args:
        problem: the recording and the library.
        blocks: the blocks of the recording.
        training_mask: (n,) whether a row is used in the fit.
        selection: the selection from these rows.
    """
    while True:
        cross_validation = BlockCrossValidation.from_blocks(
            problem, blocks, training_mask, add_form_errors(problem, selection.model)
        )
        fractions = cross_validation.predicted_fraction_by_mechanism
        reweighted = [
            replace(m, probability=m.probability * fractions[m.id]) for m in selection.named_mechanisms
        ]
        weak = [m for m in reweighted if m.probability < problem.settings.established_probability]
        if len(weak) < 2:
            break
        excess_without = cross_validation.left_out_excess_without
        worst = min(weak, key=lambda m: (excess_without[m.id], m.probability))
        others = [m for m in selection.named_mechanisms if m.id != worst.id]
        selection = restrict_selection(problem, training_mask, selection, others)
    return (
        restrict_selection(problem, training_mask, selection, [m for m in reweighted if m not in weak]),
        not cross_validation.fails_out_of_sample,
    )


def format_dropped_mechanisms(selection: Selection, confirmed_selection: Selection) -> list[str]:
    """Return a note on the mechanisms that cross-validation dropped, if there are any."""
    named_ids = {mechanism.id for mechanism in confirmed_selection.named_mechanisms}
    dropped_ids = [
        f"`{mechanism.id}`" for mechanism in selection.named_mechanisms if mechanism.id not in named_ids
    ]
    if not dropped_ids:
        return []
    its, is_not = ("its", "is not") if len(dropped_ids) == 1 else ("their", "are not")
    return [
        f"{join_words(dropped_ids)} {is_not} reported: after cross-validation {its} probability is too low."
    ]
