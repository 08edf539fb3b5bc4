"""Tell apart: the power of every protocol of the menu to settle which of two mechanisms a recording shows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pamjax.check import nearest, refuse
from pamjax.model.library import library, mechanism
from pamjax.records.case import Case
from pamjax.study.experiment import ENOUGH, Experiment, choose, stand_in, table
from pamjax.study.forms import forms
from pamjax.study.naming import Model, begun, settle
from pamjax.study.problem import Problem, problem
from pamjax.study.signature import signatures
from pamjax.study.stage import Stage


@dataclass(frozen=True, eq=False)
class Contest:
    """Two mechanisms before a recording, and what would tell them apart.

    Attributes:
        case: name of the recording.
        ids: the two.
        worse: χ² by which the second fits the recording worse than the first.
        menu: every protocol with its power.
        chosen: the cheapest that is powerful enough, else the most powerful.
    """

    case: str
    ids: tuple[str, str]
    worse: float
    menu: tuple[Experiment, ...]
    chosen: Experiment

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers."""
        return {
            "schema": "pamjax.contest/1",
            "case": self.case,
            "tell": list(self.ids),
            "chi2_worse": self.worse,
            "next_experiment": self.chosen.as_dict(),
            "menu": [e.as_dict() | _more(e) for e in self.menu],
        }

    def __str__(self) -> str:
        first, second = self.ids
        by = abs(self.worse)
        better = first if self.worse > 0 else second
        lines = [
            f"{self.case}: {first} or {second}; here {better} fits better by a χ² of {by:.3g}",
            f"  next: {self.chosen.protocol}",
            f"  power {self.chosen.power:.2f} at a false alarm of one in twenty"
            + ("" if self.chosen.power >= ENOUGH else ", which may not be enough"),
            "",
        ]
        best = sorted(self.menu, key=lambda e: (-round(e.power, 2), e.minutes))
        return "\n".join(lines + [f"  {e.power:5.2f}  {e.id:<4} {e.protocol}" for e in best[:6]])


def _more(one: Experiment) -> dict[str, Any]:
    limit = one.limit if math.isfinite(one.limit) else None
    return {"id": one.id, "minutes": one.minutes, "limit": limit}


def tell(case: Case, first: str, second: str) -> Contest:
    """Which protocol of the menu settles which of two mechanisms a recording shows.

    Args:
        case: the recording.
        first, second: ids of the mechanisms.

    Raises:
        BadInput: for an unknown id, or one that this recording cannot show at all.
    """
    for id in (first, second):
        mechanism(id)
    if first == second:
        raise refuse("two mechanisms are told apart", f"{first!r} twice", remedy=nearest("", library()))
    found = problem(case)
    model, other = contenders(found, first, second)
    menu = table(Stage.of(found, model), model, other, (first, second))
    return Contest(case.name, (first, second), other.at.cost - model.at.cost, tuple(menu), choose(menu))


def contenders(found: Problem, first: str, second: str) -> tuple[Model, Model]:
    """The baseline with either mechanism, both refitted under one noise."""
    model = _with(found, first)
    other = stand_in(found, model, first, second)
    if other is None:
        raise _unseen(second)
    return model, other


def _with(found: Problem, id: str) -> Model:
    """The baseline with a mechanism in its best form, refitted."""
    used = np.ones(found.n, dtype=bool)
    bare = settle(found, used, (), found.neutral)
    candidates = [form for form in forms(found) if form.id == id]
    if not candidates:
        raise _unseen(id)
    best = max(signatures(found, bare.white, bare.at, candidates), key=lambda s: s.gain)
    return settle(found, used, (best.form,), begun(found, bare.at.values, best.form, best.amplitudes))


def _unseen(id: str):
    return refuse(f"{id!r} must be able to show in the recording", "a map without time, or its own baseline")
