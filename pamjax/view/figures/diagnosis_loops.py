"""Loops of a diagnosis: measured beside predicted, and what the baseline leaves beside what names add."""

from __future__ import annotations

import math
import textwrap

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.result import Diagnosis
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.view.figures.layout import Layout, key, layout, lines, mark
from pamjax.view.figures.mismatch_map import main_channel
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, theme

#: Loops are drawn at this many settings at most, each with this many measured points at most.
LOOPS, POINTS = 4, 120


def loops_figure(one: Diagnosis, narrow: bool = False) -> Figure:
    """Measured beside predicted at a few settings, without and with what was named.

    A held-out setting is among them where there is one; every prediction is by fits that never saw it.
    """
    form, c = _some(one), main_channel(one)
    shown = [("the baseline", one.gain.before)]
    if one.names:
        shown.append((f"with {', '.join(name.id for name in one.names)}", one.gain.after))
    down = narrow and len(shown) > 1
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 5.6 if down else 3.4)
        shape = (len(shown), 1) if narrow else (1, len(shown))
        panels = list(made.subplots(*shape, sharex=True, sharey=True, squeeze=False).flat)
        for panel, (words, prediction) in zip(panels, shown, strict=True):
            _loops(panel, one, form, c, prediction[c])
            missed = told(rms(one.found.measured[c] - prediction[c]), CHANNELS[c])
            title = f"{words[0].upper()}{words[1:]}: {CHANNELS[c]} missed by {missed}"
            panel.set(xlabel=form.xlabel, ylabel=f"{CHANNELS[c]} [{DISPLAY_UNIT[CHANNELS[c]]}]")
            panel.set_title(textwrap.fill(title, 46))
            panel.label_outer()
        key(made, panels, form, mark("measured", marker="o", ms=3), mark("predicted", ls="-"))
    return made


def _some(one: Diagnosis) -> Layout:
    """The layout of a few settings: the outer ones, some between, and a held-out one."""
    form = layout(one.found.case)
    many = len(form.names)
    if many <= LOOPS:
        return form
    chosen = np.unique(np.linspace(0, many - 1, LOOPS).round().astype(int))
    unseen = np.unique(form.group[one.gain.held_out & (form.group >= 0)])
    if unseen.size and not np.isin(unseen, chosen).any():
        inner = chosen[1:-1]
        chosen[1 + np.argmin(np.abs(inner - unseen[0]))] = unseen[0]
    number = np.full(many + 1, -1)
    number[chosen] = np.arange(len(chosen))
    return Layout(
        form.x,
        form.xlabel,
        number[form.group],
        tuple(form.names[k] for k in chosen),
        tuple(form.colours[k] for k in chosen),
        tuple(form.isobars[k] for k in chosen) if form.isobars else (),
        form.connected,
    )


def _loops(panel: Panel, one: Diagnosis, form: Layout, c: int, prediction: np.ndarray) -> None:
    channel = CHANNELS[c]
    measured, predicted = to_display(channel, one.found.measured[c]), to_display(channel, prediction)
    there = np.isfinite(measured)
    for group, colour in enumerate(form.colours):
        rows = np.flatnonzero((form.group == group) & there)
        rows = rows[:: max(1, math.ceil(rows.size / POINTS))]
        panel.plot(form.x[rows], measured[rows], "o", ms=2.6, mew=0, alpha=0.55, color=colour, gid="measured")
        if not form.connected:
            panel.plot(form.x[rows], predicted[rows], "x", color=colour, gid="predicted")
            continue
        for run in lines(one.found.case, form, group, there):
            panel.plot(form.x[run], predicted[run], color=colour, lw=1.0, zorder=3, gid="predicted")


def left_out_figure(one: Diagnosis, narrow: bool = False) -> Figure | None:
    """Measured − baseline as points, named − baseline as a line, a panel a setting; None without a name."""
    if not one.names:
        return None
    form, c = _some(one), main_channel(one)
    channel = CHANNELS[c]
    left = to_display(channel, one.found.measured[c] - one.gain.before[c])
    added = to_display(channel, one.gain.after[c] - one.gain.before[c])
    many = len(form.names)
    columns = min(2, many) if narrow else many
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 1.4 + 1.5 * math.ceil(many / columns))
        grid = made.subplots(-(-many // columns), columns, sharex=True, sharey=True, squeeze=False)
        for k, panel in enumerate(grid.flat):
            if k >= many:
                panel.set_visible(False)
                continue
            panel.axhline(0, color=QUIET, lw=0.6)
            rows = np.flatnonzero((form.group == k) & np.isfinite(left))
            rows = rows[:: max(1, math.ceil(rows.size / POINTS))]
            panel.plot(form.x[rows], left[rows], "o", ms=2.6, mew=0, alpha=0.55, color=QUIET, gid="left")
            for run in lines(one.found.case, form, k, np.isfinite(left)):
                panel.plot(form.x[run], added[run], color=OKABE_ITO["blue"], lw=1.2, zorder=3, gid="added")
            panel.set(
                xlabel=form.xlabel,
                ylabel=f"{channel} − baseline [{DISPLAY_UNIT[channel]}]",
                title=form.names[k],
            )
            panel.label_outer()
        made.suptitle(textwrap.fill(resembles(one, left, added), 48 if narrow else 104), x=0.01, ha="left")
        handles = [mark("measured", marker="o", ms=3), mark("with names", ls="-", color=OKABE_ITO["blue"])]
        made.legend(handles=handles, loc="outside lower center", ncols=2)
    return made


def resembles(one: Diagnosis, left: np.ndarray, added: np.ndarray) -> str:
    """The finding: how much of what the baseline leaves is what the names add."""
    share = 1 - np.nanmean((left - added) ** 2) / np.nanmean(left**2)
    names = " and ".join(name.id for name in one.names)
    verb = "adds" if len(one.names) == 1 else "add"
    return f"{100 * max(share, 0.0):.0f} % of the square of what the baseline leaves is what {names} {verb}"


def rms(misfit: np.ndarray) -> float:
    """Root mean square of what was measured; NaN where nothing was."""
    misfit = misfit[np.isfinite(misfit)]
    return float(np.sqrt(np.mean(misfit**2))) if misfit.size else math.nan


def told(value: float, channel: str) -> str:
    """A channel's SI value as a person reads it."""
    return f"{to_display(channel, value):.3g} {DISPLAY_UNIT[channel]}"
