"""Figures of a diagnosis: each answers one question in its title.

| figure                     | question                                                                  |
|----------------------------|---------------------------------------------------------------------------|
| `plot_map`                 | where does the baseline model not fit? (in `misfit_map`)                  |
| `plot_loops`               | do the predicted loops match the measured ones? (in `diagnosis_loops`)    |
| `plot_explained_residuals` | do the identified mechanisms explain the residuals? (in `diagnosis_loops`) |
| `plot_held_out_scores`     | is the error of held-out blocks as small as the noise?                    |
| `plot_candidates`          | how much worse do other mechanisms fit in place of an identified one?     |
| `plot_shifts`              | which baseline parameters were biased by the missing physics?             |
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from pamjax.channels import DISPLAY_UNIT, format_channel_value, to_display
from pamjax.diagnosis.estimates import ParameterShift
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.infer.problem.rms import compute_rms
from pamjax.text import join_words
from pamjax.units import compute_si_factor, format_count
from pamjax.view.figures.layout import create_mark
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
    separate_panels,
)
from pamjax.view.wording import format_signed, wrap_title

#: Largest number of rival mechanisms and of baseline parameters in a figure.
_MAX_RIVALS, _MAX_SHIFTS = 7, 12
#: Ratio of the largest to the smallest error above which the axis is logarithmic.
_LOG_AXIS_RATIO = 8.0
_BASELINE_MARK_COLOUR, _NAMED_COLOUR = OKABE_ITO["vermilion"], OKABE_ITO["blue"]


def plot_held_out_scores(diagnosis: Diagnosis, narrow: bool = False) -> Figure | None:
    """Return the error of each held-out block without and with the mechanisms; None without such a block."""
    channels = list(diagnosis.held_out_errors.baseline_rmse)
    if not channels:
        return None
    block_names = [
        diagnosis.blocks.names[k]
        for k in np.unique(diagnosis.blocks.label[diagnosis.held_out_errors.held_out_mask])
        if k >= 0
    ]
    with apply_theme():
        row_labels = [*block_names, "all blocks"] if len(block_names) > 1 else block_names
        height = 1.15 + 0.22 * len(row_labels)
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 0.4 + height * len(channels) if narrow else height
        )
        shape = (len(channels), 1) if narrow else (1, len(channels))
        panels = list(drawing.subplots(*shape, sharey=True, squeeze=False).flat)
        separate_panels(drawing)
        for panel, channel in zip(panels, channels, strict=True):
            _plot_scores(panel, diagnosis, channel, block_names)
        panels[0].set_yticks(range(len(row_labels)), row_labels)
        panels[0].set_ylim(len(row_labels) - 0.5, -0.5)
        baseline_marks = [create_mark("baseline", marker="D", color=_BASELINE_MARK_COLOUR, mfc="none")]
        named_marks = (
            [create_mark("with mechanisms", marker="o", color=_NAMED_COLOUR)]
            if diagnosis.named_mechanisms
            else []
        )
        handles = [*baseline_marks, *named_marks, create_mark("noise", ls="--")]
        drawing.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return drawing


def _plot_scores(panel: Panel, diagnosis: Diagnosis, channel: str, block_names: list[str]) -> None:
    channel_index = diagnosis.problem.channels.index(channel)
    rmse = {}
    for kind, prediction in (
        ("baseline", diagnosis.held_out_errors.baseline_prediction),
        ("model", diagnosis.held_out_errors.model_prediction),
    ):
        misfit = np.where(
            diagnosis.held_out_errors.held_out_mask,
            diagnosis.problem.measured[channel_index] - prediction[channel_index],
            np.nan,
        )
        masks = [diagnosis.blocks.build_mask(diagnosis.blocks.names.index(name)) for name in block_names]
        overall = [compute_rms(misfit)] if len(block_names) > 1 else []
        rmse[kind] = to_display(channel, np.array([compute_rms(misfit[m]) for m in masks] + overall))
    y = np.arange(len(rmse["baseline"]))
    noise = diagnosis.as_dict()["noise"][channel]["sd"]
    panel.plot(rmse["baseline"], y, "D", color=_BASELINE_MARK_COLOUR, mfc="none", ms=5.5, gid="baseline")
    if diagnosis.named_mechanisms:
        panel.hlines(y, rmse["baseline"], rmse["model"], color=REFERENCE_COLOUR, lw=0.8)
        panel.plot(rmse["model"], y, "o", color=_NAMED_COLOUR, gid="model")
    panel.axvline(noise, color=REFERENCE_COLOUR, ls="--", lw=0.8, gid="noise")
    if np.nanmax(rmse["baseline"]) > _LOG_AXIS_RATIO * min(noise, np.nanmin(rmse["model"])):
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    else:
        panel.set_xlim(0, 1.08 * max(noise, *rmse["baseline"], *rmse["model"]))
    baseline_text, model_text = (
        format_channel_value(score[channel], channel)
        for score in (diagnosis.held_out_errors.baseline_rmse, diagnosis.held_out_errors.model_rmse)
    )
    change = f"{baseline_text} → {model_text}" if diagnosis.named_mechanisms else baseline_text
    title = (
        f"Held-out RMS error of {channel}:\n{change}"
        f" (noise {format_channel_value(noise * compute_si_factor(DISPLAY_UNIT[channel]), channel)})"
    )
    panel.set(xlabel=f"RMS error of {channel} [{DISPLAY_UNIT[channel]}]", title=title)


def plot_candidates(diagnosis: Diagnosis, mechanism: NamedMechanism, narrow: bool = False) -> Figure:
    """Return the increase of χ² if another mechanism, or none, replaces an identified mechanism.

    Rivals that fit worse than no mechanism are not shown: their amplitude is zero at best.
    """
    rivals = [
        (id, increase)
        for id, increase in sorted(mechanism.rival_bic_increase.items(), key=lambda pair: pair[1])
        if increase < mechanism.chi2_increase
    ][:_MAX_RIVALS]
    labels = [*(id for id, _ in rivals), "no mechanism"]
    increases = np.array([*(increase for _, increase in rivals), mechanism.chi2_increase])
    settings = diagnosis.settings
    tie_increase = settings.tie_chi2 + settings.tie_excess_share * diagnosis.selection.model.excess_chi2
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else 5.4, 1.1 + 0.2 * len(labels))
        panel = drawing.subplots()
        left_edge = 0.5 * min(tie_increase, 1.0)
        panel.axvspan(left_edge, tie_increase, color=REFERENCE_COLOUR, alpha=0.2, lw=0, gid="tie")
        shown_increases = np.maximum(increases, left_edge)
        y = np.arange(len(labels))
        panel.hlines(y, left_edge, shown_increases, color=REFERENCE_COLOUR, lw=0.8)
        colours = [
            _NAMED_COLOUR if increase < tie_increase else _BASELINE_MARK_COLOUR for increase in increases
        ]
        panel.scatter(shown_increases, y, c=colours, s=22, zorder=3, gid="increase", clip_on=False)
        panel.set(xscale="log", xlabel="increase of χ²")
        panel.set_xlim(left_edge, 2 * max(shown_increases.max(), tie_increase))
        panel.set_yticks(y, labels)
        panel.set_ylim(len(labels) - 0.5, -0.5)
        panel.set_ylabel("replaced by")
        drawing.suptitle(wrap_title(_format_rivalry(mechanism), 48 if narrow else 80), x=0.01, ha="left")
        drawing.legend(
            handles=[create_mark("indistinguishable", marker="s", ms=7, alpha=0.3)],
            loc="outside lower center",
        )
    return drawing


def _format_rivalry(mechanism: NamedMechanism) -> str:
    """Return the title: the best rival mechanism, and how much worse it fits."""
    if mechanism.indistinguishable:
        verb = "fits" if len(mechanism.indistinguishable) == 1 else "fit"
        rivals = join_words(list(mechanism.indistinguishable))
        return f"{rivals} {verb} this recording as well as {mechanism.id}"
    if not mechanism.rival_bic_increase:
        return f"No other mechanism is a rival of {mechanism.id}"
    best_rival = min(mechanism.rival_bic_increase, key=lambda id: mechanism.rival_bic_increase[id])
    change = mechanism.rival_bic_increase[best_rival]
    verb = "increases" if change > 0 else "decreases"
    return (
        f"The best rival of {mechanism.id} is {best_rival}; it {verb} χ² by"
        f" {_format_three_digits(abs(change))}"
    )


def plot_shifts(diagnosis: Diagnosis, narrow: bool = False) -> Figure | None:
    """Return the shift of each baseline parameter in its sd, or None without an identified mechanism."""
    known_shifts = _select_known_shifts(diagnosis)
    if not known_shifts:
        return None
    largest_shifts = sorted(known_shifts.items(), key=lambda pair: -pair[1].order)[:_MAX_SHIFTS]
    shifts = [shift.shift_in_sd for _, shift in largest_shifts]
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else 5.4, 1.15 + 0.2 * max(len(largest_shifts), 2))
        panel = drawing.subplots()
        panel.axvspan(-1, 1, color=REFERENCE_COLOUR, alpha=0.3, lw=0, gid="sd")
        panel.axvline(0, color=REFERENCE_COLOUR, lw=0.6)
        y = np.arange(len(largest_shifts))
        panel.hlines(y, 0, shifts, color=REFERENCE_COLOUR, lw=0.8)
        panel.plot(shifts, y, "o", color=_NAMED_COLOUR, gid="shift")
        panel.set_yticks(y, [name for name, _ in largest_shifts])
        panel.set_ylim(len(largest_shifts) - 0.5, -0.5)
        x_limit = 1.15 * max(2.0, *map(abs, shifts))
        panel.set(xlim=(-x_limit, x_limit), xlabel="shift [sd of the baseline fit]")
        drawing.suptitle(wrap_title(_format_shifts(diagnosis), 48 if narrow else 80), x=0.01, ha="left")
        drawing.legend(
            handles=[create_mark("± 1 sd of the baseline fit", marker="s", ms=7, alpha=0.3)],
            loc="outside lower center",
        )
    return drawing


def _format_shifts(diagnosis: Diagnosis) -> str:
    """Return the title: how many baseline parameters were biased, and which one most."""
    known_shifts = _select_known_shifts(diagnosis)
    at_limit = len(diagnosis.parameter_shifts) - len(known_shifts)
    others = f"; {format_count(at_limit, 'parameter')} at a limit not shown" if at_limit else ""
    biased_names = [name for name, shift in known_shifts.items() if shift.order > 1]
    if not biased_names:
        return f"The missing mechanisms biased no baseline parameter by more than 1 sd{others}"
    most_biased = max(biased_names, key=lambda name: known_shifts[name].order)
    shift_text = format_signed(known_shifts[most_biased].shift_in_sd)
    return (
        f"{len(biased_names)} of {len(diagnosis.parameter_shifts)} parameters"
        f" {'shifts' if len(biased_names) == 1 else 'shift'} by more than 1 sd; largest: {most_biased},"
        f" {shift_text} sd{others}"
    )


def _select_known_shifts(diagnosis: Diagnosis) -> dict[str, ParameterShift]:
    """Return the shifts in sd; a baseline parameter at its limit has none."""
    return {n: s for n, s in diagnosis.parameter_shifts.items() if math.isfinite(s.shift_in_sd)}


def _format_three_digits(value: float) -> str:
    """Return a value with three digits and thin spaces between thousands, such as 12 300."""
    if not 1 <= abs(value) < 1e9:
        return f"{value:.3g}"
    decimals = max(0, 2 - math.floor(math.log10(abs(value)))) if abs(value) < 100 else 0
    rounded_value = round(value, 2 - math.floor(math.log10(abs(value))))
    return f"{rounded_value:,.{decimals}f}".replace(",", "\u2009")
