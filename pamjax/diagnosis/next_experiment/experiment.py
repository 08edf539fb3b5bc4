"""What to do next: the protocol that separates what this recording cannot tell apart, with its power."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pamjax.diagnosis.detect.score_test import signatures
from pamjax.diagnosis.library.candidates import Form, forms
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.next_experiment.power import prospect
from pamjax.diagnosis.next_experiment.protocols import MENU
from pamjax.diagnosis.next_experiment.testbed import Stage, contrast
from pamjax.diagnosis.refit.candidate_fit import Model, begun, freed, without
from pamjax.diagnosis.refit.least_squares import refit
from pamjax.diagnosis.select.search import FINAL, ROUGH
from pamjax.diagnosis.select.selection import Name

#: Power with which a protocol is enough.
ENOUGH = 0.9

#: Forms of a mechanism that are refitted, and the shares of their linear amplitudes from which they begin.
FORMS, SHARES = 3, (1.0, 0.1)

#: Most rivals of one name, and most pairs, for which a protocol is sought.
RIVALS, PAIRS = 2, 4


@dataclass(frozen=True)
class Experiment:
    """A protocol that separates names.

    Attributes:
        protocol: what to do, one sentence.
        separates: the ids.
        power: chance that it settles which, at a false alarm of one in twenty.
        minutes: what it costs.
        id: of the protocol in the menu.
        limit: χ² by which the second must fit worse than it did before, to be given up.
    """

    protocol: str
    separates: tuple[str, ...]
    power: float
    minutes: float = 0.0
    id: str = ""
    limit: float = math.inf

    def as_dict(self) -> dict[str, Any]:
        """As it stands in diagnosis.json."""
        return {"protocol": self.protocol, "separates": list(self.separates), "power": self.power}


def experiments(found: Problem, model: Model, names: Sequence[Name]) -> list[Experiment]:
    """For each name that is tied, the cheapest protocol that separates it from its rivals, or the best.

    Args:
        found: the recording before the library.
        model: the named model, refitted.
        names: what was named, with its ties.

    Returns:
        an experiment for each protocol that is chosen; none where nothing is tied.
    """
    pairs = [
        (name.id, rival)
        for name in names
        for rival in sorted(name.ties, key=lambda id, name=name: name.rivals.get(id, np.inf))[:RIVALS]
    ]
    pairs = list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1][:PAIRS]
    if not pairs:
        return []
    stage = Stage.of(found, model)
    best = {}
    for name, rival in pairs:
        other = stand_in(found, model, name, rival)
        if other is not None:
            best[name, rival] = choose(table(stage, model, other, (name, rival)))
    return _together(list(best.values()))


def _together(single: list[Experiment]) -> list[Experiment]:
    """One entry for each protocol: what it separates, at the least of the powers."""
    out: dict[str, Experiment] = {}
    for one in single:
        known = out.get(one.protocol)
        if known is not None:
            ids = tuple(dict.fromkeys((*known.separates, *one.separates)))
            one = dataclasses.replace(one, separates=ids, power=min(one.power, known.power))
        out[one.protocol] = one
    return list(out.values())


def choose(of_menu: Sequence[Experiment]) -> Experiment:
    """The cheapest that is powerful enough, else the most powerful."""
    enough = [one for one in of_menu if one.power >= ENOUGH]
    return min(enough, key=lambda e: e.minutes) if enough else max(of_menu, key=lambda e: e.power)


def table(stage: Stage, model: Model, other: Model, ids: tuple[str, str]) -> list[Experiment]:
    """Every protocol of the menu with its power to separate two models."""
    out = []
    for protocol in MENU:
        chance, limit = prospect(*contrast(stage, protocol, model, other))
        minutes = protocol.minutes(stage.rig)
        says = f"{protocol.says(stage.rig)} ({_duration(minutes)})."
        out.append(Experiment(says, ids, round(chance, 3), minutes, protocol.id, limit))
    return out


def _duration(minutes: float) -> str:
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.0f} h"


def stand_in(found: Problem, model: Model, name: str, rival: str) -> Model | None:
    """The model with a rival in the place of a name, refitted; None where no form of it shows."""
    form = next((f for f in model.chosen if f.id == name), None)
    candidates = [f for f in forms(found) if f.id == rival]
    if form is None or not candidates:
        return None
    rest = tuple(f for f in model.chosen if f is not form)
    bare = refit(found, model.white, _moved(found, rest), without(found, model.at.values, form))
    return joined(found, Model(rest, model.white, bare), candidates)


def joined(found: Problem, bare: Model, candidates: Sequence[Form]) -> Model:
    """A model with one more form, the best of some after a refit of each.

    The form that is best in the linear limit may be one whose amplitude lies far beyond its limits, where a
    refit then stays: several are refitted, each from a part of its amplitude as well.
    """
    scored = sorted(signatures(found, bare.white, bare.at, candidates), key=lambda s: -s.gain)[:FORMS]
    rough = []
    for one in scored:
        chosen = (*bare.chosen, one.form)
        for share in SHARES:
            values = begun(found, bare.at.values, one.form, share * one.amplitudes)
            at = refit(found, bare.white, _moved(found, chosen), values, ROUGH)
            rough.append(Model(chosen, bare.white, at))
    best = sorted(rough, key=lambda m: m.at.cost)[:FINAL]
    ends = [freed(found, m.chosen, m.white, refit(found, m.white, m.at.moved, m.at.values)) for m in best]
    return min(ends, key=lambda m: m.fair)


def _moved(found: Problem, chosen: Sequence[Form]) -> list[int]:
    places = {found.place(name) for form in chosen for name in form.moves}
    return sorted({*np.flatnonzero(found.own).tolist(), *places})
