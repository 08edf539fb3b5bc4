"""Figures of a sized muscle: operating chart, sensitivities, and the front between two objectives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.sizing.infeasible import format_shortfall
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, OBJECTIVE_UNITS
from pamjax.sizing.result import Design
from pamjax.units import compute_si_factor, format_quantity
from pamjax.view.figures.layout import create_mark
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    add_pressure_bar,
    apply_theme,
    build_pressure_colours,
    create_figure,
    save_png,
)
from pamjax.view.wording import wrap_title

#: Number of isobars in a chart, and of points along each.
_ISOBAR_COUNT, _CHART_CONTRACTION_COUNT = 6, 80
#: Largest contraction that is drawn.
_MAX_CHART_CONTRACTION = 0.45
#: Largest number of bars.
_MAX_BARS = 8
#: Margins that differ by less than this count as equal.
_MARGIN_TIE = 0.02


def plot_chart(design: Design, narrow: bool = False) -> Figure:
    """Return force against contraction: isobars, the admissible region, the load and the working points."""
    supply = design.spec.supply
    levels = np.linspace(supply / _ISOBAR_COUNT, supply, _ISOBAR_COUNT)
    # Smaller steps at small contraction, where the rubber makes the isobars nonlinear.
    contraction = _MAX_CHART_CONTRACTION * np.linspace(0.0, 1.0, _CHART_CONTRACTION_COUNT) ** 1.5
    grid = np.meshgrid(levels, contraction, indexing="ij")
    force = design.force(grid[0].ravel(), grid[1].ravel()).reshape(_ISOBAR_COUNT, _CHART_CONTRACTION_COUNT)
    diameter = design.outer_diameter(grid[0].ravel(), grid[1].ravel()).reshape(
        _ISOBAR_COUNT, _CHART_CONTRACTION_COUNT
    )
    end_contraction = _find_chart_end(contraction, force[-1])
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 3.2 if narrow else 3.8)
        panel = drawing.subplots()
        colours, norm = build_pressure_colours(tuple(levels / 1e3))
        _plot_region(panel, design, contraction, force, diameter)
        for level, row in zip(levels, force, strict=True):
            panel.plot(100 * contraction, row, color=colours(norm(level / 1e3)), gid="isobar", lw=1.2)
        working_pressure, max_forces = design.numbers["pressure"], [float(np.nanmax(force[-1]))]
        has_working_line = abs(working_pressure / supply - 1) > 0.005
        if has_working_line:
            working_force = design.force(np.full(_CHART_CONTRACTION_COUNT, working_pressure), contraction)
            panel.plot(
                100 * contraction, working_force, "--", color=OKABE_ITO["black"], lw=0.9, gid="working"
            )
            max_forces.append(float(np.nanmax(working_force)))
        _plot_points(panel, design)
        top_force = 1.08 * max(*max_forces, float(np.nanmax(design.task.loads)))
        title = _format_chart_title(design)
        title = wrap_title(title, 46) if narrow else title
        panel.set(
            xlim=(-0.5, 100 * end_contraction), ylim=(0, top_force), xlabel="contraction [%]", title=title
        )
        panel.set_ylabel("force of all muscles [N]" if design.choice.parallel > 1 else "force [N]")
        add_pressure_bar(panel, tuple(levels / 1e3))
        handles = [
            create_mark("required", marker="o", color=OKABE_ITO["vermilion"], mfc="none"),
            create_mark("available", marker="o", color=OKABE_ITO["black"]),
            create_mark("admissible", marker="s", ms=7, alpha=0.25),
        ]
        if design.spec.entries.stroke:
            handles.insert(0, create_mark("load", ls="-", color=OKABE_ITO["vermilion"]))
        if has_working_line:
            supply_note = ", above the supply pressure" if working_pressure > supply else ""
            label = f"working pressure {format_quantity(working_pressure, 'kPa', 3)}{supply_note}"
            handles.append(create_mark(label, ls="--", color=OKABE_ITO["black"]))
        drawing.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else 5)
    return drawing


def _find_chart_end(contraction: np.ndarray, max_force: np.ndarray) -> float:
    """Return a contraction slightly above that of zero force."""
    pulling = np.flatnonzero(np.nan_to_num(max_force) > 0)
    return (
        float(min(_MAX_CHART_CONTRACTION, contraction[pulling[-1]] + 0.03))
        if pulling.size
        else _MAX_CHART_CONTRACTION
    )


def _plot_region(panel: Axes, design: Design, contraction, force, diameter) -> None:
    """Draw the admissible region: positive force within the supply and the envelope."""
    max_diameter = design.spec.entries.envelope.diameter or np.inf
    fits = diameter <= max_diameter * (1 + 1e-6)
    admissible_force = np.where(fits, force, -np.inf).max(axis=0)
    panel.fill_between(
        100 * contraction,
        0,
        np.maximum(admissible_force, 0),
        color=REFERENCE_COLOUR,
        alpha=0.18,
        lw=0,
        gid="admissible",
    )
    too_wide = np.flatnonzero(~fits[-1])
    if too_wide.size and force[-1, too_wide[0]] > 0:
        x = 100 * contraction[too_wide[0]]
        panel.axvline(x, color=REFERENCE_COLOUR, ls="--", lw=0.8)
        # Place the label on the side of the line with more room, above the isobars.
        on_left = x > 50 * (contraction[-1] + contraction[0])
        panel.annotate(
            f"diameter above {format_quantity(max_diameter, 'mm')}",
            (x, 0.97),
            (-6 if on_left else 6, 0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            va="top",
            ha="right" if on_left else "left",
            fontsize=7,
            color=REFERENCE_COLOUR,
        )


def _plot_points(panel: Axes, design: Design) -> None:
    rest_length = design.numbers["rest_length"]
    points, task = design.task.points, design.task
    x = 100 * (points.contraction + points.shortening / rest_length)[: task.point_count]
    forces = np.array([design.output("force", k) for k in range(task.point_count)])
    loads = task.loads
    rows = np.flatnonzero(np.isfinite(loads))
    stroke = [k for k in rows if "of the stroke" in task.labels[k]]
    if stroke:
        panel.plot(x[stroke], loads[stroke], "-", color=OKABE_ITO["vermilion"], lw=1.6, gid="load")
    panel.vlines(x[rows], loads[rows], forces[rows], color=OKABE_ITO["black"], lw=0.8, gid="margin")
    panel.plot(x[rows], forces[rows], "o", color=OKABE_ITO["black"], ms=3.5, gid="available")
    # A required force of zero is on the axis: without clipping, its whole circle is visible.
    style = {"color": OKABE_ITO["vermilion"], "mfc": "none", "ms": 6, "clip_on": False, "zorder": 5}
    panel.plot(x[rows], loads[rows], "o", gid="required", **style)


def format_shortfall_title(design: Design) -> str:
    """Return the shortfall of the nearest muscle; of equal ones a force, else a requirement of the spec."""
    y = design.outputs
    margins_by_key = {
        requirement.key: float(requirement.compute_margins(y).min())
        for requirement in design.task.requirements
    }
    nearly_worst = [
        requirement
        for requirement in design.task.requirements
        if margins_by_key[requirement.key] < min(margins_by_key.values()) + _MARGIN_TIE
    ]
    worst = min(nearly_worst, key=lambda requirement: (requirement.unit != "N", not requirement.stated))
    return f"Nearest muscle, “{worst.description}”: {format_shortfall(worst, y)}"


def _format_chart_title(design: Design) -> str:
    """Return the title of the chart: the tightest force requirement."""
    if not design.feasible:
        return format_shortfall_title(design)
    rows = np.flatnonzero(design.task.loads > 0)
    if not rows.size:
        return "The muscle reaches the required contraction"
    relative_margin = [design.output("force", int(k)) / design.task.loads[k] - 1 for k in rows]
    k = int(np.argmin(relative_margin))
    margin = "0" if relative_margin[k] < 5e-4 else f"{100 * relative_margin[k]:.2g}"
    return f"Smallest force margin: {margin} % {design.task.labels[rows[k]]}"


def plot_sensitivities(design: Design, narrow: bool = False) -> Figure | None:
    """Return the objective's change for 1 % of each requirement or property; None if none is active."""
    rows = [
        (sensitivity.requirement.description, -sensitivity.percent_saved, "requirement")
        for sensitivity in design.requirement_sensitivities
    ]
    rows += [(name, share, "property") for name, share in design.property_sensitivities.items()
             if abs(share) > 1e-3]  # fmt: skip
    rows = sorted(rows, key=lambda row: -abs(row[1]))[:_MAX_BARS]
    if not design.requirement_sensitivities:
        return None
    objective = design.spec.entries.minimise
    colour = {"requirement": OKABE_ITO["blue"], "property": OKABE_ITO["orange"]}
    with apply_theme():
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 1.1 + (0.34 if narrow else 0.24) * len(rows)
        )
        panel = drawing.subplots()
        y = np.arange(len(rows))
        panel.barh(y, [row[1] for row in rows], color=[colour[row[2]] for row in rows], height=0.62)
        panel.set_yticks(y, [wrap_title(row[0], 26) if narrow else row[0] for row in rows])
        panel.invert_yaxis()
        panel.axvline(0, color=REFERENCE_COLOUR, lw=0.6)
        panel.set_xlabel(f"change of {objective} [%]")
        top_sensitivity = design.requirement_sensitivities[0]
        title = (
            f"Relaxing “{top_sensitivity.requirement.description}” by 1 % reduces {objective} by"
            f" {top_sensitivity.percent_saved:.2g} %"
        )
        drawing.suptitle(wrap_title(title, 46) if narrow else title, x=0.01, ha="left", fontsize=8)
        handles = [create_mark("requirement relaxed by 1 %", marker="s", ms=7, color=colour["requirement"])]
        if any(row[2] == "property" for row in rows):
            handles.append(
                create_mark("property increased by 1 %", marker="s", ms=7, color=colour["property"])
            )
        drawing.legend(handles=handles, loc="outside lower center", ncols=1 if narrow else 2)
    return drawing


def plot_front(design: Design, narrow: bool = False) -> Figure | None:
    """Return the front between two objectives, or None if it has a single point."""
    front = design.front
    if front is None or len(front.values) < 2:
        return None
    units = OBJECTIVE_UNITS[front.first], OBJECTIVE_UNITS[front.second]
    x, y = (front.values[:, k] / compute_si_factor(units[k]) for k in (0, 1))
    choice_names = list(dict.fromkeys(map(str, front.choices)))
    colours = [OKABE_ITO[name] for name in ("blue", "orange", "green", "purple", "sky", "vermilion")]
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN, 2.9 + 0.14 * len(choice_names))
        panel = drawing.subplots()
        panel.plot(x, y, color=REFERENCE_COLOUR, lw=0.8, zorder=1)
        for kind, colour in zip(choice_names, colours, strict=False):
            rows = [k for k, choice in enumerate(front.choices) if str(choice) == kind]
            panel.plot(x[rows], y[rows], "o", color=colour, label=kind, gid="front")
        design_point = (
            design.output(OBJECTIVE_OUTPUTS[name]) / compute_si_factor(unit)
            for name, unit in zip((front.first, front.second), units, strict=True)
        )
        panel.plot(*design_point, marker="*", ms=11, color=OKABE_ITO["vermilion"], ls="none", label="chosen")
        panel.set_xlabel(f"{front.first}{_format_unit(units[0])}")
        panel.set_ylabel(f"{front.second}{_format_unit(units[1])}")
        panel.set_title(
            f"{_format_percent(x)} more {front.first} gives {_format_percent(y)} less {front.second}"
        )
        drawing.legend(loc="outside lower left", ncols=1, fontsize=6)
    return drawing


def _format_unit(unit: str) -> str:
    return "" if unit == "1" else f" [{unit}]"


def _format_percent(values: np.ndarray) -> str:
    # Change from the first to the last point, relative to the first.
    percent_change = 100 * abs(values[-1] / values[0] - 1)
    return f"{percent_change:.0f} %" if percent_change >= 10 else f"{percent_change:.2g} %"


def save_design_figures(design: Design, folder: Path) -> list[Path]:
    """Write the figures of a design as PNG and return their paths."""
    paths = [save_png(plot_chart(design), folder / "chart")]
    for name, drawing in (("sensitivities", plot_sensitivities(design)), ("front", plot_front(design))):
        if drawing is not None:
            paths.append(save_png(drawing, folder / name))
    return paths
