"""Tell apart: the power of every protocol of the menu to settle which of two mechanisms a recording shows.

A power is that of a choice between two. Where neither explains the recording there is no such choice yet, and
that is said first: what each leaves is judged as a diagnosis judges it.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.diagnosis.detect.residual_test import leaves_more, rest_of
from pamjax.diagnosis.detect.significance import Significance
from pamjax.diagnosis.library.candidates import NEEDS_TIME, forms
from pamjax.diagnosis.library.library_problem import Problem, problem
from pamjax.diagnosis.next_experiment.experiment import ENOUGH, Experiment, choose, joined, stand_in, table
from pamjax.diagnosis.next_experiment.testbed import Stage
from pamjax.diagnosis.refit.candidate_fit import Model, settle
from pamjax.errors import BadInput, refuse
from pamjax.model.registry import mechanism
from pamjax.progress import Progress, silent
from pamjax.records.case import Case, as_case
from pamjax.records.files import write_beside

#: Protocols in a note.
TOLD = 6


@dataclass(frozen=True, eq=False)
class Contest:
    """Two mechanisms before a recording, and what would tell them apart.

    Attributes:
        case: the recording.
        ids: the two.
        worse: χ² by which the second fits the recording worse than the first.
        stage: the rig and the noise that the recording shows, on which protocols are played.
        menu: every protocol with its power.
        chosen: the cheapest that is powerful enough, else the most powerful.
        left: what the first and what the second alone leave of the recording, judged.
        neither: whether both leave more than noise and the rough edges of textbook forms.
    """

    case: Case
    ids: tuple[str, str]
    worse: float
    stage: Stage
    menu: tuple[Experiment, ...]
    chosen: Experiment
    left: tuple[Significance, Significance]
    neither: bool

    @property
    def best(self) -> list[Experiment]:
        """The menu, what is most powerful first and of that the shortest."""
        return sorted(self.menu, key=lambda e: (-round(e.power, 2), e.minutes))

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers."""
        return {
            "schema": "pamjax.contest/1",
            "case": self.case.name,
            "tell": list(self.ids),
            "chi2_worse": self.worse,
            "explained": not self.neither,
            "says": self.standing,
            "left": {
                id: {"p_value": one.p_value, "rms_over_noise": math.sqrt(one.square)}
                for id, one in zip(self.ids, self.left, strict=True)
            },
            "next_experiment": self.chosen.as_dict(),
            "menu": [e.as_dict() | _more(e) for e in self.menu],
        }

    def __str__(self) -> str:
        doing = "if one of them is true all the same" if self.neither else "next"
        lines = [
            f"{self.case.name}: {self.standing}",
            f"  {doing}: {self.chosen.protocol}",
            f"  power {self.chosen.power:.2f} at a false alarm of one in twenty"
            + ("" if self.chosen.power >= ENOUGH else ", which may not be enough"),
            "",
        ]
        return "\n".join(lines + [f"  {e.power:5.2f}  {e.id:<4} {e.protocol}" for e in self.best[:TOLD]])

    @property
    def standing(self) -> str:
        """Which fits the recording better, and by how much; or that neither does."""
        first, second = self.ids
        better = first if self.worse > 0 else second
        if self.neither:
            return f"neither {first} nor {second} explains this recording: {self.leaves}"
        return f"{first} or {second}; here {better} fits better by a χ² of {abs(self.worse):.3g}"

    @property
    def leaves(self) -> str:
        """What the two leave, and what to do about it."""
        pairs = zip(self.ids, self.left, strict=True)
        left = ", ".join(f"{id} alone leaves {math.sqrt(one.square):.2g}" for id, one in pairs)
        return f"{left} times the noise (rms); `pamjax diagnose` first"


def _more(one: Experiment) -> dict[str, Any]:
    limit = one.limit if math.isfinite(one.limit) else None
    return {"id": one.id, "minutes": one.minutes, "limit": limit}


def tell(
    case: Case | str | Path,
    first: str,
    second: str,
    progress: Progress = silent,
) -> Contest:
    """Which protocol of the menu settles which of two mechanisms a recording shows.

    Args:
        case: the recording, or its folder.
        first, second: ids of the mechanisms.
        progress: called with what is being done and the share done.

    Raises:
        BadInput: for an unknown id, or one that this recording cannot show at all.
    """
    case = as_case(case)
    for id in (first, second):
        mechanism(id)
    if first == second:
        raise refuse("two mechanisms are told apart", f"{first!r} twice")
    found = problem(case)
    shown = {form.id for form in forms(found)}
    for id in (first, second):
        if id not in shown:
            raise _unseen(id, case)
    progress("fitting both", 0.1)
    baseline = bare(found)
    model = alone(found, baseline, first)
    other = stand_in(found, model, first, second)
    assert other is not None
    progress("judging both", 0.3)
    left = rest_of(found, model), rest_of(found, other)
    mismatch = rest_of(found, baseline)
    progress("playing protocols", 0.5)
    stage = Stage.of(found, model)
    menu = table(stage, model, other, (first, second))
    return Contest(
        case, (first, second), other.fair - model.fair, stage, tuple(menu), choose(menu),
        left, all(leaves_more(mismatch, one) for one in left),
    )  # fmt: skip


def bare(found: Problem) -> Model:
    """The baseline by itself, refitted under the noise that it leaves."""
    return settle(found, np.ones(found.n, dtype=bool), (), found.neutral)


def alone(found: Problem, baseline: Model, id: str) -> Model:
    """The baseline with one mechanism in its best form, refitted under the noise that this leaves."""
    begin = joined(found, baseline, [form for form in forms(found) if form.id == id])
    return settle(found, np.ones(found.n, dtype=bool), begin.chosen, begin.at.values)


def _unseen(id: str, case: Case) -> BadInput:
    if id in NEEDS_TIME and not case.recording.has_time:
        rule = f"two mechanisms are told apart after a recording that could show them, and {id!r} needs time"
        remedy = "Record strokes first: `pamjax plan` without `--tell` chooses some."
        return refuse(rule, "a table without time", case.name, remedy)
    rule = "two mechanisms are told apart that a recording could show beside its baseline"
    return refuse(rule, f"{id!r}, which this one cannot", case.name)


def save_contest(found: Contest, folder: Path) -> list[Path]:
    """Write contest.json, beside and then renamed."""
    folder.mkdir(parents=True, exist_ok=True)
    with write_beside(folder / "contest.json") as beside:
        beside.write_text(json.dumps(found.as_dict(), indent=1, allow_nan=False) + "\n")
    return [folder / "contest.json"]
