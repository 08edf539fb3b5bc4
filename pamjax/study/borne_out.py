"""Names held against blocks that they were not fitted to, where something stays unexplained.

What is in no catalogue is bent towards by whatever comes near: a clipped load cell looks a little like a rig
that gives, and is explained by it where it was fitted. Physics holds in blocks that it was not fitted to as
well. So where something is left, each block that naming saw is left out once, the model is refitted with a
name and without it, and

    share = 1 − Σ excess with it / Σ excess without it,        excess = χ² − samples of the left-out block,

is what the name explains of a misfit that it has not seen. Its probability is scaled by the fourth power of
that share, which is how often such names were right in recordings of pamjax's own (33 in which something
stayed unexplained, none of them among those that a proof counts): of names with a share below 0.6 none,
around 0.7 one of six, around 0.87 half. Names that fall below `ESTABLISHED` go, the least borne out first,
and what is left is refitted.
What it leaves out: blocks that naming itself never saw; those judge the whole diagnosis.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from pamjax.records.blocks import Blocks
from pamjax.study.abreast import abreast
from pamjax.study.forms import Form
from pamjax.study.naming import ESTABLISHED, ROUGH, Model, Naming, places, settle, without
from pamjax.study.problem import Problem
from pamjax.study.refit import refit
from pamjax.study.whiten import whitening

#: Power of the share with which a probability goes.
POWER = 4


def borne_out(found: Problem, laid: Blocks, used: np.ndarray, naming: Naming) -> Naming:
    """The names that explain blocks they were not fitted to, with their probabilities; the model with those.

    Args:
        found: the recording before the library.
        laid: its blocks.
        used: (n,) the rows that may be looked at.
        naming: what was named from them.
    """
    stated = {name.id: name for name in naming.names}
    model = naming.model
    while model.chosen:
        shares = borne_shares(found, laid, used, model)
        names = [
            replace(stated[id], probability=stated[id].probability * shares[id] ** POWER) for id in model.ids
        ]
        least = min(range(len(names)), key=lambda k: names[k].probability)
        if names[least].probability >= ESTABLISHED:
            names.sort(key=lambda name: (-round(name.probability, 2), -name.gain))
            return replace(naming, model=model, names=tuple(names))
        form = model.chosen[least]
        rest = tuple(other for other in model.chosen if other is not form)
        model = settle(found, used, rest, without(found, model.at.values, form))
    return replace(naming, model=naming.baseline, names=())


def borne_shares(found: Problem, laid: Blocks, used: np.ndarray, model: Model) -> dict[str, float]:
    """By name, the share of a misfit in blocks left out of a fit that it explains, 0 to 1."""
    seen = [laid.mask(k) & used for k in np.unique(laid.label[used]) if k >= 0]
    if len(seen) < 2:
        return dict.fromkeys(model.ids, 1.0)

    def excess(chosen: tuple[Form, ...], values: np.ndarray) -> float:
        one = partial(_left_out, found, used, model, chosen, values)
        return max(sum(abreast(one, seen)), 0.0)

    left = excess(model.chosen, model.at.values)
    shares = {}
    for form in model.chosen:
        rest = tuple(other for other in model.chosen if other is not form)
        before = excess(rest, without(found, model.at.values, form))
        shares[form.id] = float(np.clip(1 - left / before, 0.0, 1.0)) if before > 0 else 0.0
    return shares


def _left_out(
    found: Problem,
    used: np.ndarray,
    model: Model,
    chosen: tuple[Form, ...],
    values: np.ndarray,
    block: np.ndarray,
) -> float:
    """Excess χ² of a block under a fit to the others."""
    moved = sorted({*np.flatnonzero(found.own).tolist(), *places(found, chosen)})
    told = whitening(found, model.at.values, used & ~block)
    judged = whitening(found, model.at.values, block)
    at = refit(found, told, moved, values, 2 * ROUGH)
    left = judged(found.measured - found.shows(at.values))
    return float(left @ left) - left.size
