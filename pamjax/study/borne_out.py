"""Names held against blocks that they were not fitted to.

What is in no catalogue is bent towards by whatever comes near: a clipped load cell looks a little like a rig
that gives, and is explained by it where it was fitted. Physics holds in blocks that it was not fitted to as
well. So each block that naming saw is left out once (`pamjax/study/unseen.py`). What all names together
explain there, against the bare baseline, decides whether any of them stands, however little they leave where
they were fitted: three names bend to a ripple until only noise is left. What leaves more than a sixth of
unseen blocks is something else.

Where much is left where they were fitted, be it known from noise or not, each name is judged as well, once,
beside everything that came near (judged again after its neighbours have gone, a name has their misfit held
against it as well): its probability counts for its share, and names that fall below `ESTABLISHED` go.

Of those that stay beside something unexplained only what a course in time shows is told, with half the
certainty that is left. Ends that taper, a zero, a gain, a rig that gives move force and diameter with
pressure and length alone, and so does most of what is in no catalogue; they bend to it in unseen blocks too.
So does a drift where one setting comes after another. Friction or relaxing rubber cannot.

What it leaves out: a name beside which something in no catalogue is half as large is lost, and so is a
static one whose equation is far off: from one recording they are not told from what is in none. The sixth is
a judgement, made on recordings of pamjax's own whose effects depart from their equations, or that hold
something in no catalogue, alone or beside an effect; those that a proof counts were not among them. What is
told beside something unexplained was decided by the names of all proofs before the last one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pamjax.infer.determine import listed
from pamjax.records.blocks import Blocks
from pamjax.study.forms import NEEDS_TIME
from pamjax.study.naming import ESTABLISHED, Name, Naming, ranked
from pamjax.study.problem import Problem
from pamjax.study.settled import settle, without
from pamjax.study.unseen import Unseen

#: Mechanisms that only a course in time shows; a drift goes with settings that come in turn.
OF_HISTORY = NEEDS_TIME - {"force_drift"}


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


def doubted(found: Problem, used: np.ndarray, naming: Naming) -> Naming:
    """Names beside something unexplained: those that only a course in time shows, each with half the
    distance to even chances.

    Args:
        found: the recording before the library.
        used: (n,) the rows that may be looked at.
        naming: what was borne out.
    """
    shown = [name for name in naming.names if {name.id, *name.ties} <= OF_HISTORY]
    halved = [replace(n, probability=ESTABLISHED + (n.probability - ESTABLISHED) / 2) for n in shown]
    return _kept(found, used, naming, halved)


def untold(before: Naming, after: Naming) -> list[str]:
    """A sentence on the names that are not told beside something unexplained, if there are any."""
    told = {name.id for name in after.names}
    names = [f"`{name.id}`" for name in before.names if name.id not in told]
    if not names:
        return []
    come, are = ("comes", "is") if len(names) == 1 else ("come", "are")
    return [
        f"{listed(names)} {come} near what is unexplained and {are} not named: something in no catalogue, as"
        " a stop in the way, would look like that as well."
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
