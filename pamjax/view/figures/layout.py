"""Layout of a case's rows in a figure: the horizontal axis and the groups with one colour each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import ColorType

from pamjax.channels import format_channel_value
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case
from pamjax.records.levels import assign_levels, find_levels
from pamjax.text import join_words
from pamjax.units import format_quantity
from pamjax.view.theme import (
    OKABE_ITO,
    REFERENCE_COLOUR,
    add_pressure_bar,
    build_pressure_colours,
    build_shades,
)

#: Largest number of lengths with different hues; more lengths have shades of one hue.
_MAX_LENGTH_COLOURS = 7
#: Cells of a panel along x and y. One point per cell is drawn.
GRID_CELLS = (160, 100)
#: Largest number of points of a model's line in a group.
_MAX_LINE_POINTS = 400
#: Letters of a legend's line that fit in an inch, beside the marks.
_LEGEND_LETTERS_PER_INCH = 13.0
#: Strength of the colour of a band, between white and the colour of its line.
_BAND_TINT = 0.3


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of the rows of a case in a figure.

    Attributes:
        x: (n,) horizontal coordinate of the rows, in the unit of its label.
        xlabel: with unit.
        group: (n,) index of the group of each row; -1 for rows that are not drawn. A group has one colour.
        names: of the groups.
        colours: of the groups.
        isobars: pressures of the groups, kPa, if they are isobars; else empty.
        is_connected: whether a line connects the model's points of a group.
    """

    x: np.ndarray
    xlabel: str
    group: np.ndarray
    names: tuple[str, ...]
    colours: tuple[ColorType, ...]
    isobars: tuple[float, ...]
    is_connected: bool


def select_axes(case: Case) -> dict[str, np.ndarray]:
    """Return contraction, pressure and time in display units, (n,) each by label, if they vary."""
    recording = case.recording
    columns = {
        "contraction [%]": 100 * (1 - recording.length / case.muscle_toml.rest_length.value),
        "pressure [kPa]": recording.pressure / 1e3,
        "time [s]": recording.time if recording.time is not None else np.zeros(recording.n),
    }
    usable = recording.usable
    min_ranges = {"contraction [%]": 0.2, "pressure [kPa]": 1.0, "time [s]": 0.0}
    return {name: x for name, x in columns.items() if np.ptp(x[usable]) > min_ranges[name]}


def build_layout(case: Case) -> Layout:
    """Return the layout: isobars over contraction, lengths over pressure, others over time or pressure."""
    recording, columns = case.recording, select_axes(case)
    if recording.measures_length:
        return _assemble_layout(
            case,
            "pressure [kPa]",
            np.zeros(recording.n, dtype=int),
            ["all rows"],
            is_connected=recording.has_time,
        )
    lengths, isobars = find_levels(recording.length), find_levels(recording.pressure)
    kind = find_blocks(recording).kind
    if kind != "holds" and len(lengths) and (kind == "lengths" or not 0 < len(isobars) < len(lengths)):
        names = [format_quantity(level, "mm") for level in lengths]
        return _assemble_layout(case, "pressure [kPa]", assign_levels(recording.length, lengths), names)
    if kind == "isobars":
        names = [format_quantity(level, "kPa", 3) for level in isobars]
        group = assign_levels(recording.pressure, isobars)
        return _assemble_layout(case, "contraction [%]", group, names, tuple(isobars / 1e3))
    all_rows = np.zeros(recording.n, dtype=int)
    if "time [s]" in columns:
        return _assemble_layout(case, "time [s]", all_rows, ["all rows"])
    return _assemble_layout(case, "pressure [kPa]", all_rows, ["all rows"], is_connected=False)


def _assemble_layout(case, xlabel, group, names, isobars=(), is_connected=True) -> Layout:
    """Return a layout without unusable rows and without groups that have no measured row."""
    recording = case.recording
    is_measured = np.isfinite(recording.force) | np.isfinite(recording.diameter)
    group = np.where(recording.usable & is_measured, group, -1)
    drawn_groups = np.unique(group[group >= 0])
    new_index = np.full(len(names) + 1, -1)
    new_index[drawn_groups] = np.arange(len(drawn_groups))
    isobars = tuple(float(isobars[k]) for k in drawn_groups) if isobars else ()
    x = {"pressure [kPa]": recording.pressure / 1e3, **select_axes(case)}[xlabel]
    colours = _choose_colours(len(drawn_groups), isobars)
    return Layout(
        x, xlabel, new_index[group], tuple(names[k] for k in drawn_groups), colours, isobars, is_connected
    )


def _choose_colours(count: int, isobars: tuple[float, ...]) -> tuple[ColorType, ...]:
    if len(isobars) > 1:
        colours, norm = build_pressure_colours(isobars)
        return tuple(colours(norm(level)) for level in isobars)
    if count > _MAX_LENGTH_COLOURS:
        return tuple(map(tuple, build_shades(count)))
    kinds = ("blue", "orange", "green", "purple", "sky", "vermilion", "black")
    return tuple(OKABE_ITO[name] for name in kinds[:count])


def add_key(figure: Figure, axes: list[Axes], layout: Layout, *marks: Line2D) -> None:
    """Add a legend of the marks, and a key of the isobars' or lengths' colours."""
    letters = sum(len(str(mark.get_label())) for mark in marks)
    fits_one_line = letters < _LEGEND_LETTERS_PER_INCH * figure.get_figwidth()
    figure.legend(handles=list(marks), loc="outside lower center", ncols=len(marks) if fits_one_line else 1)
    if len(layout.isobars) > 1:
        add_pressure_bar(axes, layout.isobars)
    elif len(layout.names) > 1:
        pairs = list(zip(layout.names, layout.colours, strict=True))[::-1]
        group_marks = [Line2D([], [], color=colour, lw=3, label=name) for name, colour in pairs]
        figure.legend(handles=group_marks, loc="outside right upper", title="length", title_fontsize=7)


def create_mark(label: str, **style) -> Line2D:
    """Return one legend entry in a colour that no group has."""
    return Line2D([], [], **{"color": REFERENCE_COLOUR, "ls": "none", **style, "label": label})


def create_model_mark(label: str, layout: Layout) -> Line2D:
    """Return the legend entry of a model: a line, or a cross where no line connects its points."""
    return create_mark(label, **({"ls": "-"} if layout.is_connected else {"marker": "x"}))


def create_band_mark(name: str, sd: Mapping[str, np.ndarray]) -> Line2D:
    """Return the legend entry of a band of ± 2 sd with its largest half width.

    The band may be narrower than a line.

    Args:
        name: what the band surrounds.
        sd: (n,) SI, by channel.
    """
    widths = [
        format_channel_value(2 * float(np.nanmax(values)), channel)
        for channel, values in sd.items()
        if np.isfinite(values).any()
    ]
    limit = f", at most {join_words(widths)}" if widths else ""
    return create_mark(f"± 2 sd of {name}{limit}", marker="s", ms=7, alpha=0.3)


def thin_points(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return indices of the first point in each cell of a grid over all points, without blanks."""
    finite_rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    cells = np.zeros(finite_rows.size, dtype=int)
    for values, count in zip((x[finite_rows], y[finite_rows]), GRID_CELLS, strict=True):
        value_range = np.ptp(values) if finite_rows.size else 0.0
        step = (
            (values - values.min()) / value_range * (count - 1) if value_range else np.zeros(finite_rows.size)
        )
        cells = cells * count + step.astype(int)
    return finite_rows[np.unique(cells, return_index=True)[1]]


def iterate_lines(case: Case, layout: Layout, group: int, measured_rows: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the rows' indices along each line of a group: in time between gaps, or along x.

    Args:
        case: the case.
        layout: the layout of its rows.
        group: index of the group.
        measured_rows: (n,) bool, rows with a measured value of the channel.
    """
    recording = case.recording
    rows = np.flatnonzero((layout.group == group) & measured_rows)
    if recording.time is None:
        yield rows[np.argsort(layout.x[rows], kind="stable")]
        return
    step = max(1, rows.size // _MAX_LINE_POINTS)
    run = np.cumsum(recording.is_run_start)[rows]
    for run_number in np.unique(run):
        yield rows[run == run_number][::step]


def draw_band(
    panel: Axes,
    case: Case,
    layout: Layout,
    group: int,
    measured_rows: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> None:
    """Draw a range of the measured rows of a group: an area along each line, or bars at single points.

    Args:
        panel: the axes.
        case: the case.
        layout: the layout of its rows.
        group: index of the group.
        measured_rows: (n,) bool, rows with a measured value of the channel.
        low, high: (n,) ends of the range, in the unit of the axis.
    """
    style = {"color": tint_colour(layout.colours[group]), "zorder": 0.5, "gid": f"band group-{group}"}
    for rows in iterate_lines(case, layout, group, measured_rows):
        x = layout.x[rows]
        if layout.is_connected and rows.size > 1:
            fill_band(panel, x, low[rows], high[rows], **style)
        else:
            panel.vlines(x, low[rows], high[rows], lw=3, **style)


def tint_colour(colour: ColorType) -> ColorType:
    """Return an opaque light tint of a colour: transparent areas of repeated strokes would add up to stripes.

    >>> tint_colour("#000000")
    (0.7, 0.7, 0.7)
    """
    red, green, blue = (round(1 - _BAND_TINT * (1 - share), 6) for share in to_rgb(colour))
    return red, green, blue


def fill_band(panel: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, **style: Any) -> None:
    """Fill the range along a line, in parts that do not turn back.

    One area over a line that turns back would have no inside: the way back cancels the way there.
    """
    areas = [np.vstack([np.c_[x, low][part], np.c_[x, high][part][::-1]]) for part in split_at_turns(x)]
    panel.add_collection(PolyCollection(areas, lw=0, **style))
    panel.autoscale_view()


def split_at_turns(x: np.ndarray) -> list[slice]:
    """Return the parts of a line in which x does not turn back; neighbours share the point of the turn.

    >>> split_at_turns(np.array([0.0, 1.0, 2.0, 2.0, 1.0]))
    [slice(0, 4, None), slice(3, 5, None)]
    """
    moves = np.flatnonzero(np.diff(x))
    direction = np.sign(np.diff(x)[moves])
    turns = moves[1:][direction[1:] != direction[:-1]]
    return [slice(a, b + 1) for a, b in pairwise([0, *turns.tolist(), x.size - 1])]
