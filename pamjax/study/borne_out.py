"""Names held against blocks that they were not fitted to, where much is left.

What is in no catalogue is bent towards by whatever comes near: a clipped load cell looks a little like a rig
that gives, and is explained by it where it was fitted. Physics holds in blocks that it was not fitted to as
well. So where much is left, be it known from noise or not (four names bend to an obstacle until that is in
doubt), each block that naming saw is left out once, the model is refitted with a name and without it, and

    share = 1 − Σ excess with it / Σ excess without it,        excess = χ² − samples of the left-out block,

is what the name explains of a misfit that it has not seen, beside all that is not explained at all. Its
probability counts for that share, and names that fall below `ESTABLISHED` go. Those that stay beside
something unexplained are told with half the certainty that is left: force that grows with length, in ramps
at one length after another, is borne out as a drift in time as well. Each is judged once, beside everything
that came near: judged again after its neighbours have gone, a name has their misfit held against it as well.
The share of all names together, against the bare baseline, decides whether any of them stands:
what leaves more than a sixth of blocks that it has not seen is something else.

A block that alone knows of a name's number says nothing of it, as nobody else could foretell it; an error of
the lab's own that only the left-out block knows of (of the ruler, at that length) is made up for first.

What it leaves out: a name beside which something in no catalogue is half as large is lost: from one
recording it is not told from that. The sixth is a judgement, made on recordings of pamjax's own whose effects
depart from their equations, or that hold something in no catalogue, alone or beside an effect; those that a
proof counts were not among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pamjax.records.blocks import Blocks
from pamjax.study.abreast import abreast
from pamjax.study.forms import Form
from pamjax.study.naming import ESTABLISHED, Naming, ranked
from pamjax.study.problem import Problem
from pamjax.study.refit import Refit, refit
from pamjax.study.search import ROUGH
from pamjax.study.settled import Model, places, settle, without
from pamjax.study.whiten import Whitening

#: Share of a misfit in unseen blocks that all names together must explain.
TOGETHER = 5 / 6
#: Blocks below which nothing is tried: a single other setting foretells none.
FEWEST = 3
#: Share of what a recording knows of a number below which the rest of it, without a block, knows nothing.
UNKNOWN = 0.05


def borne_out(found: Problem, laid: Blocks, used: np.ndarray, naming: Naming) -> Naming:
    """The names that explain blocks they were not fitted to, with their probabilities; the model with those.

    Args:
        found: the recording before the library.
        laid: its blocks.
        used: (n,) the rows that may be looked at.
        naming: what was named from them.
    """
    together, shares = borne_shares(found, laid, used, naming.model)
    borne = [replace(name, probability=name.probability * shares[name.id]) for name in naming.names]
    kept = tuple(name for name in borne if name.probability >= ESTABLISHED)
    if together < TOGETHER or not kept:
        return replace(naming, model=naming.baseline, names=())
    model, values = naming.model, naming.model.at.values
    if len(kept) < len(borne):
        ids = {name.id for name in kept}
        for form in model.chosen:
            values = values if form.id in ids else without(found, values, form)
        model = settle(found, used, [form for form in model.chosen if form.id in ids], values)
    return replace(naming, model=model, names=ranked(kept))


def doubted(naming: Naming) -> Naming:
    """Names beside something unexplained, each with half the distance to even chances."""
    halved = [replace(n, probability=ESTABLISHED + (n.probability - ESTABLISHED) / 2) for n in naming.names]
    return replace(naming, names=ranked(halved))


def borne_shares(
    found: Problem, laid: Blocks, used: np.ndarray, model: Model
) -> tuple[float, dict[str, float]]:
    """The share of a misfit in blocks left out of a fit that all names explain, and that of each, 0 to 1."""
    seen = used & np.isfinite(found.measured).any(axis=0)
    split = [
        (model.white.of_rows(seen & ~laid.mask(k)), model.white.of_rows(seen & laid.mask(k)))
        for k in np.unique(laid.label[seen])
        if k >= 0
    ]
    if len(split) < FEWEST:
        return 1.0, dict.fromkeys(model.ids, 1.0)
    whole = abreast(partial(_left_out, found, model.chosen, model.at.values), split)
    told = {form.id: [_known(found, model.at, one.at, form) for one in whole] for form in model.chosen}

    def share(gone: Sequence[Form]) -> float:
        rest, values = tuple(form for form in model.chosen if form not in gone), model.at.values
        for form in gone:
            values = without(found, values, form)
        bare = abreast(partial(_left_out, found, rest, values), split)
        left, before = (np.array([one.excess for one in fits]) for fits in (whole, bare))
        fair = np.all([told[form.id] for form in gone], axis=0)
        return _share(left[fair].sum(), before[fair].sum(), before.sum())

    shares = {form.id: share((form,)) for form in model.chosen}
    return shares[model.ids[0]] if len(shares) == 1 else share(model.chosen), shares


def _share(left: float, before: float, everywhere: float) -> float:
    """The share of what was left before that is not left now; one where there is nothing to try it on."""
    if before <= UNKNOWN * max(everywhere, 0.0):
        return 1.0
    return float(np.clip(1 - max(left, 0.0) / before, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class _LeftOut:
    """A fit without a block, and the excess χ² of the block under it."""

    at: Refit
    excess: float


def _left_out(
    found: Problem, chosen: Sequence[Form], values: np.ndarray, split: tuple[Whitening, Whitening]
) -> _LeftOut:
    told, judged = split
    own = np.flatnonzero(found.own).tolist()
    moved = sorted({*own, *places(found, chosen)})
    at = refit(found, told, moved, values, 2 * ROUGH)
    alone = [k for k in own if not at.jacobian[:, at.moved.index(k)].any()]
    last = refit(found, judged, alone, at.values, ROUGH) if alone else None
    left = last.residual if last else judged(found.measured - found.shows(at.values))
    left = np.nan_to_num(left, nan=1e3)
    return _LeftOut(at, float(left @ left) - left.size)


def _known(found: Problem, whole: Refit, told: Refit, form: Form) -> bool:
    """Whether a fit without a block still knows of a form's amplitudes."""
    for name in form.amplitudes:
        k = found.place(name)
        all_of_it = float(np.sum(whole.jacobian[:, whole.moved.index(k)] ** 2))
        if float(np.sum(told.jacobian[:, told.moved.index(k)] ** 2)) > UNKNOWN * all_of_it:
            return True
    return False
