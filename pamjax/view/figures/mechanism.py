"""Figure of one mechanism: its effect on the force and diameter of the article's muscle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import ColorType

from pamjax.channels import DISPLAY_UNIT
from pamjax.model.mechanism import AbstractMechanism
from pamjax.parameter import list_field_meanings
from pamjax.units import format_quantity
from pamjax.view.figures.layout import create_mark
from pamjax.view.figures.mechanism_demo import (
    DEMO_CONTRACTIONS,
    DEMO_CYCLES,
    DEMO_PRESSURES,
    DEMO_REST_LENGTH,
    HALF_CYCLE_SAMPLES,
    DemoRun,
    choose_demo_values,
    simulate_demo,
)
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    add_panel_letters,
    apply_theme,
    build_pressure_colours,
    create_figure,
)
from pamjax.view.wording import wrap_title

#: Largest change, and largest loop width, that counts as negligible, N and mm.
_NEGLIGIBLE_CHANGE = {"force": 0.05, "diameter": 2e-3}
#: Share of the negligible change that is still visible in a panel.
_VISIBLE_SHARE = 0.05

_CHANNEL_SCALES = {"force": 1.0, "diameter": 1e-3}

#: Colours of the fixed lengths. Pressures have shades of one colour map.
_LENGTH_COLOURS = tuple(OKABE_ITO[name] for name in ("blue", "orange", "purple"))


def plot_mechanism(kind: type[AbstractMechanism], narrow: bool = False) -> Figure:
    """Return the change of force and diameter in strokes, the force, and the change of force in ramps."""
    strokes, ramps = simulate_demo(kind)
    levels = [pressure / 1e3 for pressure in DEMO_PRESSURES]
    colour_map, norm = build_pressure_colours(levels)
    colours = [colour_map(norm(level)) for level in levels]
    with apply_theme():
        drawing = create_figure(*((SINGLE_COLUMN, 11.0) if narrow else (DOUBLE_COLUMN, 5.6)))
        panels = list(drawing.subplots(4, 1) if narrow else drawing.subplots(2, 2).flat)
        _plot_strokes(panels[0], strokes, colours, "force")
        _plot_strokes(panels[1], strokes, colours, "diameter")
        _plot_force(panels[2], strokes, colours)
        _plot_ramps(panels[3], ramps)
        add_panel_letters(panels)
        drawing.legend(handles=_build_key(colours), loc="outside lower center", ncols=1 if narrow else 3)
        title = f"{kind.id}: {kind.about.title} ({_format_demo_values(kind)})"
        drawing.suptitle(wrap_title(title, 48 if narrow else 100), x=0.01, ha="left")
    return drawing


def _build_key(colours: Sequence[ColorType]) -> list[Line2D]:
    """Return the legend entries in three columns: shades, hues, line styles."""
    isobars = [
        (f"{pressure / 1e3:.0f} kPa, in (a) to (c)", colour)
        for pressure, colour in zip(DEMO_PRESSURES, colours, strict=True)
    ]
    lengths = [
        (f"contraction {100 * contraction:.0f} %, in (d)", colour)
        for contraction, colour in zip(DEMO_CONTRACTIONS, _LENGTH_COLOURS, strict=True)
    ]
    line_styles = {
        "shortening or filling": "--",
        "lengthening or venting": "-",
        "without mechanism, in (c)": ":",
    }
    return [create_mark(label, ls="-", lw=3, color=colour) for label, colour in isobars + lengths] + [
        create_mark(label, ls=style) for label, style in line_styles.items()
    ]


def _format_demo_values(kind: type[AbstractMechanism]) -> str:
    meanings = list_field_meanings(kind)
    return ", ".join(
        f"{name} {format_quantity(value, meanings[name].show)}"
        for name, value in choose_demo_values(kind).items()
    )


def _compute_change(run: DemoRun, channel: str) -> np.ndarray:
    return (getattr(run, channel) - getattr(run, f"bare_{channel}")) / _CHANNEL_SCALES[channel]


def _plot_strokes(
    panel: Axes, strokes: Sequence[DemoRun], colours: Sequence[ColorType], channel: str
) -> None:
    changes = [_compute_change(run, channel) for run in strokes]
    for run, change, colour in zip(strokes, changes, colours, strict=True):
        _plot_path(panel, 100 * (1 - run.length / DEMO_REST_LENGTH), change, run.rising, colour)
    panel.set(
        xlabel="contraction [%]",
        ylabel=f"change of {channel} [{DISPLAY_UNIT[channel]}]",
        title=f"change: {_format_change_range(changes, channel)}",
    )
    _set_vertical_range(panel, channel)


def _plot_force(panel: Axes, strokes: Sequence[DemoRun], colours: Sequence[ColorType]) -> None:
    """Draw force against length in a cycle at constant pressure, with and without the mechanism."""
    for run, colour in zip(strokes, colours, strict=True):
        length = run.length / 1e-3
        panel.plot(
            length[: HALF_CYCLE_SAMPLES + 1],
            run.bare_force[: HALF_CYCLE_SAMPLES + 1],
            color=REFERENCE_COLOUR,
            ls=":",
            lw=1.6,
            zorder=3,
            gid="without",
        )
        _plot_path(panel, length, run.force, run.rising, colour)
    max_change = max(np.nanmax(np.abs(_compute_change(run, "force"))) for run in strokes)
    share = max_change / max(np.nanmax(np.abs(run.bare_force)) for run in strokes)
    change_text = (
        f"change up to {100 * share:.1f} % of its maximum"
        if max_change > _NEGLIGIBLE_CHANGE["force"]
        else "no change"
    )
    panel.set(xlabel="length [mm]", ylabel="force [N]", title=f"force: {change_text}")


def _plot_ramps(panel: Axes, ramps: Sequence[DemoRun]) -> None:
    changes = [_compute_change(run, "force") for run in ramps]
    for run, change, colour in zip(ramps, changes, _LENGTH_COLOURS, strict=True):
        # Filling has the line style of shortening, because filling contracts a muscle.
        _plot_path(panel, run.pressure / 1e3, change, ~run.rising, colour)
    panel.set(
        xlabel="pressure [kPa]",
        ylabel="change of force [N]",
        title=f"change in ramps: {_format_change_range(changes, 'force')}",
    )
    _set_vertical_range(panel, "force")


def _plot_path(panel: Axes, x, y, rising: np.ndarray, colour: ColorType) -> None:
    """Draw a line per half-cycle, dashed in one direction and solid in the other.

    A repeated half-cycle is drawn once, because overlapping dashes fill each other's gaps.
    """
    for start in range(0, x.size, HALF_CYCLE_SAMPLES):
        if _repeats_later(y, start):
            continue
        # Include one point of the next half-cycle, so that the lines are connected.
        rows = slice(start, min(start + HALF_CYCLE_SAMPLES + 1, x.size))
        style = "-" if rising[start] else "--"
        panel.plot(x[rows], y[rows], style, color=colour, lw=1.1, gid="path")


def _repeats_later(y: np.ndarray, start: int) -> bool:
    """Return whether a half-cycle is repeated one cycle later, except next to its turning points."""
    this_cycle, next_cycle = (
        y[row + 2 : row + HALF_CYCLE_SAMPLES - 1] for row in (start, start + 2 * HALF_CYCLE_SAMPLES)
    )
    tolerance = 2e-3 * (np.nanmax(y) - np.nanmin(y)) if np.any(np.isfinite(y)) else 0.0
    return next_cycle.size == this_cycle.size and np.allclose(
        this_cycle, next_cycle, rtol=0, atol=tolerance, equal_nan=True
    )


def _format_change_range(changes: Sequence[np.ndarray], channel: str) -> str:
    """Return the range of the change and the widest loop as text."""
    low, high = min(np.nanmin(change) for change in changes), max(np.nanmax(change) for change in changes)
    max_change = max(abs(low), abs(high))
    if max_change < _NEGLIGIBLE_CHANGE[channel]:
        return (
            f"less than {_NEGLIGIBLE_CHANGE[channel]:g} {DISPLAY_UNIT[channel]}"
            if max_change > _VISIBLE_SHARE * _NEGLIGIBLE_CHANGE[channel]
            else "no change"
        )
    range_text = f"{_format_change(low, channel)} to {_format_change(high, channel)}"
    if high - low < _NEGLIGIBLE_CHANGE[channel]:
        range_text = _format_change(high, channel)
    first_width, last_width = (
        max(_compute_loop_width(change, cycle) for change in changes) for cycle in (0, DEMO_CYCLES - 1)
    )
    if max(first_width, last_width) < _NEGLIGIBLE_CHANGE[channel]:
        return f"{range_text} {DISPLAY_UNIT[channel]}"
    # A loop of the first cycle only, such as the first stretch of rubber, is not a repeated loop.
    loop_text = (
        f"loop {_format_change(last_width, channel)}"
        if last_width > _NEGLIGIBLE_CHANGE[channel]
        else f"first loop {_format_change(first_width, channel)}"
    )
    return f"{range_text}, {loop_text.replace('+', '')} {DISPLAY_UNIT[channel]}"


def _format_change(value: float, channel: str) -> str:
    """Return a value with two digits and a sign, without exponent."""
    if abs(value) < _NEGLIGIBLE_CHANGE[channel]:
        return "0"
    digits = max(0, 1 - math.floor(math.log10(abs(value))))
    return f"{value:+.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _compute_loop_width(change: np.ndarray, cycle: int) -> float:
    """Return the largest difference between the two directions of a cycle at equal positions."""
    start = 2 * HALF_CYCLE_SAMPLES * cycle
    forward, backward = (
        change[start : start + HALF_CYCLE_SAMPLES],
        change[start + HALF_CYCLE_SAMPLES : start + 2 * HALF_CYCLE_SAMPLES],
    )
    gaps = np.abs(forward[1:] - backward[:0:-1])
    return float(np.nanmax(gaps)) if np.any(np.isfinite(gaps)) else 0.0


def _set_vertical_range(panel: Axes, channel: str) -> None:
    """Draw the zero line, and set a minimum range, so that negligible changes are not magnified."""
    panel.axhline(0.0, color=REFERENCE_COLOUR, lw=0.5, zorder=0)
    low, high = panel.get_ylim()
    min_range = 10 * _NEGLIGIBLE_CHANGE[channel]
    if high - low < min_range:
        middle = 0.5 * (low + high)
        panel.set_ylim(middle - min_range / 2, middle + min_range / 2)
