"""Figures of a plan: expected standard deviation after each run, and commands over time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.model.parameters import find_meaning
from pamjax.planning.plan import ALL_PARAMETERS, Plan, compute_sd_course
from pamjax.planning.report import format_minutes, format_misfit
from pamjax.units import compute_si_factor, format_quantity
from pamjax.view.figures.layout import create_mark
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
    save_png,
)
from pamjax.view.wording import wrap_title

#: Colour of the best plan with one channel only.
_CHANNEL_COLOURS = {"force": "orange", "length": "orange", "diameter": "sky"}


@dataclass(frozen=True, eq=False)
class PrecisionCourse:
    """Expected standard deviation of a parameter after each run.

    Attributes:
        name: of the parameter; with the goal "all", of the first one.
        unit: display unit.
        minutes: elapsed time before the first run and after each run, min.
        sds: expected standard deviations, in the display unit.
    """

    name: str
    unit: str
    minutes: np.ndarray
    sds: np.ndarray

    @classmethod
    def from_plan(cls, plan: Plan) -> PrecisionCourse:
        """Return the course of a plan's goal."""
        name = next(iter(plan.expected_sds)) if plan.goal == ALL_PARAMETERS else plan.goal
        unit = find_meaning(name).show
        minutes, sds = compute_sd_course(plan, name)
        return cls(name, unit, minutes, sds / compute_si_factor(unit))


def plot_precision(plan: Plan, course: PrecisionCourse, narrow: bool = False) -> Figure:
    """Return the goal's expected standard deviation against time, with the target."""
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 2.7)
        panel = drawing.subplots()
        _plot_precision_course(panel, plan, course)
        condition = ", if the model were correct" if format_misfit(plan) else ""
        title = f"{_format_reached_precision(plan, course)}{condition}"
        panel.set_title(wrap_title(title, 42) if narrow else title)
        handles = [create_mark("expected after each run", marker="o", ls="-", color=OKABE_ITO["black"])]
        if plan.target_sd:
            handles.append(create_mark("target", ls=":"))
        handles.append(create_mark(_name_usual_protocol(plan), marker="x", color=OKABE_ITO["vermilion"]))
        handles += [
            create_mark(f"{channel} only", marker="D", mfc="none", color=OKABE_ITO[_CHANNEL_COLOURS[channel]])
            for channel in plan.single_channel
        ]
        drawing.legend(handles=handles, loc="outside lower center", ncols=1 if narrow else 5)
    return drawing


def _name_usual_protocol(plan: Plan) -> str:
    is_isotonic = plan.prior.capabilities.measures_length
    return f"{'ramps' if is_isotonic else 'ten isobars'} in equal time"


def _plot_precision_course(panel: Axes, plan: Plan, course: PrecisionCourse) -> None:
    unit_scale = compute_si_factor(course.unit)
    shown_steps = slice(1 if not np.isfinite(course.sds[0]) else 0, None)
    panel.step(
        course.minutes[shown_steps],
        course.sds[shown_steps],
        where="post",
        color=OKABE_ITO["black"],
        gid="course",
    )
    run_steps = slice(1 if plan.chosen_runs else 0, None)
    panel.plot(course.minutes[run_steps], course.sds[run_steps], "o", color=OKABE_ITO["black"])
    if plan.target_sd:
        panel.axhline(
            plan.target_sd / unit_scale, color=REFERENCE_COLOUR, linestyle=":", linewidth=0.9, gid="target"
        )
    if plan.chosen_runs:
        panel.plot(
            course.minutes[-1], plan.usual_sd / unit_scale, "x", color=OKABE_ITO["vermilion"], gid="usual"
        )
    for channel, (sd, minutes) in plan.single_channel.items():
        colour = OKABE_ITO[_CHANNEL_COLOURS[channel]]
        panel.plot(minutes, sd / unit_scale, "D", mfc="none", color=colour, gid=channel)
    panel.set_ylim(0, None)
    unit = "" if course.unit == "1" else f" [{course.unit}]"
    panel.set(xlabel="time [min]", ylabel=f"expected sd{unit}")


def _format_reached_precision(plan: Plan, course: PrecisionCourse) -> str:
    """Return the title: the expected precision of the goal, and the time."""
    sd_text = format_quantity(plan.expected_sds[course.name].expected_sd, course.unit, 2)
    return f"Expected sd of {course.name}: {sd_text} after {format_minutes(plan.minutes)}"


def plot_commands(plan: Plan, narrow: bool = False) -> Figure | None:
    """Return the commanded pressure and length, or set force; None if the plan has only checks of the rig."""
    table = plan.schedule()
    if not len(table):
        return None
    run_starts = np.flatnonzero(np.diff(table["cycle"].to_numpy())) + 1
    second_column = "force [N]" if plan.prior.capabilities.measures_length else "length [mm]"
    minutes, pressure, second = (
        np.insert(values.to_numpy(float), run_starts, np.nan)
        for values in (table["time [s]"] / 60, table["pressure [kPa]"], table[second_column])
    )
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 3.0)
        pressure_panel, second_panel = drawing.subplots(2, 1, sharex=True)
        pressure_panel.plot(minutes, pressure, color=OKABE_ITO["blue"])
        second_panel.plot(minutes, second, color=OKABE_ITO["orange"])
        pressure_panel.set(ylabel="pressure [kPa]", title=_format_command_title(plan, narrow))
        second_panel.set(ylabel=second_column, xlabel="time [min]")
    return drawing


def _format_command_title(plan: Plan, narrow: bool) -> str:
    check_minutes = sum(count * run.minutes for count, run in plan.chosen_runs if not run.pressure.size)
    second = "set force" if plan.prior.capabilities.measures_length else "length"
    title = f"Commanded pressure and {second}"
    separator = "\n" if narrow else " "
    return title + (
        f";{separator}checks take another {format_minutes(check_minutes)}" if check_minutes else ""
    )


def save_plan_figures(plan: Plan, course: PrecisionCourse, folder: Path) -> list[Path]:
    """Write the figures of a plan as PNG and return their paths."""
    paths = [save_png(plot_precision(plan, course), folder / "plan")]
    commands = plot_commands(plan)
    return paths + ([save_png(commands, folder / "schedule")] if commands else [])
