"""How the rows of a case lie on paper: over what they run, and which of them share a colour."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import ColorType

from pamjax.records.blocks import blocks
from pamjax.records.case import Case
from pamjax.records.levels import find_levels, on_levels
from pamjax.units import show
from pamjax.view.theme import OKABE_ITO, QUIET, pressure_bar, pressures, shades

#: Lengths are told apart by kinds of colour up to this number, then by shades.
KINDS = 7
#: A panel is a grid of this many cells; what falls into one cell would hide itself and is drawn once.
CELLS = (160, 100)
#: A model's line has at most this many points a group.
LINE = 400


@dataclass(frozen=True, eq=False)
class Layout:
    """The rows of a case on paper.

    Attributes:
        x: (n,) what the rows run over, in the unit of its label.
        xlabel: with unit.
        group: (n,) index of the rows that share a colour and a line; -1 for rows that are not drawn.
        names: of the groups.
        colours: of the groups.
        isobars: pressures of the groups, kPa, where they are isobars; else empty.
        connected: whether a line may join the model's points of a group.
    """

    x: np.ndarray
    xlabel: str
    group: np.ndarray
    names: tuple[str, ...]
    colours: tuple[ColorType, ...]
    isobars: tuple[float, ...]
    connected: bool


def axes_of(case: Case) -> dict[str, np.ndarray]:
    """(n,) by label: contraction, pressure and time in the units of a figure, where they vary."""
    recording = case.recording
    columns = {
        "contraction [%]": 100 * (1 - recording.length / case.entry.rest_length.value),
        "pressure [kPa]": recording.pressure / 1e3,
        "time [s]": recording.time if recording.time is not None else np.zeros(recording.n),
    }
    used = recording.usable
    least = {"contraction [%]": 0.2, "pressure [kPa]": 1.0, "time [s]": 0.0}
    return {name: x for name, x in columns.items() if np.ptp(x[used]) > least[name]}


def layout(case: Case) -> Layout:
    """Isobars over contraction, lengths over pressure, everything else over time (or pressure)."""
    recording, columns = case.recording, axes_of(case)
    lengths, isobars = find_levels(recording.length), find_levels(recording.pressure)
    kind = blocks(recording).kind
    if kind != "holds" and len(lengths) and (kind == "lengths" or not 0 < len(isobars) < len(lengths)):
        names = [show(level, "mm") for level in lengths]
        return _made(case, "pressure [kPa]", on_levels(recording.length, lengths), names)
    if kind == "isobars":
        names = [show(level, "kPa", 3) for level in isobars]
        group = on_levels(recording.pressure, isobars)
        return _made(case, "contraction [%]", group, names, tuple(isobars / 1e3))
    whole = np.zeros(recording.n, dtype=int)
    if "time [s]" in columns:
        return _made(case, "time [s]", whole, ["all rows"])
    return _made(case, "pressure [kPa]", whole, ["all rows"], connected=False)


def _made(case, xlabel, group, names, isobars=(), connected=True) -> Layout:
    """A layout without the rows that cannot be drawn and the groups that have no measured row."""
    recording = case.recording
    measured = np.isfinite(recording.force) | np.isfinite(recording.diameter)
    group = np.where(recording.usable & measured, group, -1)
    kept = np.unique(group[group >= 0])
    number = np.full(len(names) + 1, -1)
    number[kept] = np.arange(len(kept))
    isobars = tuple(float(isobars[k]) for k in kept) if isobars else ()
    x = {"pressure [kPa]": recording.pressure / 1e3, **axes_of(case)}[xlabel]
    colours = _colours(len(kept), isobars)
    return Layout(x, xlabel, number[group], tuple(names[k] for k in kept), colours, isobars, connected)


def _colours(count: int, isobars: tuple[float, ...]) -> tuple[ColorType, ...]:
    if len(isobars) > 1:
        colours, norm = pressures(isobars)
        return tuple(colours(norm(level)) for level in isobars)
    if count > KINDS:
        return tuple(map(tuple, shades(count)))
    kinds = ("blue", "orange", "green", "purple", "sky", "vermilion", "black")
    return tuple(OKABE_ITO[name] for name in kinds[:count])


def key(figure: Figure, axes: list[Axes], form: Layout, *others: Line2D) -> None:
    """Say what the marks are, and which colour is which isobar or length."""
    figure.legend(handles=list(others), loc="outside lower center", ncols=len(others))
    if len(form.isobars) > 1:
        pressure_bar(axes, form.isobars)
    elif len(form.names) > 1:
        pairs = list(zip(form.names, form.colours, strict=True))[::-1]
        marks = [Line2D([], [], color=colour, lw=3, label=name) for name, colour in pairs]
        figure.legend(handles=marks, loc="outside right upper", title="length", title_fontsize=7)


def mark(label: str, **style) -> Line2D:
    """One entry of a key, in a colour that belongs to no group."""
    return Line2D([], [], **{"color": QUIET, "ls": "none", **style, "label": label})


def thin(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices of the first point in each cell of a grid over all points; blanks are left out."""
    there = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    cells = np.zeros(there.size, dtype=int)
    for values, count in zip((x[there], y[there]), CELLS, strict=True):
        spread = np.ptp(values) if there.size else 0.0
        step = (values - values.min()) / spread * (count - 1) if spread else np.zeros(there.size)
        cells = cells * count + step.astype(int)
    return there[np.unique(cells, return_index=True)[1]]


def lines(case: Case, form: Layout, group: int, there: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of the rows along each line of a group: in time, broken at pauses; or along x.

    Args:
        there: (n,) bool, rows where the channel was measured.
    """
    recording = case.recording
    rows = np.flatnonzero((form.group == group) & there)
    if recording.time is None:
        yield rows[np.argsort(form.x[rows], kind="stable")]
        return
    step = max(1, rows.size // LINE)
    run = np.cumsum(recording.starts)[rows]
    for number in np.unique(run):
        yield rows[run == number][::step]
