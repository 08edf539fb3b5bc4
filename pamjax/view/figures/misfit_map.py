"""Map of a misfit: where a recording deviates from the baseline model, and frames of the misfit's regions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pamjax.diagnosis.detect.locate import MisfitRegion
from pamjax.diagnosis.detect.recording_axes import LENGTHENING, SHORTENING, STILL, RecordingAxes, build_axes
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.result import Diagnosis
from pamjax.records.levels import assign_levels, find_levels
from pamjax.view.theme import DOUBLE_COLUMN, SINGLE_COLUMN, apply_theme, create_figure
from pamjax.view.wording import wrap_title

#: Number of cells along an axis without levels, and largest number of levels with a cell each.
_AXIS_CELLS, _MAX_LEVEL_CELLS = 18, 24
#: Smallest share of rows at levels for which the cells are the levels.
_MIN_ROW_SHARE_ON_LEVELS = 0.8
#: Smallest share of moving rows for which each direction has a panel.
_MIN_MOVING_SHARE = 0.5
#: Smallest range of an axis that is drawn, in its display unit.
_MIN_AXIS_RANGE = {"contraction [%]": 0.2, "pressure [kPa]": 1.0, "time [s]": 0.0, "row": 0.0}
#: Quantile of the cells' absolute values at the end of the colour scale; larger values are clipped.
_COLOUR_QUANTILE = 0.98


#: Smallest share of the squared misfit beyond noise that the means of the cells must have to be drawn.
_MIN_SHARE_OF_MEANS = 0.5


@dataclass(frozen=True, eq=False)
class MapAxis:
    """One axis of the map.

    Attributes:
        label: with display unit.
        field: attribute of a region that has the region's limits on this axis.
        scale: factor from SI to the display unit.
        values: (n,) of the rows, in the display unit.
        edges: (cells + 1,) edges of the cells, in the display unit.
    """

    label: str
    field: str
    scale: float
    values: np.ndarray
    edges: np.ndarray

    def find_region_limits(self, region: MisfitRegion) -> tuple[float, float]:
        """Return the limits of a region on this axis, at least one cell wide."""
        low, high = (self.scale * x for x in getattr(region, self.field))
        first, last = np.clip(np.searchsorted(self.edges, [low, high], "right"), 1, len(self.edges) - 1)
        return float(self.edges[first - 1]), float(self.edges[last])


def _compute_standard_residual(diagnosis: Diagnosis) -> np.ndarray:
    """Return measured − baseline in standard deviations of the noise, (2, n); NaN without a measurement.

    The noise is that of the result: an unstated noise that is estimated with the baseline contains misfit.
    """
    problem = diagnosis.problem
    misfit = problem.measured - problem.predict(diagnosis.baseline.estimate.values)
    sd = [
        np.full(problem.n, np.nan) if channel_noise is None else channel_noise.sd
        for channel_noise in diagnosis.model.noise.by_channel
    ]
    return misfit / np.stack(sd)


def find_main_channel(diagnosis: Diagnosis) -> int:
    """Return the channel of the first region, else the channel with the largest misfit."""
    if diagnosis.is_detected and diagnosis.misfit_regions:
        return diagnosis.problem.channels.index(diagnosis.misfit_regions[0].channel)
    square = _compute_standard_residual(diagnosis) ** 2
    mean_squares = [
        np.nanmean(channel_square) if np.isfinite(channel_square).any() else -1.0 for channel_square in square
    ]
    return int(np.argmax(mean_squares))


def list_other_channels(diagnosis: Diagnosis) -> list[int]:
    """Return the channels with a region, except the main channel."""
    channels = diagnosis.problem.channels
    located_channels = (
        {channels.index(region.channel) for region in diagnosis.misfit_regions}
        if diagnosis.is_detected
        else set()
    )
    return sorted(located_channels - {find_main_channel(diagnosis)})


def plot_map(diagnosis: Diagnosis, channel: int | None = None, narrow: bool = False) -> Figure:
    """Return the map of measured − baseline in noise sd over pressure and contraction.

    A cell has the mean of its rows. If positive and negative deviations cancel in the cells, it has their
    root mean square instead.

    Args:
        diagnosis: the diagnosis.
        channel: 0 force, 1 diameter; the main channel if omitted.
        narrow: draw for a column or a phone, with stacked panels.
    """
    channel_index = find_main_channel(diagnosis) if channel is None else channel
    map_cells = _build_cells(diagnosis, channel_index)
    x, y, panel_parts, cells = map_cells.x, map_cells.y, map_cells.panel_parts, map_cells.values
    shows_rms = map_cells.shows_rms
    regions = [
        (number, region)
        for number, region in enumerate(diagnosis.misfit_regions, 1)
        if diagnosis.is_detected and region.channel == diagnosis.problem.channels[channel_index]
    ]
    colour_limit = max(2.0, float(np.nanquantile(np.abs(np.stack(cells)), _COLOUR_QUANTILE)))
    is_stacked = narrow and len(panel_parts) > 1
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 5.4 if is_stacked else 3.1)
        shape = (len(panel_parts), 1) if narrow else (1, len(panel_parts))
        panels = list(drawing.subplots(*shape, sharex=True, sharey=True, squeeze=False).flat)
        mesh = None
        for panel, (name, motions, _), values in zip(panels, panel_parts, cells, strict=True):
            mesh = _plot_cells(panel, x, y, values, (0.0 if shows_rms else -colour_limit, colour_limit))
            for number, region in regions:
                if region.motion in motions:
                    _plot_region(panel, number, x.find_region_limits(region), y.find_region_limits(region))
            panel.set(title=name, xlabel=x.label, ylabel=y.label)
            panel.label_outer()
        assert mesh is not None
        bar_position = (
            {"location": "bottom", "aspect": 35, "shrink": 0.8} if is_stacked else {"aspect": 25, "pad": 0.02}
        )
        bar = drawing.colorbar(mesh, ax=panels, **bar_position)
        statistic = "rms of measured" if shows_rms else "measured"
        bar.set_label(f"{diagnosis.problem.channels[channel_index]}: {statistic} − baseline [noise sd]")
        bar.outline.set_visible(False)
        drawing.suptitle(
            wrap_title(
                _format_location(diagnosis, diagnosis.problem.channels[channel_index]), 48 if narrow else 104
            ),
            x=0.01,
            ha="left",
        )
    return drawing


def _format_location(diagnosis: Diagnosis, channel: str) -> str:
    """Return the location of a channel's misfit in one sentence."""
    if not diagnosis.is_detected:
        return "No part of the recording differs from the baseline by more than the noise explains"
    sentences = [region.description for region in diagnosis.misfit_regions if region.channel == channel]
    return (
        sentences[0].rstrip(".")
        if sentences
        else f"The misfit of {channel} exceeds the noise, but has no distinct region"
    )


def _list_motions(
    coordinates: RecordingAxes, is_measured: np.ndarray
) -> Iterator[tuple[str, tuple[str, ...], np.ndarray]]:
    """Yield the title, the motions of regions and the (n,) mask of rows of each panel."""
    if np.mean(coordinates.motion[is_measured] != STILL) < _MIN_MOVING_SHARE:
        yield "", ("both", "shortening", "lengthening"), is_measured
        return
    for name, motion in (("shortening", SHORTENING), ("lengthening", LENGTHENING)):
        yield f"while {name}", ("both", name), is_measured & (coordinates.motion == motion)


def _select_axes(problem: LibraryProblem, coordinates: RecordingAxes) -> tuple[MapAxis, MapAxis]:
    """Return the first two of contraction, pressure and time that vary, x first."""
    time_label = "time [s]" if problem.case.recording.has_time else "row"
    rest_length = problem.case.muscle_toml.rest_length.value
    # Combine all rows of a length level in one cell, because length noise is not a stroke.
    contractions = 100 * (1 - find_levels(problem.case.recording.length)[::-1] / rest_length)
    all_axes = [
        _build_axis("contraction [%]", "contraction", 100.0, coordinates.contraction, contractions),
        _build_axis(
            "pressure [kPa]", "pressure", 1e-3, coordinates.pressure, find_levels(coordinates.pressure) / 1e3
        ),
        _build_axis(time_label, "time", 1.0, coordinates.time, np.zeros(0)),
    ]
    varying = [
        axis
        for axis in all_axes
        if np.nanmax(axis.values) - np.nanmin(axis.values) > _MIN_AXIS_RANGE[axis.label]
    ]
    first, second = (varying + [axis for axis in all_axes if axis not in varying])[:2]
    return (second, first) if first.field == "pressure" else (first, second)


def _build_axis(label: str, field: str, scale: float, values: np.ndarray, levels: np.ndarray) -> MapAxis:
    values = scale * values
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if (
        1 < len(levels) <= _MAX_LEVEL_CELLS
        and np.mean(assign_levels(values, levels) >= 0) > _MIN_ROW_SHARE_ON_LEVELS
    ):
        middle = (levels[1:] + levels[:-1]) / 2
        outer_edges = [2 * levels[0] - middle[0], 2 * levels[-1] - middle[-1]]
        return MapAxis(label, field, scale, values, np.array([outer_edges[0], *middle, outer_edges[1]]))
    if not high > low:
        low, high = low - 0.5, high + 0.5
    return MapAxis(label, field, scale, values, np.linspace(low, high, _AXIS_CELLS + 1))


def _compute_cell_means(x: MapAxis, y: MapAxis, residual: np.ndarray) -> np.ndarray:
    """Return the mean residual of each cell, (cells of y, cells of x); NaN in empty cells."""
    count = _count_cell_rows(x, y, residual)
    total = _sum_over_cells(x, y, residual, residual)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _count_cell_rows(x: MapAxis, y: MapAxis, residual: np.ndarray) -> np.ndarray:
    """Return the number of rows with a residual in each cell, (cells of y, cells of x)."""
    return _sum_over_cells(x, y, residual, np.ones_like(residual))


def _sum_over_cells(x: MapAxis, y: MapAxis, residual: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the sum of values over the rows with a residual in each cell, (cells of y, cells of x)."""
    finite_rows = np.isfinite(residual) & np.isfinite(x.values) & np.isfinite(y.values)
    shape = (len(y.edges) - 1, len(x.edges) - 1)
    row, column = (
        np.clip(np.searchsorted(axis.edges, axis.values[finite_rows], "right") - 1, 0, len(axis.edges) - 2)
        for axis in (y, x)
    )
    flat = row * shape[1] + column
    return np.bincount(flat, values[finite_rows], minlength=shape[0] * shape[1]).reshape(shape)


@dataclass(frozen=True, eq=False)
class _MapCells:
    """Cells of a map.

    Attributes:
        x, y: the axes.
        panel_parts: title, motions of regions, and (n,) mask of rows of each panel.
        values: (cells of y, cells of x) of each panel, in noise sd; NaN in empty cells.
        shows_rms: whether the values are the rms of the rows in a cell instead of their mean.
    """

    x: MapAxis
    y: MapAxis
    panel_parts: list[tuple[str, tuple[str, ...], np.ndarray]]
    values: list[np.ndarray]
    shows_rms: bool


def _build_cells(diagnosis: Diagnosis, channel_index: int) -> _MapCells:
    """Return the cells of the map of a channel."""
    coordinates = build_axes(diagnosis.problem)
    residual = _compute_standard_residual(diagnosis)[channel_index]
    x, y = _select_axes(diagnosis.problem, coordinates)
    panel_parts = list(_list_motions(coordinates, np.isfinite(residual)))
    parts = [np.where(rows, residual, np.nan) for _, _, rows in panel_parts]
    shows_rms = diagnosis.is_detected and _cancels_in_cells(x, y, parts)
    values = [
        np.sqrt(_compute_cell_means(x, y, part**2)) if shows_rms else _compute_cell_means(x, y, part)
        for part in parts
    ]
    return _MapCells(x, y, panel_parts, values, shows_rms)


def format_map_caption(diagnosis: Diagnosis) -> str:
    """Return the sentences below the map of the main channel: what the colours of its cells are."""
    statistic, reason = "Mean", ""
    if _build_cells(diagnosis, find_main_channel(diagnosis)).shows_rms:
        statistic = "Root mean square"
        reason = " A mean would be near zero, because positive and negative deviations are in the same cells."
    frames = (
        " Frames show the regions of the misfit."
        if diagnosis.is_detected and diagnosis.misfit_regions
        else ""
    )
    return (
        f"{statistic} of measured − baseline in each cell, in standard deviations of the noise.{reason}"
        f" Blank cells have no measurement. Point at a cell to read its value.{frames}"
    )


def _cancels_in_cells(x: MapAxis, y: MapAxis, parts: Sequence[np.ndarray]) -> bool:
    """Return whether the means of the cells lack most of the misfit beyond noise.

    Args:
        x, y: axes of the map.
        parts: (n,) deviation of each panel in noise sd; NaN outside its rows.
    """
    excess_of_means = excess = 0.0
    for part in parts:
        count, mean = _count_cell_rows(x, y, part), _compute_cell_means(x, y, part)
        excess_of_means += float(np.nansum(count * mean**2) - np.sum(count > 0))
        excess += float(np.nansum(part**2) - np.isfinite(part).sum())
    return excess_of_means < _MIN_SHARE_OF_MEANS * excess


def _plot_cells(
    panel: Panel, x: MapAxis, y: MapAxis, values: np.ndarray, limits: tuple[float, float]
) -> QuadMesh:
    """Draw the cells; values without a sign have one hue."""
    colours = matplotlib.colormaps["RdBu_r" if limits[0] < 0 else "Reds"]
    mesh = panel.pcolormesh(x.edges, y.edges, values, cmap=colours, vmin=limits[0], vmax=limits[1])
    mesh.set_gid("misfit")
    return mesh


def _plot_region(panel: Panel, number: int, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Draw a region's frame with its number."""
    frame = Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], fill=False, zorder=4, clip_on=False)
    frame.set(linewidth=1.2, edgecolor="black", linestyle=("-", "--", ":", "-.")[(number - 1) % 4])
    frame.set_gid(f"region-{number}")
    panel.add_patch(frame)
    panel.annotate(
        str(number), (x[0], y[1]), (4 + 11 * (number - 1), -4), textcoords="offset points",
        va="top", fontsize=7, weight="bold", zorder=5,
        bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": "black", "lw": 0.6},
    )  # fmt: skip
