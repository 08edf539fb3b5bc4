"""The map of a mismatch: where a recording departs from its baseline, and the boxes that say so."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pamjax.diagnosis.detect.locate import Box
from pamjax.diagnosis.detect.regions import LENGTHENING, SHORTENING, STILL, Axes, axes
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model
from pamjax.diagnosis.result import Diagnosis
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.levels import find_levels, on_levels
from pamjax.view.theme import DOUBLE, SINGLE, figure, theme

#: Cells along an axis that has no settings, and most settings that each get a cell of their own.
CELLS, SETTINGS = 18, 24
#: Share of the rows on settings from which an axis is cut at them.
ON = 0.8
#: Share of the moving rows from which the two directions are drawn apart.
MOVING = 0.5
#: An axis is drawn where it spans more than this, in its shown unit.
LEAST = {"contraction [%]": 0.2, "pressure [kPa]": 1.0, "time [s]": 0.0, "row": 0.0}
#: Colours run to this quantile of the cells' size, so that one wild cell does not pale all others.
REACH = 0.98


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of the map: its label, the rows' values, a box's limits' scale, and where cells end."""

    label: str
    field: str
    scale: float
    values: np.ndarray
    edges: np.ndarray

    def limits(self, box: Box) -> tuple[float, float]:
        """From where to where a box reaches, at least a cell."""
        low, high = (self.scale * x for x in getattr(box, self.field))
        first, last = np.clip(np.searchsorted(self.edges, [low, high], "right"), 1, len(self.edges) - 1)
        return float(self.edges[first - 1]), float(self.edges[last])


def standard_residual(found: Problem, model: Model) -> np.ndarray:
    """Measured − model in noise standard deviations, (2, n); NaN where nothing was measured."""
    misfit = found.measured - found.shows(model.at.values)
    sd = [np.full(found.n, np.nan) if colour is None else colour.sd for colour in model.white.colours]
    return misfit / np.stack(sd)


def main_channel(one: Diagnosis) -> int:
    """The channel that the first box speaks of, else the one that is missed by most."""
    if one.detected and one.where:
        return CHANNELS.index(one.where[0].channel)
    square = standard_residual(one.found, one.baseline) ** 2
    means = [np.nanmean(s) if np.isfinite(s).any() else -1.0 for s in square]
    return int(np.argmax(means))


def other_channels(one: Diagnosis) -> list[int]:
    """The channels but the main one that a box speaks of."""
    spoken = {CHANNELS.index(box.channel) for box in one.where} if one.detected else set()
    return sorted(spoken - {main_channel(one)})


def map_figure(one: Diagnosis, channel: int | None = None, narrow: bool = False) -> Figure:
    """Where the baseline is wrong: measured − baseline in noise sd over pressure and contraction.

    Args:
        one: the diagnosis.
        channel: 0 force, 1 diameter; the one with the largest share if left out.
        narrow: for a column or a phone, with the panels below each other.
    """
    at, c = axes(one.found), main_channel(one) if channel is None else channel
    residual = standard_residual(one.found, one.baseline)[c]
    x, y = _two_axes(one.found, at)
    sides = list(_sides(at, np.isfinite(residual)))
    boxes = [(k, box) for k, box in enumerate(one.where, 1) if one.detected and box.channel == CHANNELS[c]]
    cells = [_means(x, y, np.where(rows, residual, np.nan)) for _, _, rows in sides]
    reach = max(2.0, float(np.nanquantile(np.abs(np.stack(cells)), REACH)))
    down = narrow and len(sides) > 1
    with theme():
        made = figure(SINGLE if narrow else DOUBLE, 5.4 if down else 3.1)
        shape = (len(sides), 1) if narrow else (1, len(sides))
        panels = list(made.subplots(*shape, sharex=True, sharey=True, squeeze=False).flat)
        mesh = None
        for panel, (name, directions, _), mean in zip(panels, sides, cells, strict=True):
            mesh = _cells(panel, x, y, mean, reach)
            for k, box in boxes:
                if box.direction in directions:
                    _outline(panel, k, x.limits(box), y.limits(box))
            panel.set(title=name, xlabel=x.label, ylabel=y.label)
            panel.label_outer()
        assert mesh is not None
        where = {"location": "bottom", "aspect": 35, "shrink": 0.8} if down else {"aspect": 25, "pad": 0.02}
        bar = made.colorbar(mesh, ax=panels, **where)
        bar.set_label(f"{CHANNELS[c]}: measured − baseline [noise sd]")
        bar.outline.set_visible(False)
        made.suptitle(textwrap.fill(finding(one, CHANNELS[c]), 48 if narrow else 104), x=0.01, ha="left")
    return made


def finding(one: Diagnosis, channel: str) -> str:
    """Where the mismatch of a channel is, in one sentence."""
    if not one.detected:
        return "No part of the recording departs from the baseline by more than its noise explains"
    says = [box.says for box in one.where if box.channel == channel]
    return says[0].rstrip(".") if says else f"The {channel} is missed by more than noise, in no one place"


def _sides(at: Axes, measured: np.ndarray) -> Iterator[tuple[str, tuple[str, ...], np.ndarray]]:
    """Title, the directions of boxes that belong there, and the rows, of each panel."""
    if np.mean(at.direction[measured] != STILL) < MOVING:
        yield "", ("both", "shortening", "lengthening"), measured
        return
    for name, way in (("shortening", SHORTENING), ("lengthening", LENGTHENING)):
        yield f"while {name}", ("both", name), measured & (at.direction == way)


def _two_axes(found: Problem, at: Axes) -> tuple[Axis, Axis]:
    """The first two of contraction, pressure and time that vary; x first."""
    clock = "time [s]" if found.case.recording.has_time else "row"
    rest = found.case.entry.rest_length.value
    # Noise of a length is not a stroke: a setting's rows share one cell.
    contractions = 100 * (1 - find_levels(found.case.recording.length)[::-1] / rest)
    every = [
        _axis("contraction [%]", "contraction", 100.0, at.contraction, contractions),
        _axis("pressure [kPa]", "pressure", 1e-3, at.pressure, find_levels(at.pressure) / 1e3),
        _axis(clock, "time", 1.0, at.time, np.zeros(0)),
    ]
    varying = [axis for axis in every if np.nanmax(axis.values) - np.nanmin(axis.values) > LEAST[axis.label]]
    first, second = (varying + [axis for axis in every if axis not in varying])[:2]
    return (second, first) if first.field == "pressure" else (first, second)


def _axis(label: str, field: str, scale: float, values: np.ndarray, levels: np.ndarray) -> Axis:
    values = scale * values
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if 1 < len(levels) <= SETTINGS and np.mean(on_levels(values, levels) >= 0) > ON:
        middle = (levels[1:] + levels[:-1]) / 2
        ends = [2 * levels[0] - middle[0], 2 * levels[-1] - middle[-1]]
        return Axis(label, field, scale, values, np.array([ends[0], *middle, ends[1]]))
    if not high > low:
        low, high = low - 0.5, high + 0.5
    return Axis(label, field, scale, values, np.linspace(low, high, CELLS + 1))


def _means(x: Axis, y: Axis, residual: np.ndarray) -> np.ndarray:
    """Mean residual of each cell, NaN in empty ones, (rows of y, columns of x)."""
    there = np.isfinite(residual) & np.isfinite(x.values) & np.isfinite(y.values)
    shape = (len(y.edges) - 1, len(x.edges) - 1)
    row, column = (
        np.clip(np.searchsorted(axis.edges, axis.values[there], "right") - 1, 0, len(axis.edges) - 2)
        for axis in (y, x)
    )
    flat = row * shape[1] + column
    count = np.bincount(flat, minlength=shape[0] * shape[1])
    total = np.bincount(flat, residual[there], minlength=shape[0] * shape[1])
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(shape)


def _cells(panel: Panel, x: Axis, y: Axis, mean: np.ndarray, reach: float) -> QuadMesh:
    colours = matplotlib.colormaps["RdBu_r"]
    mesh = panel.pcolormesh(x.edges, y.edges, mean, cmap=colours, vmin=-reach, vmax=reach)
    mesh.set_gid("mismatch")
    return mesh


def _outline(panel: Panel, number: int, x: tuple[float, float], y: tuple[float, float]) -> None:
    """A box's frame with its number in a corner of its own."""
    frame = Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], fill=False, zorder=4, clip_on=False)
    frame.set(linewidth=1.2, edgecolor="black", linestyle=("-", "--", ":", "-.")[(number - 1) % 4])
    frame.set_gid(f"box-{number}")
    panel.add_patch(frame)
    panel.annotate(
        str(number), (x[0], y[1]), (4 + 11 * (number - 1), -4), textcoords="offset points",
        va="top", fontsize=7, weight="bold", zorder=5,
        bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": "black", "lw": 0.6},
    )  # fmt: skip
