"""Figures of a fit, row by row and block by block: each answers one question in its title.

| figure            | question                                                    |
|-------------------|-------------------------------------------------------------|
| `plot_prediction` | does the fitted model predict the measured values?          |
| `plot_residual`   | where is the misfit, and does it exceed the noise?          |
| `plot_held_out`   | how much larger is the misfit of held-out blocks?           |

The figure of the priors is in `fit_priors.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT, format_channel_value
from pamjax.errors import BadInput
from pamjax.infer.fitting.report import exceeds_noise
from pamjax.infer.fitting.result import CaseFit, Fit
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.infer.problem.rms import compute_rms
from pamjax.records.case import Case
from pamjax.units import compute_si_factor, format_quantity
from pamjax.view.figures.fit_priors import plot_prior
from pamjax.view.figures.layout import (
    Layout,
    add_key,
    build_layout,
    create_band_mark,
    create_mark,
    create_model_mark,
    draw_band,
    iterate_lines,
    select_axes,
    thin_points,
)
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
    save_png,
    separate_panels,
)
from pamjax.view.wording import wrap_title

#: Largest number of blocks that all have a label on the axis.
_MAX_NAMED_BLOCKS = 30
#: Largest number of rows that are drawn as large points above the lines.
_MAX_CLEAR_POINTS = 200
#: Width of the model's line inside a band, points.
_BAND_LINE_WIDTH = 0.7
#: Largest increase of the held-out error that the title has in percent; a larger one is a ratio.
_MAX_PERCENT_MORE = 200.0


def plot_prediction(case_fit: CaseFit, narrow: bool = False) -> Figure:
    """Return measured points and the fitted model's lines, a panel per channel, stacked if narrow."""
    row_layout, channels = build_layout(case_fit.case), case_fit.case.recording.channels
    with apply_theme():
        drawing, panels = create_panels(len(channels), narrow)
        for panel, channel in zip(panels, channels, strict=True):
            _plot_points_and_lines(panel, case_fit, row_layout, channel)
            panel.set(
                xlabel=row_layout.xlabel,
                ylabel=f"{channel} [{DISPLAY_UNIT[channel]}]",
                title=_format_misfit_title(case_fit, channel),
            )
            if channel == "length":
                _add_contraction_axis(panel, case_fit.case)
        add_key(
            drawing,
            panels,
            row_layout,
            create_mark("measured", marker="o", ms=3),
            create_model_mark("fitted model", row_layout),
            *(
                [create_band_mark("the model", {c: case_fit.prediction_sd[c] for c in channels})]
                if case_fit.prediction_sd and row_layout.is_connected
                else []
            ),
        )
    return drawing


def _add_contraction_axis(panel: Axes, case: Case) -> None:
    """Add an axis of contraction in % to a panel whose vertical axis is the length in mm."""
    rest_length = case.muscle_toml.rest_length.value / compute_si_factor(DISPLAY_UNIT["length"])

    def convert_length(length):
        return 100 * (1 - length / rest_length)

    def convert_contraction(contraction):
        return rest_length * (1 - contraction / 100)

    axis = panel.secondary_yaxis("right", functions=(convert_length, convert_contraction))
    axis.set_ylabel("contraction [%]")


def _blank_meaningless_rows(case: Case, channel: str, prediction: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the prediction of a channel, (n,), NaN for the length at a set force near zero pressure.

    There the muscle has no stiffness, and the predicted length can be metres.
    """
    if not case.recording.measures_length:
        return prediction[channel]
    return np.where(find_informative_samples(case, channel), prediction[channel], np.nan)


def _plot_points_and_lines(panel: Axes, case_fit: CaseFit, row_layout: Layout, channel: str) -> None:
    scale = compute_si_factor(DISPLAY_UNIT[channel])
    measured_values = getattr(case_fit.case.recording, channel) / scale
    predicted_values = _blank_meaningless_rows(case_fit.case, channel, case_fit.prediction) / scale
    measured_rows = np.isfinite(measured_values)
    drawn_rows = thin_points(np.where(row_layout.group >= 0, row_layout.x, np.nan), measured_values)
    style = _choose_point_style(measured_rows)
    for group, colour in enumerate(row_layout.colours):
        rows = drawn_rows[row_layout.group[drawn_rows] == group]
        panel.plot(
            row_layout.x[rows], measured_values[rows], color=colour, gid=f"measured group-{group}", **style
        )
        if channel in case_fit.prediction_sd:
            margin = 2 * case_fit.prediction_sd[channel] / scale
            low, high = predicted_values - margin, predicted_values + margin
            draw_band(panel, case_fit.case, row_layout, group, measured_rows, low, high)
        if not row_layout.is_connected:
            panel.plot(
                row_layout.x[rows], predicted_values[rows], "x", color=colour, gid=f"model group-{group}"
            )
            continue
        has_band = channel in case_fit.prediction_sd
        for rows in iterate_lines(case_fit.case, row_layout, group, measured_rows):
            x, y = row_layout.x[rows], predicted_values[rows]
            if not has_band:
                # A white outline separates the line from the points of its group. It would hide a band.
                panel.plot(x, y, color="white", lw=2.4, zorder=2.5, gid=f"casing group-{group}")
            width = _BAND_LINE_WIDTH if has_band else None
            panel.plot(x, y, color=colour, lw=width, zorder=3, gid=f"model group-{group}")


def create_panels(
    count: int, narrow: bool, height: float = 3.4, **subplot_options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels side by side, or stacked if narrow."""
    if narrow:
        drawing = create_figure(SINGLE_COLUMN, 0.4 + 0.85 * height * count)
        return drawing, list(drawing.subplots(count, 1, squeeze=False, **subplot_options)[:, 0])
    drawing = create_figure(DOUBLE_COLUMN if count > 1 else 4.8, height)
    separate_panels(drawing)
    return drawing, list(drawing.subplots(1, count, squeeze=False, **subplot_options)[0])


def _choose_point_style(measured_rows: np.ndarray) -> dict[str, Any]:
    """Return the style of measured points: large and above the lines if they are few."""
    is_sparse = measured_rows.sum() <= _MAX_CLEAR_POINTS
    shape = {"ms": 4, "zorder": 4} if is_sparse else {"ms": 2.3, "alpha": 0.5}
    return {"marker": "o", "ls": "none", "mew": 0, **shape}


def _format_misfit_title(case_fit: CaseFit, channel: str) -> str:
    """Return the title: a channel's RMS error relative to its noise, or to its largest value."""
    noise, rmse_text = case_fit.noise[channel], format_channel_value(case_fit.rmse[channel], channel)
    if not noise.is_known:
        largest = np.nanmax(np.abs(getattr(case_fit.case.recording, channel)))
        share = 100 * case_fit.rmse[channel] / largest
        return f"RMS error of {channel}: {rmse_text}\n({share:.2g} % of the largest value)"
    if exceeds_noise(noise):
        ratio = case_fit.rmse[channel] / noise.sd
        ratio_text = f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"
        return f"RMS error of {channel}: {rmse_text}\n({ratio_text} times the noise)"
    return f"RMS error of {channel}: {rmse_text}\n(noise {format_channel_value(noise.sd, channel)})"


def plot_residual(case_fit: CaseFit, narrow: bool = False) -> Figure:
    """Return measured − model over contraction, pressure and time, with the noise band."""
    row_layout, channels, columns = (
        build_layout(case_fit.case),
        case_fit.case.recording.channels,
        select_axes(case_fit.case),
    )
    if narrow:  # A phone has room for one column.
        columns = dict(list(columns.items())[:1])
    with apply_theme():
        width = SINGLE_COLUMN if narrow else DOUBLE_COLUMN if len(columns) > 1 else 4.8
        drawing = create_figure(width, 1.0 + 2.1 * len(channels))
        grid = drawing.subplots(len(channels), len(columns), sharey="row", sharex="col", squeeze=False)
        for row, channel in zip(grid, channels, strict=True):
            for panel, x in zip(row, columns.values(), strict=True):
                _plot_residuals(panel, case_fit, row_layout, channel, x)
            row[0].set_ylabel(f"{channel}: measured − model [{DISPLAY_UNIT[channel]}]")
        for panel, label in zip(grid[-1], columns, strict=True):
            panel.set_xlabel(label)
        titles = [format_outliers(case_fit, channel) for channel in channels]
        titles = [wrap_title(text, 52) for text in titles] if narrow else titles
        drawing.suptitle("\n".join(titles), x=0.01, ha="left")
        is_known = all(case_fit.noise[channel].is_known for channel in channels)
        noise_name = "noise" if is_known else "noise (of the residual if no noise is stated)"
        band = create_mark(f"± 2 sd of {noise_name}", marker="s", ms=7, alpha=0.3)
        add_key(drawing, list(grid.flat), row_layout, create_mark("measured − model", marker="o", ms=3), band)
    return drawing


def _compute_residual(case_fit: CaseFit, channel: str) -> np.ndarray:
    """Return measured − model in the display unit, (n,)."""
    prediction = _blank_meaningless_rows(case_fit.case, channel, case_fit.prediction)
    misfit = getattr(case_fit.case.recording, channel) - prediction
    return np.where(case_fit.case.recording.usable, misfit, np.nan) / compute_si_factor(DISPLAY_UNIT[channel])


def _plot_residuals(panel: Axes, case_fit: CaseFit, row_layout: Layout, channel: str, x: np.ndarray) -> None:
    misfit, sd = (
        _compute_residual(case_fit, channel),
        case_fit.noise[channel].sd / compute_si_factor(DISPLAY_UNIT[channel]),
    )
    panel.axhspan(-2 * sd, 2 * sd, color=REFERENCE_COLOUR, alpha=0.3, lw=0, gid="noise")
    panel.axhline(0, color=REFERENCE_COLOUR, lw=0.6)
    drawn_rows = thin_points(x, np.where(row_layout.group >= 0, misfit, np.nan))
    style = _choose_point_style(np.isfinite(misfit))
    for group, colour in enumerate(row_layout.colours):
        rows = drawn_rows[row_layout.group[drawn_rows] == group]
        panel.plot(x[rows], misfit[rows], color=colour, gid=f"residual group-{group}", **style)


def format_outliers(case_fit: CaseFit, channel: str) -> str:
    """Return the title: the share of rows beyond noise, or the largest residual without stated noise."""
    noise, misfit = case_fit.noise[channel], np.abs(_compute_residual(case_fit, channel))
    if not noise.is_known:
        row = int(np.nanargmax(misfit))
        pressure, length = case_fit.case.recording.pressure[row], case_fit.case.recording.length[row]
        place = f"{format_quantity(pressure, 'kPa', 3)} and {format_quantity(length, 'mm')}"
        return (
            f"{channel.capitalize()}: largest residual {misfit[row]:.3g} {DISPLAY_UNIT[channel]}, at {place}"
        )
    percent_outside = 100 * np.mean(
        misfit[np.isfinite(misfit)] > 2 * noise.sd / compute_si_factor(DISPLAY_UNIT[channel])
    )
    return (
        f"{channel.capitalize()}: {percent_outside:.0f} % of rows are outside ± 2 sd of the noise"
        f" (expected: 5 %)"
    )


def plot_held_out(case_fit: CaseFit, narrow: bool = False) -> Figure:
    """Return the misfit of every block, in the fit that includes it and in the fit without it.

    Raises:
        BadInput: if no block was held out.
    """
    if case_fit.held_out_score is None:
        raise BadInput.from_rule(
            "this figure needs held-out blocks",
            "one block",
            case_fit.case.name,
            "Record at another pressure or length.",
        )
    channels = list(case_fit.held_out_score.rmse)
    block_names = _order_blocks(case_fit)
    with apply_theme():
        height = 1.4 + 0.16 * min(max(len(block_names), 6), _MAX_NAMED_BLOCKS)
        drawing, panels = create_panels(len(channels), narrow, height, sharey=True)
        for panel, channel in zip(panels, channels, strict=True):
            _plot_blocks(panel, case_fit, channel, block_names)
        label_step = math.ceil(len(block_names) / _MAX_NAMED_BLOCKS)
        panels[0].set_yticks(range(0, len(block_names), label_step), block_names[::label_step])
        panels[0].invert_yaxis()
        is_known = [case_fit.noise[channel].is_known for channel in channels]
        noise_marks = [create_mark("noise" if all(is_known) else "noise of the residual", ls="--")]
        fitted_mark = create_mark("included in the fit", marker="o", color=OKABE_ITO["blue"])
        held_out_mark = create_mark("held out", marker="D", color=OKABE_ITO["vermilion"], mfc="none")
        drawing.legend(
            handles=[fitted_mark, held_out_mark, *noise_marks], loc="outside lower center", ncols=3
        )
    return drawing


def _order_blocks(case_fit: CaseFit) -> list[str]:
    """Return the blocks with a measured row, sorted by level if they have one, else by time."""
    assert case_fit.held_out_score is not None
    recording, label = case_fit.case.recording, np.array(case_fit.block)
    is_measured = np.isfinite(recording.force) | np.isfinite(recording.diameter)
    names = [name for name in dict.fromkeys(case_fit.block) if name and is_measured[label == name].any()]
    channel = {"isobars": recording.pressure, "lengths": recording.length}.get(case_fit.held_out_score.kind)
    if channel is None:
        return names
    return sorted(names, key=lambda name: float(np.median(channel[label == name])))


def _plot_blocks(panel: Axes, case_fit: CaseFit, channel: str, block_names: list[str]) -> None:
    scale = compute_si_factor(DISPLAY_UNIT[channel])
    label = np.array(case_fit.block)
    rmse = {}
    for kind, prediction in (("fitted", case_fit.prediction), ("held-out", case_fit.held_out_prediction)):
        predicted_values = _blank_meaningless_rows(case_fit.case, channel, prediction)
        misfit = getattr(case_fit.case.recording, channel) - predicted_values
        rmse[kind] = np.array([compute_rms(misfit[label == name]) / scale for name in block_names])
    y = np.arange(len(block_names))
    panel.hlines(y, rmse["fitted"], rmse["held-out"], color=REFERENCE_COLOUR, lw=0.8)
    panel.plot(rmse["fitted"], y, "o", color=OKABE_ITO["blue"], gid="fitted")
    panel.plot(rmse["held-out"], y, "D", color=OKABE_ITO["vermilion"], mfc="none", ms=5.5, gid="held-out")
    panel.axvline(case_fit.noise[channel].sd / scale, color=REFERENCE_COLOUR, ls="--", lw=0.8, gid="noise")
    # Leave room for half a marker at the upper limit.
    max_rmse = np.nanmax([*rmse["fitted"], *rmse["held-out"], case_fit.noise[channel].sd / scale])
    panel.set_xlim(0, 1.08 * max_rmse)
    panel.set(
        xlabel=f"RMS error of {channel} [{DISPLAY_UNIT[channel]}]",
        title=_format_generalisation(case_fit, channel),
    )


def _format_generalisation(case_fit: CaseFit, channel: str) -> str:
    """Return the title: the held-out error of a channel relative to its error in the fit."""
    assert case_fit.held_out_score is not None
    fitted_rmse, held_out_rmse = case_fit.rmse[channel], case_fit.held_out_score.rmse[channel]
    head = (
        f"Held-out {case_fit.held_out_score.kind}: RMS error of {channel}"
        f" {format_channel_value(held_out_rmse, channel)},\n"
    )
    percent_more = 100 * (held_out_rmse / fitted_rmse - 1) if fitted_rmse > 0 else math.inf
    if abs(percent_more) < 0.5:
        return f"{head}as in the fit"
    if percent_more > _MAX_PERCENT_MORE:
        ratio = held_out_rmse / fitted_rmse
        return f"{head}{ratio:.3g} times that of the fit ({format_channel_value(fitted_rmse, channel)})"
    return (
        f"{head}{abs(percent_more):.0f} % {'more' if percent_more > 0 else 'less'} than in the fit"
        f" ({format_channel_value(fitted_rmse, channel)})"
    )


def list_figure_names(cases: Sequence[str]) -> list[str]:
    """Return the names of the files that `save_fit_figures` can write.

    Args:
        cases: names of the cases.
    """
    prefixes = [""] if len(cases) == 1 else [f"{case}-" for case in cases]
    kinds = ("prediction", "residual", "held-out")
    return ["prior.png", *(f"{prefix}{kind}.png" for prefix in prefixes for kind in kinds)]


def save_fit_figures(fit: Fit, folder: Path) -> list[Path]:
    """Write every figure of a fit as PNG.

    Returns:
        paths of the PNG files, the prior first. With several cases, names begin with the case's name.
    """
    prior_drawing = plot_prior(fit)
    if prior_drawing is None:
        # Remove a figure of an earlier fit in this folder.
        (folder / "prior.png").unlink(missing_ok=True)
    paths = [save_png(prior_drawing, folder / "prior")] if prior_drawing is not None else []
    for case_fit in fit.cases:
        prefix = "" if len(fit.cases) == 1 else f"{case_fit.case.name}-"
        paths.append(save_png(plot_prediction(case_fit), folder / f"{prefix}prediction"))
        paths.append(save_png(plot_residual(case_fit), folder / f"{prefix}residual"))
        if case_fit.held_out_score is not None:
            paths.append(save_png(plot_held_out(case_fit), folder / f"{prefix}held-out"))
    return paths
