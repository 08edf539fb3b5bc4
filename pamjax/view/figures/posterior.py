"""Figures of the distribution of a posterior.

| figure           | question                                                            |
|------------------|---------------------------------------------------------------------|
| `plot_corner`    | how uncertain are the parameters, and which are correlated?         |
| `plot_ridges`    | which parameters are determined only in combination?                |
| `plot_marginals` | how does the posterior differ from the prior?                       |

`posterior_checks` has the figures of the profile likelihood, the chains and the posterior prediction.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from pamjax.infer.fitting.determination import DETERMINED
from pamjax.infer.posterior.identifiability_report import COMBINATION_KIND
from pamjax.infer.posterior.predictive import sample_prior
from pamjax.infer.posterior.result import Posterior
from pamjax.view.figures.layout import create_mark
from pamjax.view.figures.posterior_axes import (
    POSTERIOR_COLOUR,
    convert_to_unit,
    format_axis_label,
    select_parameters,
)
from pamjax.view.figures.posterior_checks import plot_band, plot_profiles, plot_traces
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
    save_png,
)
from pamjax.view.wording import format_signed, wrap_title

#: Parameters in the corner plot of a phone: the most correlated ones.
MAX_NARROW_PANELS = 4
#: Largest number of letters in a line of a label beside a panel of the corner plot, wide and narrow.
_MAX_LETTERS, _MAX_NARROW_LETTERS = 18, 12
#: Number of draws that are shown as points.
_SHOWN_DRAWS = 2000


def _select_most_correlated(post: Posterior, indices: list[int]) -> list[int]:
    """Return the indices of the most correlated parameters, in their order."""
    correlation = np.abs(post.correlation[np.ix_(indices, indices)])
    np.fill_diagonal(correlation, 0)
    largest_indices = np.argsort(-correlation.max(axis=1), kind="stable")[:MAX_NARROW_PANELS]
    return [indices[k] for k in sorted(largest_indices)]


def plot_corner(post: Posterior, narrow: bool = False) -> Figure:
    """Return every parameter's histogram, and every pair's draws with 39 and 86 % contours.

    A narrow figure has the most correlated parameters only.
    """
    all_indices, draws = select_parameters(post), post.thin_draws(_SHOWN_DRAWS)
    indices = _select_most_correlated(post, all_indices) if narrow else all_indices
    count = len(indices)
    with apply_theme():
        size = SINGLE_COLUMN if narrow else max(1.1 * count + 1, 4.5)
        label_size, letters = (6, _MAX_NARROW_LETTERS) if narrow else (7, _MAX_LETTERS)
        drawing = create_figure(size, size)
        grid = drawing.subplots(count, count, squeeze=False, sharex="col")
        for row, i in enumerate(indices):
            for column, j in enumerate(indices):
                panel = grid[row][column]
                if column > row:
                    panel.set_axis_off()
                    continue
                if row == column:
                    panel.hist(
                        convert_to_unit(post, post.flat, i),
                        40,
                        color=POSTERIOR_COLOUR,
                        alpha=0.7,
                        gid="marginal",
                    )
                    panel.set_yticks([])
                    low, high = np.quantile(convert_to_unit(post, post.flat, i), (0.001, 0.999))
                    panel.set_xlim(low, high)
                else:
                    x, y = convert_to_unit(post, draws, j), convert_to_unit(post, draws, i)
                    panel.plot(
                        x, y, ".", ms=1, alpha=0.25, color=POSTERIOR_COLOUR, rasterized=True, gid="draws"
                    )
                    _plot_ellipses(panel, x, y)
                    panel.set_ylim(*np.quantile(convert_to_unit(post, post.flat, i), (0.001, 0.999)))
                if column == 0 and row:
                    panel.set_ylabel(_format_corner_label(post, i, letters), fontsize=label_size)
                elif column:
                    panel.set_yticklabels([])
                if row == count - 1:
                    panel.set_xlabel(_format_corner_label(post, j, letters), fontsize=label_size)
                panel.tick_params(labelsize=label_size - 1)
                panel.locator_params(nbins=3)
                # An offset such as +2.14e2 would cover the label of the axis.
                for axis in (panel.xaxis, panel.yaxis):
                    formatter = axis.get_major_formatter()
                    if isinstance(formatter, ScalarFormatter):
                        formatter.set_useOffset(False)
                # Horizontal numbers such as 214.05 would overlap.
                panel.tick_params("x", rotation=90 if narrow else 45)
        drawing.align_labels()
        title = _format_strongest_correlation(post, indices)
        if len(indices) < len(all_indices):
            title += f"; {len(indices)} of {len(all_indices)} parameters"
        title = wrap_title(title, 46) if narrow else title
        drawing.suptitle(title, x=0.01, ha="left", fontsize=8 if narrow else None)
    return drawing


def _format_corner_label(post: Posterior, k: int, max_letters: int) -> str:
    """Return the name of a parameter with its unit, in lines that are as long as a panel."""
    lines = [""]
    for word in re.findall(r"[^._\s]+[._]?|\s", format_axis_label(post, k)):
        if word.isspace():
            # The group, the name and the unit of a parameter.
            lines[-1] += "" if word == "\n" else " "
        elif len(lines[-1]) + len(word) <= max_letters and not lines[-1].endswith("."):
            lines[-1] += word
        else:
            lines.append(word)
    return "\n".join(line.strip() for line in lines)


def _plot_ellipses(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw the 1 and 2 sd ellipses of a Gaussian with the draws' covariance, which contain 39 and 86 %."""
    root = np.linalg.cholesky(np.cov(x, y) + 1e-30 * np.eye(2))
    circle = np.linspace(0, 2 * np.pi, 60)
    for sd in (1, 2):
        ellipse = sd * root @ np.stack([np.cos(circle), np.sin(circle)])
        panel.plot(x.mean() + ellipse[0], y.mean() + ellipse[1], color="black", lw=0.6, gid="ellipse")


def _format_strongest_correlation(post: Posterior, indices: list[int]) -> str:
    """Return the title: the most correlated pair of parameters."""
    correlation = np.abs(post.correlation[np.ix_(indices, indices)])
    np.fill_diagonal(correlation, 0)
    if len(indices) < 2:
        return f"Posterior of {post.names[indices[0]]}"
    i, j = np.unravel_index(int(correlation.argmax()), correlation.shape)
    a, b = indices[min(i, j)], indices[max(i, j)]
    value = format_signed(post.correlation[a, b], 2)
    return f"Strongest correlation: {value}, {post.names[a]} and {post.names[b]}"


def find_ridges(post: Posterior) -> list[tuple[int, int]]:
    """Return index pairs of parameters that are determined only in combination, with their partners."""
    correlation = np.abs(post.correlation)
    kind_by_index = {post.names.index(n): v.kind for n, v in post.verdicts.items()}
    undetermined = [k for k, kind in kind_by_index.items() if kind != DETERMINED]
    partners = {
        k: max((j for j in undetermined if j != k), key=lambda j, k=k: correlation[k, j])
        for k in undetermined
        if kind_by_index[k] == COMBINATION_KIND
    }
    return sorted({(min(pair), max(pair)) for pair in partners.items()})


def plot_ridges(post: Posterior, narrow: bool = False) -> Figure:
    """Return prior and posterior draws of each pair that is determined only in combination."""
    pairs = find_ridges(post)
    prior_samples = sample_prior(post.density, _SHOWN_DRAWS, post.seed)
    posterior_samples = post.thin_draws(_SHOWN_DRAWS)
    columns = 1 if narrow else min(2, len(pairs))
    rows = math.ceil(len(pairs) / columns)
    with apply_theme():
        drawing = create_figure(SINGLE_COLUMN if columns == 1 else DOUBLE_COLUMN, 0.7 + 2.4 * rows)
        panels = drawing.subplots(rows, columns, squeeze=False).ravel()
        for panel, (i, j) in zip(panels, pairs, strict=False):
            for draws, colour, name in (
                (prior_samples, REFERENCE_COLOUR, "prior"),
                (posterior_samples, POSTERIOR_COLOUR, "posterior"),
            ):
                x, y = convert_to_unit(post, draws, i), convert_to_unit(post, draws, j)
                panel.plot(x, y, ".", ms=1.5, alpha=0.5, color=colour, rasterized=True, gid=name)
                if name == "prior":
                    panel.set(xlim=np.quantile(x, (0.01, 0.99)), ylim=np.quantile(y, (0.01, 0.99)))
            panel.set_xlabel(format_axis_label(post, i).replace("\n", ""))
            panel.set_ylabel(format_axis_label(post, j).replace("\n", ""))
        for panel in panels[len(pairs) :]:
            panel.set_axis_off()
        i, j = pairs[0]
        title = f"{post.names[i]} and {post.names[j]}\nare determined only in combination"
        drawing.suptitle(title, x=0.01, ha="left")
        marks = [
            create_mark("prior", marker="o", ms=3),
            create_mark("posterior", marker="o", ms=3, color=POSTERIOR_COLOUR),
        ]
        drawing.legend(handles=marks, loc="outside lower center", ncols=2)
    return drawing


def plot_marginals(post: Posterior, narrow: bool = False) -> Figure:
    """Return prior and posterior of each parameter, a panel each."""
    indices = select_parameters(post)
    prior_samples = sample_prior(post.density, 4000, post.seed)
    columns = min(1 if narrow else 3, len(indices))
    with apply_theme():
        rows = math.ceil(len(indices) / columns)
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 0.8 + (1.2 if narrow else 1.5) * rows
        )
        panels = drawing.subplots(rows, columns, squeeze=False).ravel()
        for panel, k in zip(panels, indices, strict=False):
            _plot_marginal(
                panel,
                convert_to_unit(post, prior_samples, k),
                convert_to_unit(post, post.flat, k),
                bool(post.density.space.log_scale[k]),
            )
            panel.set_xlabel(format_axis_label(post, k).replace("\n", ""), fontsize=7)
        for panel in panels[len(indices) :]:
            panel.set_axis_off()
        determined_count = sum(v.kind == DETERMINED for v in post.verdicts.values())
        drawing.suptitle(
            f"The recording determines {determined_count} of {len(post.verdicts)} parameters",
            x=0.01,
            ha="left",
        )
        marks = [
            create_mark("prior", marker="s", alpha=0.5),
            create_mark("posterior", marker="s", color=POSTERIOR_COLOUR),
        ]
        drawing.legend(handles=marks, loc="outside lower center", ncols=2)
    return drawing


def _plot_marginal(panel: Axes, prior_samples: np.ndarray, posterior_samples: np.ndarray, log: bool) -> None:
    low, high = np.quantile(np.concatenate([prior_samples, posterior_samples]), (0.002, 0.998))
    low, high = min(low, posterior_samples.min()), max(high, posterior_samples.max())
    on_log_axis = log and low > 0 and high > 30 * low
    edges = np.geomspace(low, high, 80) if on_log_axis else np.linspace(low, high, 80)
    for draws, colour, name in (
        (prior_samples, REFERENCE_COLOUR, "prior"),
        (posterior_samples, POSTERIOR_COLOUR, "posterior"),
    ):
        counts, _ = np.histogram(draws, edges)
        # Scale to equal peaks. Otherwise a narrow posterior makes its prior invisible.
        panel.stairs(counts / counts.max(), edges, fill=True, alpha=0.5, color=colour, gid=name)
    panel.set_yticks([])
    if on_log_axis:
        panel.set_xscale("log")


#: Figures that not every posterior has.
_OPTIONAL_FIGURES = ("profile.png", "ridge.png")


def list_figure_names(cases: Sequence[str]) -> list[str]:
    """Return the names of the files that `save_posterior_figures` can write.

    Args:
        cases: names of the cases.
    """
    bands = ["band.png"] if len(cases) == 1 else [f"{case}-band.png" for case in cases]
    return ["corner.png", "marginals.png", "trace.png", *_OPTIONAL_FIGURES, *bands]


def save_posterior_figures(post: Posterior, folder: Path) -> list[Path]:
    """Write every figure of a posterior as PNG and return their paths."""
    plots = {"corner": plot_corner, "marginals": plot_marginals, "trace": plot_traces}
    if post.verdicts:
        plots["profile"] = plot_profiles
    if find_ridges(post):
        plots["ridge"] = plot_ridges
    paths = [save_png(plot(post), folder / name) for name, plot in plots.items()]
    for k, case_fit in enumerate(post.fit.cases):
        prefix = "" if len(post.fit.cases) == 1 else f"{case_fit.case.name}-"
        paths.append(save_png(plot_band(post, k), folder / f"{prefix}band"))
    return paths


def remove_stale_figures(folder: Path, written: Iterable[Path]) -> None:
    """Remove figures of an earlier posterior that the posterior of some written figures does not have."""
    for name in set(_OPTIONAL_FIGURES) - {path.name for path in written}:
        (folder / name).unlink(missing_ok=True)
