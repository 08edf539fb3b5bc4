"""Plan: which runs to make next, what they cost, and what they will settle. A verb of design."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pamjax.errors import at_least, nearest, refuse
from pamjax.model.parameters import meaning
from pamjax.planning.bench import Means, means_of
from pamjax.planning.information import Knowledge, knowledge
from pamjax.planning.optimal_design import Menu, variance_of, volume_of
from pamjax.planning.runs import CYCLES, Run, isobars, runs
from pamjax.records.case import Case, as_muscle
from pamjax.records.files import write_beside
from pamjax.records.reading.muscle_toml import Entry
from pamjax.units import in_unit, number_in, show

#: What is wanted where nothing is said: the stiffness of the threads, to so much of itself.
WANTED, SHARE = ("thread.modulus", "thread.stiffness"), 0.05

#: Goal that means the muscle's numbers all together.
ALL = "all"


@dataclass(frozen=True)
class Settled:
    """What is known of a number, SI: its expected standard deviation before and after."""

    value: float
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Plan:
    """Which runs to make, and what they will settle.

    Attributes:
        known: what is believed before.
        goal: the number that is wanted, or "all".
        wanted: standard deviation that is enough, SI; 0 for as small as possible.
        chosen: how often each run is made, in the order to make them in.
        minutes: what they cost.
        settled: the muscle's numbers before and after.
        reached: whether the goal is expected to be reached.
        alone: by channel that there is besides others, the goal's standard deviation (SI) and the minutes
            of the best plan with that channel only.
        isobars: the goal's standard deviation after ten isobars in the same minutes, SI.
    """

    known: Knowledge
    goal: str
    wanted: float
    chosen: tuple[tuple[int, Run], ...]
    minutes: float
    settled: dict[str, Settled]
    reached: bool
    alone: dict[str, tuple[float, float]]
    isobars: float

    @property
    def rows(self) -> int:
        """Samples that will be recorded."""
        return sum(count * run.pressure.size for count, run in self.chosen)

    @property
    def sd(self) -> float:
        """Expected standard deviation of what is wanted, SI; of "all", of the first number."""
        return self.settled[next(iter(self.settled)) if self.goal == ALL else self.goal].after

    def schedule(self) -> pd.DataFrame:
        """What to command, sample by sample, with the run each sample belongs to."""
        parts = [run for count, run in self.chosen for _ in range(count) if run.pressure.size]
        step, clock, tables = 1 / self.known.means.rate, 0.0, []
        for k, run in enumerate(parts, 1):
            tables.append(
                pd.DataFrame(
                    {
                        "time [s]": clock + step * np.arange(run.pressure.size),
                        "pressure [kPa]": run.pressure / 1e3,
                        "length [mm]": run.length * 1e3,
                        "cycle": k,
                    }
                )
            )
            clock += 60 * run.minutes
        return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()

    def as_dict(self) -> dict[str, Any]:
        """The plan as plain numbers, in the units a person reads."""

        def told(name: str, one: Settled) -> dict[str, Any]:
            about = meaning(name)
            scale = in_unit(about.show)
            return {
                "value": one.value / scale,
                "sd_before": one.before / scale if math.isfinite(one.before) else None,
                "sd_after": one.after / scale,
                "unit": about.show,
            }

        from pamjax.planning.report import sentence

        scale = 1.0 if self.goal == ALL else in_unit(meaning(self.goal).show)
        return {
            "schema": "pamjax.plan/1",
            "muscle": self.known.entry.name,
            "says": sentence(self),
            "goal": {"number": self.goal, "sd": self.wanted / scale, "reached": self.reached},
            "runs": [{"count": n, "run": run.says, "minutes": n * run.minutes} for n, run in self.chosen],
            "minutes": self.minutes,
            "rows": self.rows,
            "settles": {name: told(name, one) for name, one in self.settled.items()},
            "alone": {c: {"sd": sd / scale, "minutes": m} for c, (sd, m) in self.alone.items()},
            "ten_isobars_in_the_same_time": {"sd": self.isobars / scale},
            "recording_missed_by": dict(self.known.missed),
            "assumed": dict(self.known.means.assumed),
        }

    def __str__(self) -> str:
        from pamjax.planning.report import note

        return note(self)


def plan(
    muscle: Entry | Case | str | Path,
    rig: Path | Means | None = None,
    goal: str | None = None,
    to: str | float | None = None,
    *,
    minutes: float | None = None,
    law: str | None = None,
    seed: int = 0,
) -> Plan:
    """Choose the next runs of a muscle on a rig.

    Args:
        muscle: what muscle.toml says, or a case with what was recorded already; or where either lies.
        rig: a TOML file with a table [rig], or the means themselves; None takes the
            sensors of muscle.toml, and the channels of the case.
        goal: the number to be known, as "thread.modulus", or "all"; None takes the threads' stiffness.
        to: its wanted standard deviation, "5 %" or "4 GPa" (a bare number: SI); None for 5 %, and as small
            as possible for "all".
        minutes: that there are; None takes the rig's.
        law: thread law; None takes the baseline's.
        seed: of the truths over which a promise is averaged.

    Raises:
        BadInput: for an unknown goal, or one that no fit would move.
    """
    at_least("seed", seed, 0)
    said = as_muscle(muscle)
    case, entry = (said, said.entry) if isinstance(said, Case) else (None, said)
    seen = {"recorded": case.recording.channels, "highest": _highest(case)} if case else {}
    means = rig if isinstance(rig, Means) else means_of(entry, rig, **seen, minutes=minutes)
    known = knowledge(entry, means, law, case)
    goal = _goal(known, goal)
    wanted = _wanted(known, goal, to)
    menu, offered = _menu(known, goal, wanted, seed)
    counts = menu.choose()
    after = _sds(known, menu.known(counts))
    cost = float(counts @ menu.minutes)
    alone = {}
    if len(means.channels) > 1 and goal != ALL:
        for channel in means.channels:
            one = knowledge(entry, means.alone(channel), law, case)
            its, _ = _menu(one, goal, wanted, seed)
            best = its.choose()
            alone[channel] = (_sds(one, its.known(best))[one.place(goal)], float(best @ its.minutes))
    usual = _isobars(known, menu, cost)
    places = (
        known.own if goal == ALL else [known.place(goal), *(k for k in known.own if k != known.place(goal))]
    )
    before = _sds(known, menu.before)
    return Plan(
        known=known,
        goal=goal,
        wanted=wanted,
        chosen=tuple((int(n), run) for n, run in zip(counts, offered, strict=True) if n),
        minutes=cost,
        settled={
            known.at.names[k]: Settled(*(float(x[k]) for x in (known.mean, before, after))) for k in places
        },
        reached=bool(menu.value(counts) <= menu.goal) if wanted else True,
        alone=alone,
        isobars=float(usual[places[0]]),
    )  # fmt: skip


def _highest(case: Case) -> float:
    """Highest pressure that was recorded, Pa."""
    return float(np.max(case.recording.pressure[case.recording.usable]))


def _menu(known: Knowledge, goal: str, wanted: float, seed: int) -> tuple[Menu, list[Run]]:
    offered = runs(known.means, known.entry.rest_length.value)
    shortest = min(run.minutes for run in offered if run.pressure.size)
    if known.means.minutes < shortest:
        rule = f"the shortest run of this rig takes {shortest:.2g} min"
        raise refuse(rule, f"{known.means.minutes:g} min for all", remedy="Give it more minutes.")
    truths = known.truths(seed=seed)
    each = np.stack([known.of_runs(offered, values) for values in truths], axis=1)
    k = 0 if goal == ALL else known.place(goal)
    return Menu(
        before=np.broadcast_to(known.before, (len(truths), *known.before.shape)),
        each=each,
        minutes=np.array([run.minutes for run in offered]),
        once=np.array([not run.again for run in offered]),
        criterion=volume_of(known.own) if goal == ALL else variance_of(k),
        budget=known.means.minutes,
        goal=0.0 if goal == ALL else (wanted / known.scale[k]) ** 2,
    ), offered


def _sds(known: Knowledge, information: np.ndarray) -> np.ndarray:
    """(p,) expected standard deviations, SI: the root of the mean variance over the truths."""
    variance = np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1).mean(axis=0)
    return np.sqrt(variance) * known.scale


def _isobars(known: Knowledge, menu: Menu, minutes: float) -> np.ndarray:
    """(p,) standard deviations after ten isobars, slower or faster so that they take as long, SI."""
    usual = isobars(known.means, known.entry.rest_length.value)
    once = usual[::CYCLES]
    each = CYCLES * np.stack([known.of_runs(once, values).sum(axis=0) for values in known.truths()])
    share = minutes / sum(run.minutes for run in usual)
    return _sds(known, menu.before + share * each)


def _goal(known: Knowledge, goal: str | None) -> str:
    own = [known.at.names[k] for k in known.own]
    if goal is None:
        goal = next((name for name in WANTED if name in own), ALL)
    if goal != ALL and goal not in own:
        rule = f"{goal!r} is no number that a fit of this muscle moves"
        raise refuse(rule, remedy=nearest(goal, [*own, ALL]))
    return goal


def _wanted(known: Knowledge, goal: str, to: str | float | None) -> float:
    if goal == ALL:
        if to is not None:
            raise refuse("all numbers together have no wanted standard deviation", f"{to} in --to")
        return 0.0
    value = abs(float(known.mean[known.place(goal)]))
    if to is None:
        return SHARE * value
    if isinstance(to, str) and to.strip().endswith("%"):
        wanted = float(number_in(to.strip()[:-1], "1", "--to")) / 100 * value
    else:
        wanted = number_in(str(to), meaning(goal).unit, "--to")
    if not 0 < wanted < math.inf:
        raise refuse("a wanted standard deviation is positive", show(wanted, meaning(goal).show), "--to")
    return wanted


def save_plan(found: Plan, folder: Path) -> list[Path]:
    """Write plan.json and schedule.csv, each beside and then renamed."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        "plan.json": json.dumps(found.as_dict(), indent=1, allow_nan=False) + "\n",
        "schedule.csv": found.schedule().to_csv(index=False, float_format="%.6g"),
    }
    for name, text in texts.items():
        with write_beside(folder / name) as beside:
            beside.write_text(text)
    return [folder / name for name in texts]


def sd_after(found: Plan, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Minutes spent and a number's expected standard deviation (SI) before and after each run of a plan."""
    known, k = found.known, found.known.place(name)
    done = [run for count, run in found.chosen for _ in range(count)]
    if not done:
        return np.zeros(1), _sds(known, known.before[None])[k : k + 1]
    told = np.stack([known.of_runs(done, values) for values in known.truths()], axis=1)
    so_far = known.before + np.concatenate([np.zeros_like(told[:1]), np.cumsum(told, axis=0)])
    sds = np.array([_sds(known, information)[k] for information in so_far])
    return np.cumsum([0.0, *(run.minutes for run in done)]), sds
