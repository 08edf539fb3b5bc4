"""The report of a plan: what to do and what it settles first, then every run, then what was assumed."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

from pamjax.channels import DISPLAY_UNIT
from pamjax.model.parameters import meaning
from pamjax.planning.plan import ALL, Plan, Settled
from pamjax.planning.report import (
    alone_words,
    isobars_words,
    known_to,
    left_out,
    less_words,
    minutes_words,
    missed_words,
    roughly,
)
from pamjax.units import show
from pamjax.view.figures.plan import Course, command_figure, known_figure
from pamjax.view.reports.page import picture, write_page


def save_report(plan: Plan, course: Course, path: str | Path, command: str = "", checksum: str = "") -> Path:
    """Write the report of a plan.

    Args:
        plan: the plan.
        course: of its goal, as it is drawn.
        path: the HTML file; its folder must exist.
        command: what repeats it, in a shell.
        checksum: SHA-256 of what the muscle was read from.
    """
    return write_page(
        path,
        "plan.html.jinja",
        title=headline(plan),
        kicker=f"Plan for {plan.known.entry.name} · {plan.known.law} threads",
        answer=answer(plan),
        known=picture(partial(known_figure, plan, course), "known"),
        diamonds=bool(plan.alone),
        commands=picture(partial(command_figure, plan), "commands"),
        runs=[[run.says, str(count), minutes_words(count * run.minutes)] for count, run in plan.chosen],
        settles=[_settled(name, one) for name, one in plan.settled.items()],
        beside=less_words(plan),
        rig=_rig(plan),
        off=[_off(name, sd) for name, sd in plan.known.means.assumed.items()],
        left_out=f"{_upper(left_out(plan))}.",
        checksum=checksum,
        command=command or "pamjax.plan(...)",
    )


def headline(plan: Plan) -> str:
    """The answer in a line."""
    if missed_words(plan):
        return "Diagnose first: the muscle misses its recording"
    if plan.goal == ALL:
        return f"{minutes_words(plan.minutes)} for all numbers together"
    if not plan.chosen and plan.reached:
        return f"{plan.goal} is known {known_to(plan, plan.sd)} already"
    if not plan.reached:
        return f"No {minutes_words(plan.known.means.minutes)} on this rig tell {plan.goal} as wanted"
    return f"{minutes_words(plan.minutes)} tell {plan.goal} {known_to(plan, plan.sd)}"


def answer(plan: Plan) -> list[str]:
    """What to do and what it will settle; what less would do. First, whether a promise is allowed."""
    missed = missed_words(plan)
    if not missed:
        return list(_promise(plan))
    known = f"; {plan.goal} would be known {roughly(plan)}" if plan.goal != ALL else ""
    return [f"{_upper(missed)}: no standard deviation is promised.", f"Were it right: {_runs(plan)}{known}."]


def _runs(plan: Plan) -> str:
    """How many runs and checks, and what they cost."""
    runs = sum(count for count, run in plan.chosen if run.pressure.size)
    checks = sum(count for count, run in plan.chosen if not run.pressure.size)
    rig = f" and {_many(checks, 'check')} of the rig" if checks else ""
    return f"{_many(runs, 'run')}{rig} ({minutes_words(plan.minutes)}, {plan.rows} rows)"


def _promise(plan: Plan) -> tuple[str, str]:
    if plan.goal == ALL:
        return f"Make {_runs(plan)}.", f"{_upper(isobars_words(plan))}."
    if not plan.chosen and plan.reached:
        return "Nothing is to be measured for that.", "Wish for more with `--to`, or for another number."
    one, unit = plan.settled[plan.goal], meaning(plan.goal).show
    before = f"± {show(one.before, unit, 2)}" if math.isfinite(one.before) else "unknown"
    first = f"Make {_runs(plan)}: {plan.goal}, now {before}, is then known {known_to(plan, plan.sd)}."
    return first, f"{_upper('; '.join(alone_words(plan)) or isobars_words(plan))}."


def _many(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def _upper(words: str) -> str:
    return words[:1].upper() + words[1:]


def _settled(name: str, one: Settled) -> list[str]:
    about = meaning(name)
    before = f"± {show(one.before, about.show, 2)}" if math.isfinite(one.before) else "unknown"
    return [name, show(one.value, about.show), before, f"± {show(one.after, about.show, 2)}", about.about]


def _rig(plan: Plan) -> list[list[str]]:
    means = plan.known.means
    noise = {"force": means.force, "diameter": means.diameter}
    rows = [
        ["highest pressure", show(means.pressure, "kPa", 3)],
        ["largest contraction", f"{means.contraction:.0%}"],
        ["speed of a stroke", f"{1e3 * means.speed:.3g} mm/s"],
        ["samples a second", f"{means.rate:.3g}"],
        ["between two runs", f"{means.setup:.3g} s"],
        ["time there is", minutes_words(means.minutes)],
    ]
    rows += [
        [f"noise of {name}, a sample", show(sd, DISPLAY_UNIT[name], 2) if sd is not None else "not measured"]
        for name, sd in noise.items()
    ]
    length = ["noise of length, a sample", show(means.ruler, "mm", 2)]
    if means.setting:
        length = ["error of length, a setting", show(means.setting, "mm", 2)]
    return [*rows, ["noise of pressure, a sample", show(means.gauge, "kPa", 2)], length]


def _off(name: str, sd: float) -> list[str]:
    about = meaning(name)
    return [name, f"± {show(sd, about.show, 2)}", about.about]
