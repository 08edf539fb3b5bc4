"""Figures of a fleet: a ridge of a parameter over specimens, mechanisms by case, and a control chart."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pamjax.fleet.analysis import DAYS_PER_YEAR, FleetAnswers, ParameterDistribution
from pamjax.fleet.fleet import Fleet
from pamjax.fleet.frames import list_rows, select_rows
from pamjax.fleet.frequency import BenchFrequency
from pamjax.fleet.summary import format_distribution, name_distribution, name_frequency
from pamjax.view.figures.layout import create_mark
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
)
from pamjax.view.wording import wrap_title

#: Largest number of specimens in a ridge; of more, the outliers and evenly spaced ranks are drawn.
_MAX_RIDGES = 40
#: Largest number of cases with a column each in the map of mechanisms; of more, benches are drawn.
_MAX_MAP_CASES = 120
#: Largest number of cases with their names in the map.
_MAX_MAP_NAMES = 40
#: Height of one ridge, in distances between two of them.
_RIDGE_HEIGHT = 1.7
#: Largest number of characters of a name.
_MAX_NAME_LENGTH = 22
#: Limits of a control chart, in sd.
_CONTROL_SD = 3.0

_BENCH_COLOURS = ("blue", "orange", "green", "purple", "sky", "black")


def plot_ridge(distribution: ParameterDistribution, narrow: bool = False) -> Figure:
    """Return the estimate of each specimen as a density, sorted, above the distribution over specimens."""
    pooled = distribution.pooled
    shown = select_ridges(pooled.estimate, pooled.outliers)
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 1.2 + 0.16 * len(shown))
        panel = drawing.subplots()
        low = float((pooled.estimate - 3.5 * pooled.sd)[shown].min())
        high = float((pooled.estimate + 3.5 * pooled.sd)[shown].max())
        x = np.linspace(low, high, 300)
        for row, k in enumerate(shown):
            colour = OKABE_ITO["vermilion" if pooled.outliers[k] else "blue"]
            _draw_ridge(panel, x, float(pooled.estimate[k]), float(pooled.sd[k]), row + 1, colour)
        spread = float(np.hypot(pooled.between_sd, pooled.mean_sd))
        _draw_ridge(panel, x, pooled.mean, spread, 0, OKABE_ITO["black"])
        names = ["all specimens", *(_shorten_name(distribution.estimates.names[k]) for k in shown)]
        panel.set_yticks(range(len(names)), names)
        panel.tick_params(axis="y", length=0)
        panel.set_xlabel(_label_axis(distribution))
        panel.spines["left"].set_visible(False)
        panel.set_title(_wrap(format_distribution(distribution), narrow))
    return drawing


def _draw_ridge(panel: Axes, x: np.ndarray, mean: float, sd: float, row: int, colour: str) -> None:
    height = _RIDGE_HEIGHT * np.exp(-0.5 * ((x - mean) / sd) ** 2)
    visible = height > 1e-3
    order = -row  # lower rows are in front
    panel.fill_between(x[visible], row, row + height[visible], color=colour, alpha=0.35, lw=0, zorder=order)
    panel.plot(x[visible], row + height[visible], color=colour, lw=0.8, zorder=order)
    panel.plot([mean, mean], [row, row + 0.5], color=colour, lw=1.2, zorder=order)


def select_ridges(estimate: np.ndarray, outliers: np.ndarray) -> np.ndarray:
    """Return the indices of at most `_MAX_RIDGES` specimens in the order of their estimates."""
    order = np.argsort(estimate, kind="stable")
    if len(order) <= _MAX_RIDGES:
        return order
    wanted = set(np.flatnonzero(outliers)[:_MAX_RIDGES].tolist())
    regular = order[np.linspace(0, len(order) - 1, _MAX_RIDGES).round().astype(int)]
    for k in regular:
        if len(wanted) < _MAX_RIDGES:
            wanted.add(int(k))
    return np.array([k for k in order if int(k) in wanted])


def plot_mechanism_map(fleet: Fleet, answers: FleetAnswers, narrow: bool = False) -> Figure | None:
    """Return the probability of each mechanism in each case, or its frequency by bench in a large fleet."""
    diagnosed = select_rows(fleet.cases, fleet.cases["misfit_p_value"].notna())
    names = list(dict.fromkeys(frequency.id for frequency in answers.mechanisms))
    if diagnosed.empty or not (names or answers.unexplained.count):
        return None
    if len(diagnosed) > _MAX_MAP_CASES:
        return _plot_frequency_map(answers, narrow)
    cases = diagnosed.sort_values(["bench", "date", "case"], na_position="last")
    shares = np.zeros((len(names) + 1, len(cases)))
    columns = {str(case): k for k, case in enumerate(cases["case"])}
    for row in list_rows(fleet.mechanisms):
        if row["case"] in columns:
            shares[names.index(row["id"]), columns[row["case"]]] = row["probability"]
    shares[-1] = cases["unexplained"].fillna(False).astype(float)
    title = "Probability of each mechanism in each recording"
    return _draw_map(shares, [*names, "unexplained"], cases, title, narrow)


def _draw_map(shares: np.ndarray, rows: list[str], cases: pd.DataFrame, title: str, narrow: bool) -> Figure:
    with apply_theme():
        named = len(cases) <= _MAX_MAP_NAMES
        height = 1.3 + 0.2 * len(rows) + (0.7 if named else 0.0)
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, height)
        panel = drawing.subplots()
        picture = panel.pcolormesh(shares, cmap="Blues", vmin=0, vmax=1, edgecolors="lightgrey", lw=0.3)
        panel.set_gid("misfit")
        panel.set_yticks(np.arange(len(rows)) + 0.5, rows)
        panel.invert_yaxis()
        if named:
            labels = [_shorten_name(str(case)) for case in cases["case"]]
            panel.set_xticks(np.arange(len(cases)) + 0.5, labels, rotation=90)
        else:
            panel.set_xlabel(f"{len(cases)} recordings, by rig and date")
            panel.set_xticks([])
        _mark_benches(panel, [None if pd.isna(bench) else str(bench) for bench in cases["bench"]])
        panel.set_title(_wrap(title, narrow), pad=18)
        drawing.colorbar(picture, ax=panel, label="probability", aspect=12, pad=0.02)
    return drawing


def _mark_benches(panel: Axes, benches: list[str | None]) -> None:
    """Write the name of each bench above its columns, with a line between benches."""
    starts = [k for k in range(len(benches)) if k == 0 or benches[k] != benches[k - 1]]
    for start, end in zip(starts, [*starts[1:], len(benches)], strict=True):
        if start:
            panel.axvline(start, color=OKABE_ITO["black"], lw=0.8)
        if benches[start] is not None:
            name = _shorten_name(str(benches[start]))
            panel.annotate(
                name, ((start + end) / 2, 1.0), (0, 3), ("data", "axes fraction"), "offset points",
                ha="center", fontsize=7,
            )  # fmt: skip


def _plot_frequency_map(answers: FleetAnswers, narrow: bool) -> Figure | None:
    """Return the share of recordings with each mechanism on each bench."""
    if not answers.mechanisms:
        return None
    benches = sorted({bench for frequency in answers.mechanisms for bench in frequency.by_bench})
    columns = benches or ["all"]
    shares = np.array([_list_shares(frequency, benches) for frequency in answers.mechanisms])
    table = pd.DataFrame({"case": columns, "bench": [None] * len(columns)})
    title = "Share of the recordings of each rig in which a mechanism is identified"
    return _draw_map(shares, [name_frequency(f) for f in answers.mechanisms], table, title, narrow)


def _list_shares(frequency: BenchFrequency, benches: list[str]) -> list[float]:
    """Return the share of affected recordings on each bench, NaN for a bench without this type."""
    if not benches:
        return [frequency.count / frequency.total]
    counts = [frequency.by_bench.get(bench, (0, 0)) for bench in benches]
    return [count / total if total else float("nan") for count, total in counts]


def plot_control_chart(distribution: ParameterDistribution, narrow: bool = False) -> Figure:
    """Return a number against date or serial number, with its mean and limits of three sd."""
    pooled = distribution.pooled
    x = _locate_specimens(distribution)
    limit = _CONTROL_SD * np.sqrt(pooled.between_sd**2 + pooled.sd**2)
    order = np.argsort(x, kind="stable")
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 2.8)
        panel = drawing.subplots()
        panel.axhline(pooled.mean, color=REFERENCE_COLOUR, lw=0.8)
        for sign in (-1, 1):
            y = pooled.mean + sign * limit[order]
            panel.plot(x[order], y, color=REFERENCE_COLOUR, ls="--", lw=0.8)
        handles = _draw_specimens(panel, distribution, x)
        handles.append(create_mark("mean", ls="-", color=REFERENCE_COLOUR))
        handles.append(create_mark("limits of 3 sd", ls="--", color=REFERENCE_COLOUR))
        outside = int((np.abs(pooled.estimate - pooled.mean) > limit).sum())
        panel.set_xlabel(distribution.order_name or "specimens in the order of their names")
        if distribution.order_name == "date":
            locator = AutoDateLocator(minticks=3, maxticks=7)
            panel.xaxis.set_major_locator(locator)
            panel.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        else:
            panel.xaxis.set_major_locator(MaxNLocator(integer=True))
        panel.set_ylabel(_label_axis(distribution))
        title = f"{outside} of {len(x)} specimens are outside the limits of {name_distribution(distribution)}"
        panel.set_title(_wrap(title, narrow))
        drawing.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else 5)
    return drawing


def _locate_specimens(distribution: ParameterDistribution) -> np.ndarray:
    """Return the position of each specimen on the axis: days, serial number, or its rank by name."""
    if distribution.order is None:
        return np.arange(len(distribution.pooled.estimate), dtype=float)
    return distribution.order * (DAYS_PER_YEAR if distribution.order_name == "date" else 1.0)


def _draw_specimens(panel: Axes, distribution: ParameterDistribution, x: np.ndarray) -> list:
    """Draw the estimates with their sd, a colour for each bench; return the entries of the legend."""
    pooled, benches, handles = distribution.pooled, distribution.estimates.benches, []
    stated = sorted({bench for bench in benches if bench is not None})
    labels = [*stated, *([None] if None in benches else [])]
    is_split = labels != [None] and len(labels) <= len(_BENCH_COLOURS)
    for colour, name in zip(_BENCH_COLOURS, labels if is_split else [None], strict=False):
        members = np.array([not is_split or bench == name for bench in benches])
        style = {"fmt": "o", "ms": 3, "lw": 0.7, "color": OKABE_ITO[colour]}
        panel.errorbar(x[members], pooled.estimate[members], pooled.sd[members], **style)
        text = f"rig {_shorten_name(name)}" if name else "no or several rigs"
        handles.append(create_mark(text if is_split else "specimens", marker="o", color=OKABE_ITO[colour]))
    if pooled.outliers.any():
        style = {"marker": "o", "ms": 8, "mfc": "none", "ls": "", "color": OKABE_ITO["vermilion"]}
        panel.plot(x[pooled.outliers], pooled.estimate[pooled.outliers], **style)
        handles.append(create_mark("outlier", marker="o", mfc="none", color=OKABE_ITO["vermilion"]))
    return handles


def _shorten_name(name: str) -> str:
    """Return the end of a name for an axis."""
    return name if len(name) <= _MAX_NAME_LENGTH else f"…{name[1 - _MAX_NAME_LENGTH :]}"


def _label_axis(distribution: ParameterDistribution) -> str:
    unit = "" if distribution.unit == "1" else f" [{distribution.unit}]"
    return f"{distribution.name}{unit}"


def _wrap(text: str, narrow: bool) -> str:
    return wrap_title(text, 46 if narrow else 100)
