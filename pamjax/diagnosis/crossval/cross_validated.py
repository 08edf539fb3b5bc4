"""Names held against blocks that they were not fitted to.

What is in no catalogue is bent towards by whatever comes near: a clipped load cell looks a little like a rig
that gives, and is explained by it where it was fitted. Physics holds in blocks that it was not fitted to as
well. So each block that naming saw is left out once (`explained_fraction.py`). What all names together
explain there, against the bare baseline, decides whether any of them stands, however little they leave where
they were fitted: three names bend to a ripple until only noise is left. What leaves more than a sixth of
unseen blocks is something else.

Where much is left where they were fitted, be it known from noise or not, each name is judged as well, once,
beside everything that came near (judged again after its neighbours have gone, a name has their misfit held
against it as well): its probability counts for its share, and names that fall below `ESTABLISHED` go.

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

from pamjax.diagnosis.crossval.explained_fraction import Unseen
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import settle, without
from pamjax.diagnosis.select.selection import ESTABLISHED, Name, Naming, ranked
from pamjax.infer.fitting.identifiability import listed
from pamjax.records.blocks import Blocks


def borne_out(found: Problem, laid: Blocks, used: np.ndarray, naming: Naming, *, much: bool) -> Naming:
    """The names that explain blocks they were not fitted to, with their probabilities; the model with those.

    Args:
        found: the recording before the library.
        laid: its blocks.
        used: (n,) the rows that may be looked at.
        naming: what was named from them.
        much: whether they leave much where they were fitted: each is then judged by itself as well.
    """
    unseen = Unseen.by(found, laid, used, naming.model)
    if unseen.bent:
        return _kept(found, used, naming, [])
    if not much:
        return naming
    shares = unseen.shares
    borne = [replace(name, probability=name.probability * shares[name.id]) for name in naming.names]
    return _kept(found, used, naming, [name for name in borne if name.probability >= ESTABLISHED])


def doubted(naming: Naming) -> Naming:
    """Return the naming with half of each probability's distance to even chances."""
    halved = [replace(n, probability=ESTABLISHED + (n.probability - ESTABLISHED) / 2) for n in naming.names]
    return replace(naming, names=ranked(halved))


def untold(before: Naming, after: Naming) -> list[str]:
    """Return a sentence on the names that left-out blocks refuted, if there are any."""
    named = {name.id for name in after.names}
    names = [f"`{name.id}`" for name in before.names if name.id not in named]
    if not names:
        return []
    explain, are = ("explains", "is") if len(names) == 1 else ("explain", "are")
    return [
        f"{listed(names)} {explain} too little of the blocks that were left out of a fit and {are} not named."
    ]


def _kept(found: Problem, used: np.ndarray, naming: Naming, names: Sequence[Name]) -> Naming:
    """A naming with some of its names only, refitted where others went."""
    ids = {name.id for name in names}
    if len(ids) == len(naming.model.chosen):
        return replace(naming, names=ranked(names))
    values = naming.values
    for form in naming.model.chosen:
        values = values if form.id in ids else without(found, values, form)
    chosen = [form for form in naming.model.chosen if form.id in ids]
    model = settle(found, used, chosen, values) if chosen else naming.baseline
    return replace(naming, model=model, names=ranked(names), near=None, before=None)
