"""Names held against blocks that they were not fitted to.

What is in no catalogue is bent towards by whatever comes near: a clipped load cell looks a little like a rig
that gives, and is explained by it where it was fitted. Physics holds in blocks that it was not fitted to as
well. So each block that naming saw is left out once (`explained_fraction.py`). What all names together
explain there, against the bare baseline, decides whether any of them stands, however little they leave where
they were fitted: three names bend to a ripple until only noise is left. What leaves more than a sixth of
unseen blocks is something else.

Where much is left where they were fitted, be it known from noise or not, each name is judged as well, once,
beside everything that came near (judged again after its neighbours have gone, a name has their misfit held
against it as well): its probability counts for its share, and names that fall below
`ESTABLISHED_PROBABILITY` go.

Names that stay beside something unexplained keep half of the certainty that is left to them.

What it leaves out: a name beside which something in no catalogue is half as large is lost: one recording does
not distinguish the two. A name that stays beside something unexplained may still be a stand-in for it. The
sixth is a judgement, made on recordings of pamjax's own whose effects depart from their equations, or that
hold something in no catalogue, alone or beside an effect; those that a proof counts were not among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pamjax.diagnosis.crossval.explained_fraction import BlockCrossValidation
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import fit_candidate, switch_off_candidate
from pamjax.diagnosis.select.selection import (
    ESTABLISHED_PROBABILITY,
    NamedMechanism,
    Selection,
    rank_mechanisms,
)
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
    """The names that explain blocks they were not fitted to, with their probabilities; the model with those.

    Args:
        problem: the recording before the library.
        blocks: its blocks.
        training_rows: (n,) the rows that may be looked at.
        selection: what was named from them.
        judge_each: whether they leave much where they were fitted: each is then judged by itself as well.
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
        [mechanism for mechanism in weighted_mechanisms if mechanism.probability >= ESTABLISHED_PROBABILITY],
    )


def halve_certainty(selection: Selection) -> Selection:
    """Return the naming with half of each probability's distance to even chances."""
    halved = [
        replace(n, probability=ESTABLISHED_PROBABILITY + (n.probability - ESTABLISHED_PROBABILITY) / 2)
        for n in selection.named_mechanisms
    ]
    return replace(selection, named_mechanisms=rank_mechanisms(halved))


def format_dropped_mechanisms(before: Selection, after: Selection) -> list[str]:
    """Return a sentence on the names that left-out blocks refuted, if there are any."""
    named = {name.id for name in after.named_mechanisms}
    dropped_ids = [f"`{name.id}`" for name in before.named_mechanisms if name.id not in named]
    if not dropped_ids:
        return []
    explain, are = ("explains", "is") if len(dropped_ids) == 1 else ("explain", "are")
    return [
        f"{format_list(dropped_ids)} {explain} too little of the blocks that were left out of a fit and"
        f" {are} not named."
    ]


def _restrict_selection(
    problem: LibraryProblem,
    training_rows: np.ndarray,
    selection: Selection,
    named_mechanisms: Sequence[NamedMechanism],
) -> Selection:
    """A naming with some of its names only, refitted where others went."""
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
