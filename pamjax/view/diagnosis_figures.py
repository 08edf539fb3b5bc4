"""Figures of a diagnosis: one question each, its answer in the title.

| figure              | question                                                             |
|---------------------|----------------------------------------------------------------------|
| `map_figure`        | where is the baseline wrong? (in `mismatch_map`)                     |
| `loops_figure`      | do the loops lie on the measured ones once something is named?       |
| `left_out_figure`   | is what the baseline leaves shaped as what the names add?            |
| `held_out_figure`   | are blocks that no fit has seen predicted down to their noise?       |
| `candidates_figure` | how much worse does another mechanism fit in a name's place?         |
| `moved_figure`      | which of the baseline's numbers had swallowed the effect?            |
"""

from __future__ import annotations

import math
import textwrap

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from pamjax.infer.member import CHANNELS
from pamjax.study.diagnosis import PER_SI, UNIT, Diagnosis
from pamjax.study.naming import TIE, TIE_SHARE, Name
from pamjax.view.layout import Layout, key, layout, lines, mark
from pamjax.view.mismatch_map import main_channel
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, theme

#: Loops are drawn at this many settings at most, each with this many measured points at most.
LOOPS, POINTS = 4, 120
#: Most rivals of a name, and most baseline numbers, in a figure.
RIVALS, NUMBERS = 7, 12
#: Scores that differ by more than this factor stand on a logarithmic axis.
WIDE = 8.0
BEFORE, AFTER = OKABE_ITO["vermilion"], OKABE_ITO["blue"]


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
            missed = _told(_rms(one.found.measured[c] - prediction[c]), CHANNELS[c])
            title = f"{words[0].upper()}{words[1:]}: {CHANNELS[c]} missed by {missed}"
            panel.set(xlabel=form.xlabel, ylabel=f"{CHANNELS[c]} [{UNIT[CHANNELS[c]]}]")
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
    measured, predicted = one.found.measured[c] * PER_SI[channel], prediction * PER_SI[channel]
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
    left = (one.found.measured[c] - one.gain.before[c]) * PER_SI[channel]
    added = (one.gain.after[c] - one.gain.before[c]) * PER_SI[channel]
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
                panel.plot(form.x[run], added[run], color=AFTER, lw=1.2, zorder=3, gid="added")
            panel.set(
                xlabel=form.xlabel, ylabel=f"{channel} − baseline [{UNIT[channel]}]", title=form.names[k]
            )
            panel.label_outer()
        made.suptitle(textwrap.fill(resembles(one, left, added), 52 if narrow else 104), x=0.01, ha="left")
        handles = [mark("measured", marker="o", ms=3), mark("with names", ls="-", color=AFTER)]
        made.legend(handles=handles, loc="outside lower center", ncols=2)
    return made


def resembles(one: Diagnosis, left: np.ndarray, added: np.ndarray) -> str:
    """The finding: how much of what the baseline leaves is what the names add."""
    share = 1 - np.nanmean((left - added) ** 2) / np.nanmean(left**2)
    names = " and ".join(name.id for name in one.names)
    verb = "adds" if len(one.names) == 1 else "add"
    return f"{100 * max(share, 0.0):.0f} % of the square of what the baseline leaves is what {names} {verb}"


def held_out_figure(one: Diagnosis, narrow: bool = False) -> Figure | None:
    """Misfit of each held-out block before and after, beside the noise; None where none was held out."""
    channels = list(one.gain.rmse_before)
    if not channels:
        return None
    names = [one.blocks.names[k] for k in np.unique(one.blocks.label[one.gain.held_out]) if k >= 0]
    with theme():
        rows = [*names, "together"] if len(names) > 1 else names
        height = 1.15 + 0.22 * len(rows)
        made = figure(SINGLE if narrow else DOUBLE, 0.4 + height * len(channels) if narrow else height)
        shape = (len(channels), 1) if narrow else (1, len(channels))
        panels = list(made.subplots(*shape, sharey=True, squeeze=False).flat)
        for panel, channel in zip(panels, channels, strict=True):
            _scores(panel, one, channel, names)
        panels[0].set_yticks(range(len(rows)), rows)
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        made.legend(
            handles=[
                mark("baseline", marker="D", color=BEFORE, mfc="none"),
                mark("with names", marker="o", color=AFTER),
                mark("noise", ls="--"),
            ],
            loc="outside lower center",
            ncols=3,
        )
    return made


def _scores(panel: Panel, one: Diagnosis, channel: str, names: list[str]) -> None:
    c, per = CHANNELS.index(channel), PER_SI[channel]
    found = {}
    for kind, prediction in (("before", one.gain.before), ("after", one.gain.after)):
        misfit = np.where(one.gain.held_out, one.found.measured[c] - prediction[c], np.nan)
        masks = [one.blocks.mask(one.blocks.names.index(name)) for name in names]
        together = [_rms(misfit)] if len(names) > 1 else []
        found[kind] = per * np.array([_rms(misfit[m]) for m in masks] + together)
    at = np.arange(len(found["before"]))
    noise = one.as_dict()["noise"][channel]["sd"]
    panel.hlines(at, found["before"], found["after"], color=QUIET, lw=0.8)
    panel.plot(found["before"], at, "D", color=BEFORE, mfc="none", ms=5.5, gid="before")
    panel.plot(found["after"], at, "o", color=AFTER, gid="after")
    panel.axvline(noise, color=QUIET, ls="--", lw=0.8, gid="noise")
    if np.nanmax(found["before"]) > WIDE * min(noise, np.nanmin(found["after"])):
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    else:
        panel.set_xlim(0, 1.08 * max(noise, *found["before"], *found["after"]))
    before, after = (_told(score[channel], channel) for score in (one.gain.rmse_before, one.gain.rmse_after))
    title = f"Held-out {channel}: {before} → {after};\nits noise is {_told(noise / per, channel)}"
    panel.set(xlabel=f"rmse of {channel} [{UNIT[channel]}]", title=title)


def candidates_figure(one: Diagnosis, name: Name, narrow: bool = False) -> Figure:
    """How much χ² is lost when another mechanism takes a name's place, or nothing does."""
    rivals = sorted(name.rivals.items(), key=lambda pair: pair[1])[:RIVALS]
    words = [*(id for id, _ in rivals), "nothing"]
    losses = np.array([*(loss for _, loss in rivals), name.gain])
    tie = TIE + TIE_SHARE * one.naming.model.excess
    with theme():
        made = figure(SINGLE if narrow else 5.4, 1.1 + 0.2 * len(words))
        panel = made.subplots()
        left = 0.5 * min(tie, 1.0)
        panel.axvspan(left, tie, color=QUIET, alpha=0.2, lw=0, gid="tie")
        drawn = np.maximum(losses, left)
        at = np.arange(len(words))
        panel.hlines(at, left, drawn, color=QUIET, lw=0.8)
        colours = [AFTER if loss < tie else BEFORE for loss in losses]
        panel.scatter(drawn, at, c=colours, s=22, zorder=3, gid="loss", clip_on=False)
        panel.set(xscale="log", xlabel=f"χ² lost without {name.id}")
        panel.set_xlim(left, 2 * max(drawn.max(), tie))
        panel.set_yticks(at, words)
        panel.set_ylim(len(words) - 0.5, -0.5)
        panel.set_ylabel("in its place")
        made.suptitle(textwrap.fill(rivalry(name), 52 if narrow else 80), x=0.01, ha="left")
        made.legend(handles=[mark("not told apart", marker="s", ms=7, alpha=0.3)], loc="outside lower center")
    return made


def rivalry(name: Name) -> str:
    """The finding: what comes closest to a name, and by how much it is worse."""
    if name.ties:
        return f"{', '.join(name.ties)} fits this recording as well as {name.id}"
    if not name.rivals:
        return f"Nothing else comes near {name.id}"
    best = min(name.rivals, key=lambda id: name.rivals[id])
    return f"The next best, {best}, loses {_round(name.rivals[best])} of χ² in the place of {name.id}"


def moved_figure(one: Diagnosis, narrow: bool = False) -> Figure | None:
    """By how many of its sd each of the baseline's numbers moves once names are in; None without one."""
    if not one.moved:
        return None
    numbers = sorted(one.moved.items(), key=lambda pair: -abs(pair[1].shift))[:NUMBERS]
    shifts = [moved.shift for _, moved in numbers]
    with theme():
        made = figure(SINGLE if narrow else 5.4, 1.15 + 0.2 * max(len(numbers), 2))
        panel = made.subplots()
        panel.axvspan(-1, 1, color=QUIET, alpha=0.3, lw=0, gid="sd")
        panel.axvline(0, color=QUIET, lw=0.6)
        at = np.arange(len(numbers))
        panel.hlines(at, 0, shifts, color=QUIET, lw=0.8)
        panel.plot(shifts, at, "o", color=AFTER, gid="shift")
        panel.set_yticks(at, [name for name, _ in numbers])
        panel.set_ylim(len(numbers) - 0.5, -0.5)
        reach = 1.15 * max(2.0, *map(abs, shifts))
        panel.set(xlim=(-reach, reach), xlabel="moved by [its sd before]")
        made.suptitle(textwrap.fill(swallowed(one), 52 if narrow else 80), x=0.01, ha="left")
        made.legend(handles=[mark("± 1 sd before", marker="s", ms=7, alpha=0.3)], loc="outside lower center")
    return made


def swallowed(one: Diagnosis) -> str:
    """The finding: how many of the baseline's numbers were biased, and which most."""
    far = [name for name, moved in one.moved.items() if abs(moved.shift) > 1]
    if not far:
        return "None of the baseline's numbers had swallowed the effect: all stay within 1 sd"
    worst = max(far, key=lambda name: abs(one.moved[name].shift))
    shift = f"{one.moved[worst].shift:+.1f}".replace("-", "−")
    return f"{len(far)} of {len(one.moved)} numbers moved by more than 1 sd; {worst} most, by {shift} sd"


def _rms(misfit: np.ndarray) -> float:
    misfit = misfit[np.isfinite(misfit)]
    return float(np.sqrt(np.mean(misfit**2))) if misfit.size else math.nan


def _told(value: float, channel: str) -> str:
    return f"{value * PER_SI[channel]:.3g} {UNIT[channel]}"


def _round(value: float) -> str:
    """Three digits, with thin thousands: 12 300."""
    if not 1 <= abs(value) < 1e9:
        return f"{value:.3g}"
    keep = max(0, 2 - math.floor(math.log10(abs(value)))) if abs(value) < 100 else 0
    short = round(value, 2 - math.floor(math.log10(abs(value))))
    return f"{short:,.{keep}f}".replace(",", "\u2009")
