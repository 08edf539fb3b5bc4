"""Figures of a fit: one question each, its answer in the title.

| figure                | question                                                         |
|-----------------------|------------------------------------------------------------------|
| `prediction_figure`   | does the fitted muscle show what was measured?                   |
| `residual_figure`     | where does it miss, and is that more than noise?                 |
| `held_out_figure`     | how much worse is it where it did not look?                      |
| `prior_figure`        | what did the recording teach beyond what was known before?       |
"""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import refuse
from pamjax.infer.fitting.report import quantity
from pamjax.infer.fitting.result import CaseFit, Estimate, Fit
from pamjax.units import in_unit, show
from pamjax.view.figures.layout import Layout, axes_of, key, layout, lines, mark, thin
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, SINGLE, figure, save_png, theme
from pamjax.view.wording import signed

#: A misfit above this many times the noise is a miss; as in the note.
MISS = 1.5
#: With more blocks than this, not every one has its name on the axis.
NAMED_BLOCKS = 30
#: A number that moved by less of its prior's standard deviation has not moved.
STILL = 0.05
#: Up to this many rows each point is a reading to be looked at; above, they are a cloud.
FEW = 200


def prediction_figure(one: CaseFit, narrow: bool = False) -> Figure:
    """Measured points beside the fitted muscle's lines, a panel a channel; one below another if narrow."""
    form, channels = layout(one.case), one.case.recording.channels
    with theme():
        made, panels = panels_of(len(channels), narrow)
        for panel, channel in zip(panels, channels, strict=True):
            _points_and_lines(panel, one, form, channel)
            panel.set(
                xlabel=form.xlabel, ylabel=f"{channel} [{DISPLAY_UNIT[channel]}]", title=missed(one, channel)
            )
        style = {"ls": "-"} if form.connected else {"marker": "x"}
        key(made, panels, form, mark("measured", marker="o", ms=3), mark("fitted muscle", **style))
    return made


def _points_and_lines(panel: Axes, one: CaseFit, form: Layout, channel: str) -> None:
    scale = in_unit(DISPLAY_UNIT[channel])
    measured = getattr(one.case.recording, channel) / scale
    model = one.prediction[channel] / scale
    there = np.isfinite(measured)
    kept = thin(np.where(form.group >= 0, form.x, np.nan), measured)
    style = _point(there)
    for group, colour in enumerate(form.colours):
        rows = kept[form.group[kept] == group]
        panel.plot(form.x[rows], measured[rows], color=colour, gid=f"measured group-{group}", **style)
        if not form.connected:
            panel.plot(form.x[rows], model[rows], "x", color=colour, gid=f"model group-{group}")
            continue
        for rows in lines(one.case, form, group, there):
            # White below every line parts it from its points, and hides no other line.
            panel.plot(
                form.x[rows], model[rows], color="white", lw=2.4, zorder=2.5, gid=f"casing group-{group}"
            )
            panel.plot(form.x[rows], model[rows], color=colour, zorder=3, gid=f"model group-{group}")


def panels_of(count: int, narrow: bool, height: float = 3.4, **shared: Any) -> tuple[Figure, list[Axes]]:
    """Panels beside one another, or one below another where there is no room."""
    if narrow:
        made = figure(SINGLE, 0.4 + 0.85 * height * count)
        return made, list(made.subplots(count, 1, squeeze=False, **shared)[:, 0])
    made = figure(DOUBLE if count > 1 else 4.8, height)
    return made, list(made.subplots(1, count, squeeze=False, **shared)[0])


def _point(there: np.ndarray) -> dict[str, Any]:
    """How a measured point looks: firm and above the lines where there are few, else part of a cloud."""
    few = there.sum() <= FEW
    shape = {"ms": 4, "zorder": 4} if few else {"ms": 2.3, "alpha": 0.5}
    return {"marker": "o", "ls": "none", "mew": 0, **shape}


def missed(one: CaseFit, channel: str) -> str:
    """The finding: by how much a channel is missed, against its noise or its largest value."""
    noise, misfit = one.noise[channel], f"{_size(one.rmse[channel], channel)} rms"
    if not noise.given:
        largest = np.nanmax(np.abs(getattr(one.case.recording, channel)))
        share = 100 * one.rmse[channel] / largest
        return f"{channel.capitalize()} is missed by {misfit},\n{share:.2g} % of its largest value"
    if noise.excess > MISS:
        times = f"{noise.excess:.0f}" if noise.excess >= 10 else f"{noise.excess:.2g}"
        return f"{channel.capitalize()} is missed by {misfit},\n{times} times its noise"
    return f"{channel.capitalize()} is met to {misfit};\nits noise is {_size(noise.sd, channel)}"


def _size(value: float, channel: str) -> str:
    return f"{value / in_unit(DISPLAY_UNIT[channel]):.3g} {DISPLAY_UNIT[channel]}"


def residual_figure(one: CaseFit, narrow: bool = False) -> Figure:
    """Measured − model over contraction, pressure and time, beside the band that noise would fill."""
    form, channels, columns = layout(one.case), one.case.recording.channels, axes_of(one.case)
    if narrow:  # what a phone has room for
        columns = dict(list(columns.items())[:1])
    with theme():
        width = SINGLE if narrow else DOUBLE if len(columns) > 1 else 4.8
        made = figure(width, 1.0 + 2.1 * len(channels))
        grid = made.subplots(len(channels), len(columns), sharey="row", sharex="col", squeeze=False)
        for row, channel in zip(grid, channels, strict=True):
            for panel, x in zip(row, columns.values(), strict=True):
                _residuals(panel, one, form, channel, x)
            row[0].set_ylabel(f"{channel}: measured − model [{DISPLAY_UNIT[channel]}]")
        for panel, label in zip(grid[-1], columns, strict=True):
            panel.set_xlabel(label)
        said = [outside(one, channel) for channel in channels]
        said = [textwrap.fill(text, 52) for text in said] if narrow else said
        made.suptitle("\n".join(said), x=0.01, ha="left")
        stated = all(one.noise[channel].given for channel in channels)
        whose = "its noise" if stated else "noise, or of the residual where none was stated"
        band = mark(f"± 2 sd of {whose}", marker="s", ms=7, alpha=0.3)
        key(made, list(grid.flat), form, mark("measured − model", marker="o", ms=3), band)
    return made


def _residual(one: CaseFit, channel: str) -> np.ndarray:
    """(n,) measured − model in the unit of the figure."""
    misfit = getattr(one.case.recording, channel) - one.prediction[channel]
    return np.where(one.case.recording.usable, misfit, np.nan) / in_unit(DISPLAY_UNIT[channel])


def _residuals(panel: Axes, one: CaseFit, form: Layout, channel: str, x: np.ndarray) -> None:
    misfit, sd = _residual(one, channel), one.noise[channel].sd / in_unit(DISPLAY_UNIT[channel])
    panel.axhspan(-2 * sd, 2 * sd, color=QUIET, alpha=0.3, lw=0, gid="noise")
    panel.axhline(0, color=QUIET, lw=0.6)
    kept = thin(x, np.where(form.group >= 0, misfit, np.nan))
    style = _point(np.isfinite(misfit))
    for group, colour in enumerate(form.colours):
        rows = kept[form.group[kept] == group]
        panel.plot(x[rows], misfit[rows], color=colour, gid=f"residual group-{group}", **style)


def outside(one: CaseFit, channel: str) -> str:
    """The finding: how many samples noise does not explain, or the largest miss where none was stated."""
    noise, misfit = one.noise[channel], np.abs(_residual(one, channel))
    if not noise.given:
        row = int(np.nanargmax(misfit))
        pressure, length = one.case.recording.pressure[row], one.case.recording.length[row]
        at = f"{show(pressure, 'kPa', 3)} and {show(length, 'mm')}"
        return f"{channel.capitalize()}: missed most at {at}, by {misfit[row]:.3g} {DISPLAY_UNIT[channel]}"
    far = 100 * np.mean(misfit[np.isfinite(misfit)] > 2 * noise.sd / in_unit(DISPLAY_UNIT[channel]))
    return f"{channel.capitalize()}: {far:.0f} % of samples outside ± 2 sd of its noise, where 5 % belong"


def held_out_figure(one: CaseFit, narrow: bool = False) -> Figure:
    """Misfit of every block, in the fit that saw it and in the one that did not.

    Raises:
        BadInput: if no block was held out.
    """
    if one.held_out is None:
        raise refuse("this figure needs blocks that were held out", "one block", one.case.name)
    channels = list(one.held_out.rmse)
    names = _in_order(one)
    with theme():
        height = 1.4 + 0.16 * min(max(len(names), 6), NAMED_BLOCKS)
        made, panels = panels_of(len(channels), narrow, height, sharey=True)
        for panel, channel in zip(panels, channels, strict=True):
            _blocks(panel, one, channel, names)
        every = math.ceil(len(names) / NAMED_BLOCKS)
        panels[0].set_yticks(range(0, len(names), every), names[::every])
        panels[0].invert_yaxis()
        given = [one.noise[channel].given for channel in channels]
        own = [mark("its noise" if all(given) else "residual's own noise", ls="--")]
        seen = mark("seen by the fit", marker="o", color=OKABE_ITO["blue"])
        unseen = mark("held out", marker="D", color=OKABE_ITO["vermilion"], mfc="none")
        made.legend(handles=[seen, unseen, *own], loc="outside lower center", ncols=3)
    return made


def _in_order(one: CaseFit) -> list[str]:
    """Names of the blocks with a measured row, by their setting where they are one, else by time."""
    assert one.held_out is not None
    recording, label = one.case.recording, np.array(one.block)
    measured = np.isfinite(recording.force) | np.isfinite(recording.diameter)
    names = [name for name in dict.fromkeys(one.block) if name and measured[label == name].any()]
    setting = {"isobars": recording.pressure, "lengths": recording.length}.get(one.held_out.kind)
    if setting is None:
        return names
    return sorted(names, key=lambda name: float(np.median(setting[label == name])))


def _blocks(panel: Axes, one: CaseFit, channel: str, names: list[str]) -> None:
    scale = in_unit(DISPLAY_UNIT[channel])
    label = np.array(one.block)
    rmse = {}
    for kind, predicted in (("seen", one.prediction), ("unseen", one.unseen)):
        misfit = getattr(one.case.recording, channel) - predicted[channel]
        rmse[kind] = np.array([_rms(misfit[label == name]) / scale for name in names])
    at = np.arange(len(names))
    panel.hlines(at, rmse["seen"], rmse["unseen"], color=QUIET, lw=0.8)
    panel.plot(rmse["seen"], at, "o", color=OKABE_ITO["blue"], gid="seen")
    panel.plot(rmse["unseen"], at, "D", color=OKABE_ITO["vermilion"], mfc="none", ms=5.5, gid="unseen")
    panel.axvline(one.noise[channel].sd / scale, color=QUIET, ls="--", lw=0.8, gid="noise")
    # Room for half a mark: a limit on one side alone would freeze the other where it is.
    most = np.nanmax([*rmse["seen"], *rmse["unseen"], one.noise[channel].sd / scale])
    panel.set_xlim(0, 1.08 * most)
    panel.set(xlabel=f"rmse of {channel} [{DISPLAY_UNIT[channel]}]", title=generalises(one, channel))


def _rms(misfit: np.ndarray) -> float:
    misfit = misfit[np.isfinite(misfit)]
    return float(np.sqrt(np.mean(misfit**2))) if misfit.size else math.nan


def generalises(one: CaseFit, channel: str) -> str:
    """The finding: how much a channel loses where the fit did not look."""
    assert one.held_out is not None
    seen, unseen = one.rmse[channel], one.held_out.rmse[channel]
    head = f"Held-out {one.held_out.kind}: {channel} missed by {_size(unseen, channel)},\n"
    more = 100 * (unseen / seen - 1) if seen > 0 else math.inf
    if abs(more) < 0.5:
        return f"{head}as where seen"
    return (
        f"{head}{abs(more):.0f} % {'more' if more > 0 else 'less'} than where seen ({_size(seen, channel)})"
    )


def prior_figure(fit: Fit, narrow: bool = False) -> Figure | None:
    """What was known before and what the fit says, on the scale of the prior; None where none was stated."""
    known = with_prior(fit)
    names = list(known)
    if not names:
        return None
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 1.3 + 0.22 * max(len(names), 3))
        panel = made.subplots()
        panel.axvspan(-1, 1, color=QUIET, alpha=0.3, lw=0, gid="prior")
        panel.axvline(0, color=QUIET, lw=0.6)
        for at, e in enumerate(known.values()):
            _estimate(panel, at, e)
        panel.set_yticks(range(len(names)), names)
        panel.set_ylim(len(names) - 0.5, -0.5)
        low, high = panel.get_xlim()
        panel.set_xlim(min(low, -2.5), max(high, 2.5))
        panel.set(xlabel="distance from the prior [its sd]")
        says = learned(fit)
        # Across the whole figure: beside the names of the rows a phone has no room for it.
        made.suptitle(textwrap.fill(says, 48) if narrow else says, x=0.01, ha="left", fontsize=8)
        handles = [
            mark("prior ± 1 sd", marker="s", ms=7, alpha=0.3),
            mark("estimate ± 1 sd", marker="o", ls="-", color=OKABE_ITO["blue"]),
        ]
        if any(e.sd is None for e in known.values()):
            handles.append(mark("at a limit, or not determined", marker="x", color=OKABE_ITO["vermilion"]))
        made.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else 3)
    return made


def with_prior(fit: Fit) -> dict[str, Estimate]:
    """The numbers of which something was believed before."""
    return {name: e for name, e in fit.estimates.items() if math.isfinite(e.prior_sd)}


def _estimate(panel: Axes, at: int, e: Estimate) -> None:
    """One row: the estimate in prior sd, and its value in words at the right margin."""
    text = quantity(e.value, e.sd, e.meaning.show)
    shift = (e.value - e.prior) / e.prior_sd
    if e.sd is None:
        panel.plot([shift], [at], "x", color=OKABE_ITO["vermilion"], gid="undetermined")
    else:
        panel.errorbar(
            [shift], [at], xerr=[e.sd / e.prior_sd], fmt="o", color=OKABE_ITO["blue"], gid="estimate"
        )
    panel.text(1.01, at, text, transform=panel.get_yaxis_transform(), va="center", fontsize=7)


def learned(fit: Fit) -> str:
    """The finding: how many numbers with a prior the recording pinned down, and which moved farthest."""
    known = with_prior(fit)
    pinned = sum(e.learned > 0.5 for e in known.values())
    whose = "numbers" if len(known) == len(fit.estimates) else "numbers that had a prior"
    text = f"The recording halves the uncertainty of {pinned} of {len(known)} {whose}"
    shifts = {name: (e.value - e.prior) / e.prior_sd for name, e in known.items()}
    farthest = max(shifts, key=lambda name: abs(shifts[name]))
    if abs(shifts[farthest]) < STILL:
        return f"{text};\nnone moved from its prior"
    return f"{text};\n{farthest} moved farthest, {signed(shifts[farthest])} sd of its prior"


def save_figures(fit: Fit, folder: Path) -> list[Path]:
    """Draw every figure that a fit has an answer for; each as PNG.

    Returns:
        the PNG files, the prior's first, with the case's name before the figure's where there are several.
    """
    prior = prior_figure(fit)
    if prior is None:
        # One that an earlier fit left in this folder speaks of that one.
        (folder / "prior.png").unlink(missing_ok=True)
    written = [save_png(prior, folder / "prior")] if prior is not None else []
    for one in fit.cases:
        head = "" if len(fit.cases) == 1 else f"{one.case.name}-"
        written.append(save_png(prediction_figure(one), folder / f"{head}prediction"))
        written.append(save_png(residual_figure(one), folder / f"{head}residual"))
        if one.held_out is not None:
            written.append(save_png(held_out_figure(one), folder / f"{head}held-out"))
    return written
