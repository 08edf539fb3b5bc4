"""Three steps of a diagnosis: misfit of the baseline, missing mechanism, improved model."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT, format_channel_value, to_display
from pamjax.diagnosis.result import Diagnosis
from pamjax.infer.problem.rms import compute_rms
from pamjax.model.registry import find_mechanism
from pamjax.text import join_words
from pamjax.units import compute_si_factor
from pamjax.view.figures.layout import Layout, add_key, build_layout, create_mark, thin_points
from pamjax.view.figures.misfit_map import find_main_channel
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
)
from pamjax.view.wording import wrap_title

#: Largest number of other mechanisms in the second step.
_MAX_SHOWN_RIVALS = 4
#: Width of a title, letters.
_TITLE_LETTERS = 34


def plot_steps(diagnosis: Diagnosis, narrow: bool = False) -> Figure | None:
    """Return residuals of baseline and model, and the rival mechanisms between; None without a mechanism.

    The residuals of held-out blocks are those of fits without them.
    """
    if not diagnosis.named_mechanisms:
        return None
    channel_index = find_main_channel(diagnosis)
    channel = diagnosis.problem.channels[channel_index]
    row_layout = build_layout(diagnosis.problem.case)
    measured = diagnosis.problem.measured[channel_index]
    baseline_residual, model_residual = (
        measured - p[channel_index]
        for p in (diagnosis.held_out_errors.baseline_prediction, diagnosis.held_out_errors.model_prediction)
    )
    noise = diagnosis.as_dict()["noise"][channel]["sd"]
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 7.2 if narrow else 2.9)
        panels = list(drawing.subplots(*((3, 1) if narrow else (1, 3))).flat)
        limit = 1.1 * float(np.nanmax(np.abs(to_display(channel, baseline_residual))))
        for panel, residual, model in (
            (panels[0], baseline_residual, "baseline"),
            (panels[2], model_residual, "model"),
        ):
            _plot_residual(panel, to_display(channel, residual), row_layout, noise)
            panel.set(ylim=(-limit, limit), xlabel=row_layout.xlabel)
            panel.set_ylabel(f"{channel}: measured − {model} [{DISPLAY_UNIT[channel]}]")
        _plot_rivals(panels[1], diagnosis)
        for panel, title in zip(
            panels, _format_steps(diagnosis, channel, baseline_residual, model_residual), strict=True
        ):
            panel.set_title(wrap_title(title, _TITLE_LETTERS))
        add_key(
            drawing,
            panels,
            row_layout,
            create_mark("measured", marker="o", ms=3),
            create_mark("noise ± 2 sd", marker="s", ms=7, alpha=0.3),
        )
    return drawing


def _plot_residual(panel: Panel, residual: np.ndarray, row_layout: Layout, noise: float) -> None:
    panel.axhspan(-2 * noise, 2 * noise, color=REFERENCE_COLOUR, alpha=0.25, lw=0, gid="noise")
    drawn_rows = thin_points(np.where(row_layout.group >= 0, row_layout.x, np.nan), residual)
    for group, colour in enumerate(row_layout.colours):
        rows = drawn_rows[row_layout.group[drawn_rows] == group]
        panel.plot(
            row_layout.x[rows], residual[rows], ".", ms=3.5, color=colour, gid=f"residual group-{group}"
        )


def _plot_rivals(panel: Panel, diagnosis: Diagnosis) -> None:
    """Draw the increase of χ² if another mechanism, or none, replaces the first named mechanism."""
    mechanism = diagnosis.named_mechanisms[0]
    rivals = sorted(mechanism.rival_bic_increase.items(), key=lambda pair: pair[1])[:_MAX_SHOWN_RIVALS]
    names = [mechanism.id, *(id for id, _ in rivals), "no mechanism"]
    increases = np.array([0.0, *(max(increase, 0.0) for _, increase in rivals), mechanism.chi2_increase])
    y, colours = np.arange(len(names)), [OKABE_ITO["blue"], *[OKABE_ITO["vermilion"]] * (len(names) - 1)]
    panel.hlines(y, 0, increases, color=REFERENCE_COLOUR, lw=0.8)
    panel.scatter(increases, y, c=colours, s=22, zorder=3, clip_on=False, gid="increase")
    for k, name in enumerate(names):
        panel.annotate(name, (0, k), (2, 5), textcoords="offset points", fontsize=6.5, va="bottom")
    panel.set_xscale("symlog", linthresh=10.0)
    panel.set_xlim(0, 10 ** math.ceil(math.log10(max(increases.max(), 20.0))))
    panel.set_ylim(len(names) - 0.6, -0.9)
    panel.set(yticks=[], xlabel="χ² above the best mechanism")


def _format_steps(
    diagnosis: Diagnosis, channel: str, baseline_residual: np.ndarray, model_residual: np.ndarray
) -> list[str]:
    """Return the titles of the three steps."""
    titles = join_words([find_mechanism(m.id).about.title for m in diagnosis.named_mechanisms])
    baseline_text, model_text = (
        format_channel_value(compute_rms(residual), channel)
        for residual in (baseline_residual, model_residual)
    )
    noise = diagnosis.as_dict()["noise"][channel]["sd"]
    noise_text = format_channel_value(noise * compute_si_factor(DISPLAY_UNIT[channel]), channel)
    return [
        f"1. Misfit: rms error of {channel} {baseline_text}",
        f"2. Mechanism: {titles}",
        f"3. Improved model: rms error {model_text}, noise {noise_text}",
    ]
