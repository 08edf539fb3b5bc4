"""A plan, drawn: how well the goal is known after each run, and what to command over time."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.model.parameters import meaning
from pamjax.planning.plan import ALL, Plan, sd_after
from pamjax.planning.report import minutes_words, missed_words
from pamjax.units import in_unit, show
from pamjax.view.figures.layout import mark
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, save_png, theme


@dataclass(frozen=True, eq=False)
class Course:
    """A number's expected standard deviation, run by run.

    Attributes:
        name: of the number; of "all" the first.
        unit: in which it is drawn.
        minutes: spent, before the first run and after each.
        sds: expected, in that unit.
    """

    name: str
    unit: str
    minutes: np.ndarray
    sds: np.ndarray

    @classmethod
    def of(cls, plan: Plan) -> Course:
        """The course of a plan's goal."""
        name = next(iter(plan.settled)) if plan.goal == ALL else plan.goal
        unit = meaning(name).show
        minutes, sds = sd_after(plan, name)
        return cls(name, unit, minutes, sds / in_unit(unit))


def known_figure(plan: Plan, course: Course, narrow: bool = False) -> Figure:
    """The goal's expected standard deviation against the minutes spent, with what is wanted."""
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 2.7)
        panel = made.subplots()
        _known(panel, plan, course)
        says = f"{_settled_in(plan, course)}{', were the muscle right' if missed_words(plan) else ''}"
        panel.set_title(textwrap.fill(says, 42) if narrow else says)
        handles = [mark("expected after each run", marker="o", ls="-", color=OKABE_ITO["black"])]
        if plan.wanted:
            handles.append(mark("wanted", ls=":"))
        handles.append(mark("ten isobars in the same time", marker="x", color=OKABE_ITO["vermilion"]))
        colours = {"force": "orange", "diameter": "sky"}
        handles += [
            mark(f"{channel} alone", marker="D", mfc="none", color=OKABE_ITO[colours[channel]])
            for channel in plan.alone
        ]
        made.legend(handles=handles, loc="outside lower center", ncols=1 if narrow else 5)
    return made


def _known(panel: Axes, plan: Plan, course: Course) -> None:
    per = in_unit(course.unit)
    shown = slice(1 if not np.isfinite(course.sds[0]) else 0, None)
    panel.step(course.minutes[shown], course.sds[shown], where="post", color=OKABE_ITO["black"], gid="course")
    done = slice(1 if plan.chosen else 0, None)
    panel.plot(course.minutes[done], course.sds[done], "o", color=OKABE_ITO["black"])
    if plan.wanted:
        panel.axhline(plan.wanted / per, color=QUIET, linestyle=":", linewidth=0.9, gid="wanted")
    if plan.chosen:
        panel.plot(course.minutes[-1], plan.isobars / per, "x", color=OKABE_ITO["vermilion"], gid="isobars")
    for channel, colour in (("force", "orange"), ("diameter", "sky")):
        if channel in plan.alone:
            sd, minutes = plan.alone[channel]
            panel.plot(minutes, sd / per, "D", mfc="none", color=OKABE_ITO[colour], gid=channel)
    panel.set_ylim(0, None)
    unit = "" if course.unit == "1" else f" [{course.unit}]"
    panel.set(xlabel="minutes spent", ylabel=f"expected sd{unit}")


def _settled_in(plan: Plan, course: Course) -> str:
    """The finding: how well the goal is known, and after how long."""
    to = show(plan.settled[course.name].after, course.unit, 2)
    return f"{course.name} to ± {to} in {minutes_words(plan.minutes)}"


def command_figure(plan: Plan, narrow: bool = False) -> Figure | None:
    """Pressure and length to command over time; None where only checks of the rig are to be made."""
    table = plan.schedule()
    if not len(table):
        return None
    gaps = np.flatnonzero(np.diff(table["cycle"].to_numpy())) + 1
    minutes, pressure, length = (
        np.insert(values.to_numpy(float), gaps, np.nan)
        for values in (table["time [s]"] / 60, table["pressure [kPa]"], table["length [mm]"])
    )
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 3.0)
        top, low = made.subplots(2, 1, sharex=True)
        top.plot(minutes, pressure, color=OKABE_ITO["blue"])
        low.plot(minutes, length, color=OKABE_ITO["orange"])
        top.set(ylabel="pressure [kPa]", title=_commanded(plan, narrow))
        low.set(ylabel="length [mm]", xlabel="time [min]")
    return made


def _commanded(plan: Plan, narrow: bool) -> str:
    checks = sum(count * run.minutes for count, run in plan.chosen if not run.pressure.size)
    words = "What to command"
    return words + (
        f";{chr(10) if narrow else ' '}checks take {minutes_words(checks)} besides" if checks else ""
    )


def save_figures(plan: Plan, course: Course, folder: Path) -> list[Path]:
    """Draw both, each as PNG."""
    written = [save_png(known_figure(plan, course), folder / "plan")]
    commands = command_figure(plan)
    return written + ([save_png(commands, folder / "schedule")] if commands else [])
