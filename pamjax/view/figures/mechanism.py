"""A figure of one mechanism: what it does to the article's muscle, as change of what the bench shows."""

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
from pamjax.parameter import field_meanings
from pamjax.units import show
from pamjax.view.figures.layout import mark
from pamjax.view.figures.mechanism_demo import CONTRACTIONS, CYCLES, HALF, PRESSURES, REST, Run, sizes, trial
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, figure, letter, pressures, theme

#: A change smaller than this, N and mm, is none to speak of; a loop likewise.
NONE = {"force": 0.05, "diameter": 2e-3}
#: Share of it that is still seen in a panel.
SEEN = 0.05

SCALE = {"force": 1.0, "diameter": 1e-3}

#: Colours of the fixed lengths, which are kinds: pressures have shades.
FIXED = tuple(OKABE_ITO[name] for name in ("blue", "orange", "purple"))


def mechanism_figure(kind: type[AbstractMechanism]) -> Figure:
    """Change of force and of diameter in strokes, the force itself, and change of force in ramps."""
    strokes, ramps = trial(kind)
    levels = [p / 1e3 for p in PRESSURES]
    shades, norm = pressures(levels)
    colours = [shades(norm(level)) for level in levels]
    with theme():
        made = figure(DOUBLE, 5.6)
        panels = list(made.subplots(2, 2).flat)
        _strokes(panels[0], strokes, colours, "force")
        _strokes(panels[1], strokes, colours, "diameter")
        _itself(panels[2], strokes, colours)
        _ramps(panels[3], ramps)
        letter(panels)
        made.legend(handles=_key(colours), loc="outside lower center", ncols=3)
        made.suptitle(f"{kind.id}: {kind.about.title} ({_shown_at(kind)})", x=0.01, ha="left")
    return made


def _key(colours: Sequence[ColorType]) -> list[Line2D]:
    """Three columns: what shades are, what kinds of colour are, what kinds of line are."""
    isobars = [(f"{p / 1e3:.0f} kPa, in (a) to (c)", c) for p, c in zip(PRESSURES, colours, strict=True)]
    lengths = [(f"contraction {e:.0%}, in (d)", c) for e, c in zip(CONTRACTIONS, FIXED, strict=True)]
    ways = {"shortening, or filling": "--", "lengthening, or venting": "-", "without it, in (c)": ":"}
    return [mark(label, ls="-", lw=3, color=c) for label, c in isobars + lengths] + [
        mark(label, ls=style) for label, style in ways.items()
    ]


def _shown_at(kind: type[AbstractMechanism]) -> str:
    declared = field_meanings(kind)
    return ", ".join(f"{name} {show(value, declared[name].show)}" for name, value in sizes(kind).items())


def _change(run: Run, channel: str) -> np.ndarray:
    return (getattr(run, channel) - getattr(run, f"bare_{channel}")) / SCALE[channel]


def _strokes(panel: Axes, strokes: Sequence[Run], colours: Sequence[ColorType], channel: str) -> None:
    changes = [_change(run, channel) for run in strokes]
    for run, change, colour in zip(strokes, changes, colours, strict=True):
        _path(panel, 100 * (1 - run.length / REST), change, run.rising, colour)
    panel.set(
        xlabel="contraction [%]",
        ylabel=f"change of {channel} [{DISPLAY_UNIT[channel]}]",
        title=f"{channel}: {_finding(changes, channel)}",
    )
    _room(panel, channel)


def _itself(panel: Axes, strokes: Sequence[Run], colours: Sequence[ColorType]) -> None:
    """Force against length in a cycle at constant pressure, with and without the mechanism."""
    for run, colour in zip(strokes, colours, strict=True):
        length = run.length / 1e-3
        panel.plot(
            length[: HALF + 1],
            run.bare_force[: HALF + 1],
            color=QUIET,
            ls=":",
            lw=1.6,
            zorder=3,
            gid="without",
        )
        _path(panel, length, run.force, run.rising, colour)
    most = max(np.nanmax(np.abs(_change(run, "force"))) for run in strokes)
    share = most / max(np.nanmax(np.abs(run.bare_force)) for run in strokes)
    said = f"changed by up to {share:.1%} of its top" if most > NONE["force"] else "no change"
    panel.set(xlabel="length [mm]", ylabel="force [N]", title=f"force itself: {said}")


def _ramps(panel: Axes, ramps: Sequence[Run]) -> None:
    changes = [_change(run, "force") for run in ramps]
    for run, change, colour in zip(ramps, changes, FIXED, strict=True):
        # Of a ramp, filling is drawn as shortening is: it is what contracts a muscle.
        _path(panel, run.pressure / 1e3, change, ~run.rising, colour)
    panel.set(
        xlabel="pressure [kPa]",
        ylabel="change of force [N]",
        title=f"force in ramps: {_finding(changes, 'force')}",
    )
    _room(panel, "force")


def _path(panel: Axes, x, y, rising: np.ndarray, colour: ColorType) -> None:
    """A line a half-cycle: dashed one way, drawn the other.

    What comes again is drawn once, the last time: dashes would fill each other's gaps.
    """
    for begin in range(0, x.size, HALF):
        if _again(y, begin):
            continue
        # One point of the next half, so that the halves meet.
        rows = slice(begin, min(begin + HALF + 1, x.size))
        style = "-" if rising[begin] else "--"
        panel.plot(x[rows], y[rows], style, color=colour, lw=1.1, gid="path")


def _again(y: np.ndarray, begin: int) -> bool:
    """Whether a half-cycle is the same a cycle later, but for the samples beside its turns."""
    now, later = (y[at + 2 : at + HALF - 1] for at in (begin, begin + 2 * HALF))
    near = 2e-3 * (np.nanmax(y) - np.nanmin(y)) if np.any(np.isfinite(y)) else 0.0
    return later.size == now.size and np.allclose(now, later, rtol=0, atol=near, equal_nan=True)


def _finding(changes: Sequence[np.ndarray], channel: str) -> str:
    """By how much, in words: the range of the change, and the widest loop."""
    low, high = min(np.nanmin(c) for c in changes), max(np.nanmax(c) for c in changes)
    most = max(abs(low), abs(high))
    if most < NONE[channel]:
        return (
            f"less than {NONE[channel]:g} {DISPLAY_UNIT[channel]}"
            if most > SEEN * NONE[channel]
            else "no change"
        )
    said = f"{_number(low, channel)} to {_number(high, channel)}"
    if high - low < NONE[channel]:
        said = _number(high, channel)
    first, last = (max(_width(c, cycle) for c in changes) for cycle in (0, CYCLES - 1))
    if max(first, last) < NONE[channel]:
        return f"{said} {DISPLAY_UNIT[channel]}"
    # What is there once, as the first stretch of rubber, is no loop that comes again.
    loop = (
        f"loop {_number(last, channel)}" if last > NONE[channel] else f"first loop {_number(first, channel)}"
    )
    return f"{said} {DISPLAY_UNIT[channel]}, {loop.replace('+', '')}"


def _number(value: float, channel: str) -> str:
    """Two digits, with a sign, and no power of ten."""
    if abs(value) < NONE[channel]:
        return "0"
    digits = max(0, 1 - math.floor(math.log10(abs(value))))
    return f"{value:+.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _width(change: np.ndarray, cycle: int) -> float:
    """Widest distance between the two ways of a cycle, at equal places."""
    begin = 2 * HALF * cycle
    out, back = change[begin : begin + HALF], change[begin + HALF : begin + 2 * HALF]
    gaps = np.abs(out[1:] - back[:0:-1])
    return float(np.nanmax(gaps)) if np.any(np.isfinite(gaps)) else 0.0


def _room(panel: Axes, channel: str) -> None:
    """No change is in sight, and a change of next to nothing is not magnified."""
    panel.axhline(0.0, color=QUIET, lw=0.5, zorder=0)
    low, high = panel.get_ylim()
    least = 10 * NONE[channel]
    if high - low < least:
        middle = 0.5 * (low + high)
        panel.set_ylim(middle - least / 2, middle + least / 2)
