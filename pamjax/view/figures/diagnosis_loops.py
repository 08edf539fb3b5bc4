"""Loop figures of a diagnosis: measured and predicted loops, residuals and contribution of mechanisms."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT, format_channel_value, to_display
from pamjax.diagnosis.form_errors.prediction import ModelPrediction
from pamjax.diagnosis.result import Diagnosis
from pamjax.infer.problem.rms import compute_rms
from pamjax.text import join_words
from pamjax.view.figures.layout import (
    Layout,
    add_key,
    build_layout,
    create_band_mark,
    create_mark,
    create_model_mark,
    draw_band,
    fill_band,
    iterate_lines,
    tint_colour,
)
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

#: Largest number of groups with a loop, and of measured points in each loop.
_MAX_LOOPS, _MAX_LOOP_POINTS = 4, 120


def plot_loops(diagnosis: Diagnosis, narrow: bool = False) -> Figure:
    """Return measured and predicted loops of a few groups, without and with the identified mechanisms.

    The prediction with mechanisms includes their estimated form errors. Its band is ± 2 sd of parameters and
    form errors. One group is a held-out one, if there is any. Held-out blocks are predicted by fits without
    them.
    """
    row_layout, channel_index = select_shown_groups(diagnosis), find_main_channel(diagnosis)
    channel = diagnosis.problem.channels[channel_index]
    predictions = [("baseline", diagnosis.held_out_errors.baseline_prediction)]
    form = diagnosis.form_prediction
    if diagnosis.named_mechanisms:
        label = f"with {', '.join(name.id for name in diagnosis.named_mechanisms)}"
        label += " and form error" if form is not None else ""
        predictions.append((label, diagnosis.held_out_errors.model_prediction))
    is_stacked = narrow and len(predictions) > 1
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 5.6 if is_stacked else 3.4)
        shape = (len(predictions), 1) if narrow else (1, len(predictions))
        panels = list(drawing.subplots(*shape, sharex=True, sharey=True, squeeze=False).flat)
        for panel, (label, prediction) in zip(panels, predictions, strict=True):
            if form is not None and prediction is predictions[-1][1]:
                _plot_band(panel, diagnosis, form, row_layout, channel_index)
            _plot_loops(panel, diagnosis, row_layout, channel_index, prediction[channel_index])
            error = _format_error(diagnosis, channel_index, prediction)
            title = f"{label[0].upper()}{label[1:]}: {error}"
            panel.set(
                xlabel=row_layout.xlabel,
                ylabel=f"{channel} [{DISPLAY_UNIT[channel]}]",
            )
            panel.set_title(wrap_title(title, 46))
            panel.label_outer()
        add_key(
            drawing,
            panels,
            row_layout,
            create_mark("measured", marker="o", ms=3),
            create_model_mark("predicted", row_layout),
            *([create_band_mark("the prediction", {channel: form.sd[channel_index]})] if form else []),
        )
    return drawing


def _format_error(diagnosis: Diagnosis, channel_index: int, prediction: np.ndarray) -> str:
    """Return the RMS error of held-out blocks, as in the summary; without them, that of all rows."""
    errors, channel = diagnosis.held_out_errors, diagnosis.problem.channels[channel_index]
    if channel in errors.baseline_rmse:
        is_baseline = prediction is errors.baseline_prediction
        rmse = (errors.baseline_rmse if is_baseline else errors.model_rmse)[channel]
        return f"held-out RMS error of {channel} {format_channel_value(rmse, channel)}"
    rmse = compute_rms(diagnosis.problem.measured[channel_index] - prediction[channel_index])
    return f"RMS error of {channel} {format_channel_value(rmse, channel)}"


def _plot_band(
    panel: Panel, diagnosis: Diagnosis, form: ModelPrediction, row_layout: Layout, channel_index: int
) -> None:
    """Draw ± 2 sd around the prediction of each group."""
    channel = diagnosis.problem.channels[channel_index]
    low, high = (
        to_display(channel, form.values[channel_index] + sign * 2 * form.sd[channel_index])
        for sign in (-1, 1)
    )
    measured_rows = np.isfinite(diagnosis.problem.measured[channel_index])
    for group in range(len(row_layout.names)):
        draw_band(panel, diagnosis.problem.case, row_layout, group, measured_rows, low, high)


def select_shown_groups(diagnosis: Diagnosis) -> Layout:
    """Return the layout of a few groups of rows: the outer ones, some between, and a held-out one."""
    full_layout = build_layout(diagnosis.problem.case)
    group_count = len(full_layout.names)
    if group_count <= _MAX_LOOPS:
        return full_layout
    chosen_groups = np.unique(np.linspace(0, group_count - 1, _MAX_LOOPS).round().astype(int))
    held_out_groups = np.unique(
        full_layout.group[diagnosis.held_out_errors.held_out_mask & (full_layout.group >= 0)]
    )
    if held_out_groups.size and not np.isin(held_out_groups, chosen_groups).any():
        inner = chosen_groups[1:-1]
        chosen_groups[1 + np.argmin(np.abs(inner - held_out_groups[0]))] = held_out_groups[0]
    number = np.full(group_count + 1, -1)
    number[chosen_groups] = np.arange(len(chosen_groups))
    return Layout(
        full_layout.x,
        full_layout.xlabel,
        number[full_layout.group],
        tuple(full_layout.names[k] for k in chosen_groups),
        tuple(full_layout.colours[k] for k in chosen_groups),
        tuple(full_layout.isobars[k] for k in chosen_groups) if full_layout.isobars else (),
        full_layout.is_connected,
    )


def _plot_loops(
    panel: Panel, diagnosis: Diagnosis, row_layout: Layout, channel_index: int, prediction: np.ndarray
) -> None:
    channel = diagnosis.problem.channels[channel_index]
    measured_values, predicted_values = (
        to_display(channel, diagnosis.problem.measured[channel_index]),
        to_display(channel, prediction),
    )
    measured_rows = np.isfinite(measured_values)
    for group, colour in enumerate(row_layout.colours):
        rows = np.flatnonzero((row_layout.group == group) & measured_rows)
        rows = rows[:: max(1, math.ceil(rows.size / _MAX_LOOP_POINTS))]
        panel.plot(
            row_layout.x[rows],
            measured_values[rows],
            "o",
            ms=2.6,
            mew=0,
            alpha=0.55,
            color=colour,
            gid=f"measured group-{group}",
        )
        if not row_layout.is_connected:
            panel.plot(
                row_layout.x[rows], predicted_values[rows], "x", color=colour, gid=f"predicted group-{group}"
            )
            continue
        for run in iterate_lines(diagnosis.problem.case, row_layout, group, measured_rows):
            panel.plot(
                row_layout.x[run],
                predicted_values[run],
                color=colour,
                lw=1.0,
                zorder=3,
                gid=f"predicted group-{group}",
            )


def plot_explained_residuals(diagnosis: Diagnosis, narrow: bool = False) -> Figure | None:
    """Return residuals and the mechanisms' contribution, a panel per group; None without a mechanism."""
    if not diagnosis.named_mechanisms:
        return None
    row_layout, channel_index = select_shown_groups(diagnosis), find_main_channel(diagnosis)
    channel = diagnosis.problem.channels[channel_index]
    residual = to_display(
        channel,
        diagnosis.problem.measured[channel_index]
        - diagnosis.held_out_errors.baseline_prediction[channel_index],
    )
    correction = to_display(
        channel,
        diagnosis.held_out_errors.equation_prediction[channel_index]
        - diagnosis.held_out_errors.baseline_prediction[channel_index],
    )
    contributions = [("contribution", correction, np.zeros_like(correction), OKABE_ITO["blue"])]
    if diagnosis.form_prediction is not None:
        form = diagnosis.form_prediction
        with_form, sd = (
            to_display(channel, values[channel_index])
            for values in (form.values - diagnosis.held_out_errors.baseline_prediction, form.sd)
        )
        contributions.append(("form-error", with_form, sd, OKABE_ITO["orange"]))
    group_count = len(row_layout.names)
    columns = min(2, group_count) if narrow else group_count
    with apply_theme():
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 1.4 + 1.5 * math.ceil(group_count / columns)
        )
        grid = drawing.subplots(-(-group_count // columns), columns, sharex=True, sharey=True, squeeze=False)
        for k, panel in enumerate(grid.flat):
            if k >= group_count:
                panel.set_visible(False)
                continue
            panel.axhline(0, color=REFERENCE_COLOUR, lw=0.6)
            rows = np.flatnonzero((row_layout.group == k) & np.isfinite(residual))
            rows = rows[:: max(1, math.ceil(rows.size / _MAX_LOOP_POINTS))]
            panel.plot(
                row_layout.x[rows],
                residual[rows],
                "o",
                ms=2.6,
                mew=0,
                alpha=0.55,
                color=REFERENCE_COLOUR,
                gid="residual",
            )
            for run in iterate_lines(diagnosis.problem.case, row_layout, k, np.isfinite(residual)):
                for gid, contribution, sd, colour in contributions:
                    line, margin, x = contribution[run], 2 * sd[run], row_layout.x[run]
                    if sd[run].any():
                        low, high = line - margin, line + margin
                        style = {"color": tint_colour(colour), "zorder": 0.5, "gid": f"{gid}-band"}
                        fill_band(panel, x, low, high, **style)
                    panel.plot(x, line, color=colour, lw=1.2, zorder=3, gid=gid)
            panel.set(
                xlabel=row_layout.xlabel,
                ylabel=f"{channel} − baseline [{DISPLAY_UNIT[channel]}]",
                title=row_layout.names[k],
            )
            panel.label_outer()
        drawing.suptitle(
            wrap_title(_format_explained_fraction(diagnosis, residual, correction), 48 if narrow else 104),
            x=0.01,
            ha="left",
        )
        handles = [
            create_mark("residual of the baseline", marker="o", ms=3),
            create_mark("contribution of the mechanisms", ls="-", color=OKABE_ITO["blue"]),
        ]
        if len(contributions) > 1:
            handles.append(create_mark("with form error (band: ± 2 sd)", ls="-", color=OKABE_ITO["orange"]))
        drawing.legend(handles=handles, loc="outside lower center", ncols=1 if narrow else len(handles))
    return drawing


def _format_explained_fraction(diagnosis: Diagnosis, residual: np.ndarray, correction: np.ndarray) -> str:
    """Return the title: the fraction of the squared residuals that the mechanisms explain."""
    explained_fraction = 1 - np.nanmean((residual - correction) ** 2) / np.nanmean(residual**2)
    names = join_words([mechanism.id for mechanism in diagnosis.named_mechanisms])
    verb = "explains" if len(diagnosis.named_mechanisms) == 1 else "explain"
    percent = f"{100 * max(explained_fraction, 0.0):.0f} %"
    return f"{names} {verb} {percent} of the squared residuals of the baseline"
