"""Figures of a sized muscle: its operating chart, what buys most, and the front between two objectives."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.sizing.infeasible import lacks
from pamjax.sizing.problem import OUTPUT, UNITS
from pamjax.sizing.result import Design
from pamjax.units import in_unit, show
from pamjax.view.figures.layout import mark
from pamjax.view.theme import (
    DOUBLE,
    OKABE_ITO,
    QUIET,
    SINGLE,
    figure,
    pressure_bar,
    pressures,
    save_png,
    theme,
)

#: Isobars of a chart, and contractions along each.
ISOBARS, ALONG = 6, 80
#: Deepest contraction that is drawn.
DEEP = 0.45
#: Requirements and properties in the bars, at most.
BARS = 8
#: Rooms as near to one another as this are missed alike.
EQUAL = 0.02


def chart_figure(design: Design, narrow: bool = False) -> Figure:
    """Force against contraction with isobars, the admissible region, the load and the working points."""
    supply = design.spec.supply
    levels = np.linspace(supply / ISOBARS, supply, ISOBARS)
    # Closer where the rubber bends the isobars.
    contraction = DEEP * np.linspace(0.0, 1.0, ALONG) ** 1.5
    at = np.meshgrid(levels, contraction, indexing="ij")
    force = design.force(at[0].ravel(), at[1].ravel()).reshape(ISOBARS, ALONG)
    wide = design.outside(at[0].ravel(), at[1].ravel()).reshape(ISOBARS, ALONG)
    end = _end(contraction, force[-1])
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 3.2 if narrow else 3.8)
        panel = made.subplots()
        colours, norm = pressures(tuple(levels / 1e3))
        _region(panel, design, contraction, force, wide)
        for level, row in zip(levels, force, strict=True):
            panel.plot(100 * contraction, row, color=colours(norm(level / 1e3)), gid="isobar", lw=1.2)
        working, tops = design.numbers["pressure"], [float(np.nanmax(force[-1]))]
        other = abs(working / supply - 1) > 0.005
        if other:
            own = design.force(np.full(ALONG, working), contraction)
            panel.plot(100 * contraction, own, "--", color=OKABE_ITO["black"], lw=0.9, gid="working")
            tops.append(float(np.nanmax(own)))
        _points(panel, design)
        top = 1.08 * max(*tops, float(np.nanmax(design.asked.loads)))
        says = chart_says(design)
        says = textwrap.fill(says, 46) if narrow else says
        panel.set(xlim=(-0.5, 100 * end), ylim=(0, top), xlabel="contraction [%]", title=says)
        panel.set_ylabel("force of all muscles [N]" if design.choice.parallel > 1 else "force [N]")
        pressure_bar(panel, tuple(levels / 1e3))
        handles = [
            mark("wanted", marker="o", color=OKABE_ITO["vermilion"], mfc="none"),
            mark("there at its pressure", marker="o", color=OKABE_ITO["black"]),
            mark("admissible", marker="s", ms=7, alpha=0.25),
        ]
        if design.spec.words.stroke:
            handles.insert(0, mark("load", ls="-", color=OKABE_ITO["vermilion"]))
        if other:
            beyond = ", beyond the supply" if working > supply else ""
            label = f"working {show(working, 'kPa', 3)}{beyond}"
            handles.append(mark(label, ls="--", color=OKABE_ITO["black"]))
        made.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else 5)
    return made


def _end(contraction: np.ndarray, strongest: np.ndarray) -> float:
    """A little beyond where the muscle pulls no more."""
    pulls = np.flatnonzero(np.nan_to_num(strongest) > 0)
    return float(min(DEEP, contraction[pulls[-1]] + 0.03)) if pulls.size else DEEP


def _region(panel: Axes, design: Design, contraction, force, wide) -> None:
    """What the muscle may be asked for: it pulls, within the supply and the room."""
    room = design.spec.words.envelope.diameter or np.inf
    fits = wide <= room * (1 + 1e-6)
    highest = np.where(fits, force, -np.inf).max(axis=0)
    panel.fill_between(
        100 * contraction, 0, np.maximum(highest, 0), color=QUIET, alpha=0.18, lw=0, gid="admissible"
    )
    beyond = np.flatnonzero(~fits[-1])
    if beyond.size and force[-1, beyond[0]] > 0:
        x = 100 * contraction[beyond[0]]
        panel.axvline(x, color=QUIET, ls="--", lw=0.8)
        # Beside the line, on the side that has room, and above the isobars.
        left = x > 50 * (contraction[-1] + contraction[0])
        panel.annotate(f"wider than {show(room, 'mm')}", (x, 0.97), (-6 if left else 6, 0),
                       xycoords=("data", "axes fraction"), textcoords="offset points", va="top",
                       ha="right" if left else "left", fontsize=7, color=QUIET)  # fmt: skip


def _points(panel: Axes, design: Design) -> None:
    rest = design.numbers["rest_length"]
    places, asked = design.asked.places, design.asked
    x = 100 * (places.contraction + places.shortening / rest)[: asked.used]
    there = np.array([design.output("force", k) for k in range(asked.used)])
    wanted = asked.loads
    rows = np.flatnonzero(np.isfinite(wanted))
    stroke = [k for k in rows if "of the stroke" in asked.labels[k]]
    if stroke:
        panel.plot(x[stroke], wanted[stroke], "-", color=OKABE_ITO["vermilion"], lw=1.6, gid="load")
    panel.vlines(x[rows], wanted[rows], there[rows], color=OKABE_ITO["black"], lw=0.8, gid="margin")
    panel.plot(x[rows], there[rows], "o", color=OKABE_ITO["black"], ms=3.5, gid="there")
    panel.plot(x[rows], wanted[rows], "o", color=OKABE_ITO["vermilion"], mfc="none", ms=6, gid="wanted")


def short_says(design: Design) -> str:
    """What the nearest muscle has of what it misses most; of equals a force, else what the spec states."""
    y = design.outputs
    rooms = {one.key: float(one.margins(y).min()) for one in design.asked.requirements}
    near = [one for one in design.asked.requirements if rooms[one.key] < min(rooms.values()) + EQUAL]
    worst = min(near, key=lambda one: (one.unit != "N", not one.stated))
    return f"The nearest muscle has {lacks(worst, y)} of “{worst.says}”"


def chart_says(design: Design) -> str:
    """The finding of the chart."""
    if not design.feasible:
        return short_says(design)
    rows = np.flatnonzero(design.asked.loads > 0)
    if not rows.size:
        return "The muscle reaches the contraction that is wanted"
    share = [design.output("force", int(k)) / design.asked.loads[k] - 1 for k in rows]
    k = int(np.argmin(share))
    least = "just enough" if share[k] < 5e-4 else f"{100 * share[k]:.2g} % more than is wanted"
    return f"Tightest {design.asked.labels[rows[k]]}: {least}"


def price_figure(design: Design, narrow: bool = False) -> Figure | None:
    """What the objective gains for one per cent of each requirement or property; None where nothing binds."""
    rows = [(p.requirement.says, -p.share, "requirement") for p in design.prices]
    rows += [(f"{name}, 1 % more", share, "property") for name, share in design.properties.items()
             if abs(share) > 1e-3]  # fmt: skip
    rows = sorted(rows, key=lambda row: -abs(row[1]))[:BARS]
    if not design.prices:
        return None
    what = design.spec.words.minimise
    colour = {"requirement": OKABE_ITO["blue"], "property": OKABE_ITO["orange"]}
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 1.1 + (0.34 if narrow else 0.24) * len(rows))
        panel = made.subplots()
        at = np.arange(len(rows))
        panel.barh(at, [row[1] for row in rows], color=[colour[row[2]] for row in rows], height=0.62)
        panel.set_yticks(at, [textwrap.fill(row[0], 26) if narrow else row[0] for row in rows])
        panel.invert_yaxis()
        panel.axvline(0, color=QUIET, lw=0.6)
        panel.set_xlabel(f"change of {what} [%]")
        dearest = design.prices[0]
        says = f"“{dearest.requirement.says}” made 1 % easier saves {dearest.share:.2g} % of {what}"
        made.suptitle(textwrap.fill(says, 46) if narrow else says, x=0.01, ha="left", fontsize=8)
        handles = [mark("requirement, 1 % easier", marker="s", ms=7, color=colour["requirement"])]
        if any(row[2] == "property" for row in rows):
            handles.append(mark("property, 1 % more", marker="s", ms=7, color=colour["property"]))
        made.legend(handles=handles, loc="outside lower center", ncols=1 if narrow else 2)
    return made


def front_figure(design: Design, narrow: bool = False) -> Figure | None:
    """The front between two objectives; None where there is but one point."""
    one = design.front
    if one is None or len(one.values) < 2:
        return None
    units = UNITS[one.first], UNITS[one.second]
    x, y = (one.values[:, k] / in_unit(units[k]) for k in (0, 1))
    kinds = list(dict.fromkeys(map(str, one.choices)))
    colours = [OKABE_ITO[name] for name in ("blue", "orange", "green", "purple", "sky", "vermilion")]
    with theme():
        made = figure(SINGLE, 2.9 + 0.14 * len(kinds))
        panel = made.subplots()
        panel.plot(x, y, color=QUIET, lw=0.8, zorder=1)
        for kind, colour in zip(kinds, colours, strict=False):
            rows = [k for k, choice in enumerate(one.choices) if str(choice) == kind]
            panel.plot(x[rows], y[rows], "o", color=colour, label=kind, gid="front")
        chosen = (
            design.output(OUTPUT[name]) / in_unit(unit)
            for name, unit in zip((one.first, one.second), units, strict=True)
        )
        panel.plot(*chosen, marker="*", ms=11, color=OKABE_ITO["vermilion"], ls="none", label="chosen")
        panel.set_xlabel(f"{one.first}{_unit(units[0])}")
        panel.set_ylabel(f"{one.second}{_unit(units[1])}")
        panel.set_title(f"{_percent(x)} more {one.first} buys {_percent(y)} less {one.second}")
        made.legend(loc="outside lower left", ncols=1)
    return made


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" [{unit}]"


def _percent(values: np.ndarray) -> str:
    # Of the end that is left: more of the least, less of the most.
    share = 100 * abs(values[-1] / values[0] - 1)
    return f"{share:.0f} %" if share >= 10 else f"{share:.2g} %"


def save_figures(design: Design, folder: Path) -> list[Path]:
    """Draw what the design has an answer for, each as PNG."""
    written = [save_png(chart_figure(design), folder / "chart")]
    for name, drawn in (("prices", price_figure(design)), ("front", front_figure(design))):
        if drawn is not None:
            written.append(save_png(drawn, folder / name))
    return written
