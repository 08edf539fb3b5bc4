"""Figures of a diagnosis: one question each, its answer in the title.

| figure              | question                                                             |
|---------------------|----------------------------------------------------------------------|
| `map_figure`        | where is the baseline wrong? (in `mismatch_map`)                     |
| `loops_figure`      | do loops lie on the measured ones with names? (in `diagnosis_loops`) |
| `left_out_figure`   | is what the baseline leaves what the names add? (there too)          |
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

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.select.search import TIE, TIE_SHARE
from pamjax.diagnosis.select.selection import Name
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.units import in_unit
from pamjax.view.figures.diagnosis_loops import rms, told
from pamjax.view.figures.layout import mark
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, theme

#: Most rivals of a name, and most baseline numbers, in a figure.
RIVALS, NUMBERS = 7, 12
#: Scores that differ by more than this factor stand on a logarithmic axis.
WIDE = 8.0
BEFORE, AFTER = OKABE_ITO["vermilion"], OKABE_ITO["blue"]


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
        before = [mark("baseline", marker="D", color=BEFORE, mfc="none")]
        after = [mark("with names", marker="o", color=AFTER)] if one.names else []
        handles = [*before, *after, mark("noise", ls="--")]
        made.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return made


def _scores(panel: Panel, one: Diagnosis, channel: str, names: list[str]) -> None:
    c = CHANNELS.index(channel)
    found = {}
    for kind, prediction in (("before", one.gain.before), ("after", one.gain.after)):
        misfit = np.where(one.gain.held_out, one.found.measured[c] - prediction[c], np.nan)
        masks = [one.blocks.mask(one.blocks.names.index(name)) for name in names]
        together = [rms(misfit)] if len(names) > 1 else []
        found[kind] = to_display(channel, np.array([rms(misfit[m]) for m in masks] + together))
    at = np.arange(len(found["before"]))
    noise = one.as_dict()["noise"][channel]["sd"]
    panel.plot(found["before"], at, "D", color=BEFORE, mfc="none", ms=5.5, gid="before")
    if one.names:
        panel.hlines(at, found["before"], found["after"], color=QUIET, lw=0.8)
        panel.plot(found["after"], at, "o", color=AFTER, gid="after")
    panel.axvline(noise, color=QUIET, ls="--", lw=0.8, gid="noise")
    if np.nanmax(found["before"]) > WIDE * min(noise, np.nanmin(found["after"])):
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    else:
        panel.set_xlim(0, 1.08 * max(noise, *found["before"], *found["after"]))
    before, after = (told(score[channel], channel) for score in (one.gain.rmse_before, one.gain.rmse_after))
    change = f"{before} → {after}" if one.names else before
    title = (
        f"Held-out {channel}: {change};\nits noise is {told(noise * in_unit(DISPLAY_UNIT[channel]), channel)}"
    )
    panel.set(xlabel=f"rmse of {channel} [{DISPLAY_UNIT[channel]}]", title=title)


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
        made.suptitle(textwrap.fill(rivalry(name), 48 if narrow else 80), x=0.01, ha="left")
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
        made.suptitle(textwrap.fill(swallowed(one), 48 if narrow else 80), x=0.01, ha="left")
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


def _round(value: float) -> str:
    """Three digits, with thin thousands: 12 300."""
    if not 1 <= abs(value) < 1e9:
        return f"{value:.3g}"
    keep = max(0, 2 - math.floor(math.log10(abs(value)))) if abs(value) < 100 else 0
    short = round(value, 2 - math.floor(math.log10(abs(value))))
    return f"{short:,.{keep}f}".replace(",", "\u2009")
