"""Figures of a posterior.

| figure           | question                                                            |
|------------------|---------------------------------------------------------------------|
| `plot_corner`    | how uncertain are the parameters, and which are correlated?         |
| `plot_ridges`    | which parameters are determined only in combination?                |
| `plot_marginals` | how does the posterior differ from the prior?                       |
| `plot_profiles`  | how much worse is the fit at another value of a parameter?          |
| `plot_traces`    | have the chains converged?                                          |
| `plot_band`      | do the measured values agree with the posterior prediction?         |
"""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT
from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.posterior.identifiability_report import COMBINATION_KIND
from pamjax.infer.posterior.predictive import add_noise, predict_channels, sample_prior
from pamjax.infer.posterior.profile import CHI2_RISE_95
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.priors import is_length_error
from pamjax.units import compute_si_factor
from pamjax.view.figures.fit import create_panels
from pamjax.view.figures.layout import add_key, build_layout, create_mark, iterate_lines, thin_points
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    SINGLE_COLUMN,
    apply_theme,
    create_figure,
    save_png,
)

POSTERIOR_COLOUR, WARNING_COLOUR = OKABE_ITO["blue"], OKABE_ITO["vermilion"]
#: A corner plot of more numbers than this is a wall: the noise's numbers go first.
MAX_PANELS = 9
#: Numbers in the corner plot of a phone: those that move together most.
MAX_NARROW_PANELS = 4
#: Draws shown as points or traced; walkers traced.
SHOWN_DRAWS, TRACED_CHAINS = 2000, 8
#: Draws behind a predictive band.
BAND_DRAWS = 100


def _select_parameters(post: Posterior) -> list[int]:
    """Return indices of the parameters in a figure: the muscle's, and the noise's if they fit."""
    parameters = [k for k, name in enumerate(post.names) if not is_length_error(name)]
    muscle_parameters = [k for k in parameters if post.names[k] in post.fit.estimates]
    return parameters if len(parameters) <= MAX_PANELS else muscle_parameters[:MAX_PANELS]


def _format_axis_label(post: Posterior, k: int) -> str:
    _, unit = post.find_units(post.names[k])
    head, _, tail = post.names[k].rpartition(".")
    return f"{head}.\n{tail}" + ("" if unit == "1" else f" [{unit}]")


def _convert_to_unit(post: Posterior, values: np.ndarray, k: int) -> np.ndarray:
    return values[..., k] / compute_si_factor(post.find_units(post.names[k])[1])


def _select_most_correlated(post: Posterior, indices: list[int]) -> list[int]:
    """Return the indices of the most correlated parameters, in their order."""
    correlation = np.abs(post.correlation[np.ix_(indices, indices)])
    np.fill_diagonal(correlation, 0)
    ranked = np.argsort(-correlation.max(axis=1), kind="stable")[:MAX_NARROW_PANELS]
    return [indices[k] for k in sorted(ranked)]


def plot_corner(post: Posterior, narrow: bool = False) -> Figure:
    """Return every parameter's histogram, and every pair's draws with 39 and 86 % contours.

    A narrow figure has the most correlated parameters only.
    """
    all_indices, draws = _select_parameters(post), post.thin_draws(SHOWN_DRAWS)
    indices = _select_most_correlated(post, all_indices) if narrow else all_indices
    count = len(indices)
    with apply_theme():
        size = SINGLE_COLUMN if narrow else max(1.1 * count + 1, 4.5)
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
                        _convert_to_unit(post, post.flat, i),
                        40,
                        color=POSTERIOR_COLOUR,
                        alpha=0.7,
                        gid="marginal",
                    )
                    panel.set_yticks([])
                    low, high = np.quantile(_convert_to_unit(post, post.flat, i), (0.001, 0.999))
                    panel.set_xlim(low, high)
                else:
                    x, y = _convert_to_unit(post, draws, j), _convert_to_unit(post, draws, i)
                    panel.plot(
                        x, y, ".", ms=1, alpha=0.25, color=POSTERIOR_COLOUR, rasterized=True, gid="draws"
                    )
                    _plot_ellipses(panel, x, y)
                    panel.set_ylim(*np.quantile(_convert_to_unit(post, post.flat, i), (0.001, 0.999)))
                if column == 0 and row:
                    panel.set_ylabel(_format_axis_label(post, i), fontsize=6)
                elif column:
                    panel.set_yticklabels([])
                if row == count - 1:
                    panel.set_xlabel(_format_axis_label(post, j), fontsize=6)
                panel.tick_params(labelsize=5)
                panel.locator_params(nbins=3)
        title = _format_strongest_correlation(post, indices)
        if len(indices) < len(all_indices):
            title += f"; {len(indices)} of {len(all_indices)} numbers"
        title = textwrap.fill(title, 46) if narrow else title
        drawing.suptitle(title, x=0.01, ha="left", fontsize=8 if narrow else None)
    return drawing


def _plot_ellipses(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw the 1 and 2 sd ellipses of a Gaussian with the draws' covariance, which hold 39 and 86 %."""
    root = np.linalg.cholesky(np.cov(x, y) + 1e-30 * np.eye(2))
    circle = np.linspace(0, 2 * np.pi, 60)
    for sd in (1, 2):
        ellipse = sd * root @ np.stack([np.cos(circle), np.sin(circle)])
        panel.plot(x.mean() + ellipse[0], y.mean() + ellipse[1], color="black", lw=0.6, gid="ellipse")


def _format_strongest_correlation(post: Posterior, indices: list[int]) -> str:
    """Return the finding: the most correlated pair of parameters."""
    correlation = np.abs(post.correlation[np.ix_(indices, indices)])
    np.fill_diagonal(correlation, 0)
    if len(indices) < 2:
        return f"What the recording says of {post.names[indices[0]]}"
    i, j = np.unravel_index(int(correlation.argmax()), correlation.shape)
    a, b = indices[min(i, j)], indices[max(i, j)]
    value = f"{post.correlation[a, b]:+.2f}".replace("-", "−")
    return f"{post.names[a]} and {post.names[b]} move together most (correlation {value})"


def find_ridges(post: Posterior) -> list[tuple[int, int]]:
    """Return index pairs of parameters that are determined only in combination, with their partners."""
    correlation, kind_by_index = (
        np.abs(post.correlation),
        {post.names.index(n): v.kind for n, v in post.verdicts.items()},
    )
    undetermined = [k for k, kind in kind_by_index.items() if kind != "determined"]
    partners = {
        k: max((j for j in undetermined if j != k), key=lambda j, k=k: correlation[k, j])
        for k in undetermined
        if kind_by_index[k] == COMBINATION_KIND
    }
    return sorted({(min(pair), max(pair)) for pair in partners.items()})


def plot_ridges(post: Posterior, narrow: bool = False) -> Figure:
    """Return prior and posterior draws of each pair that is determined only in combination."""
    pairs, prior_samples, posterior_samples = (
        find_ridges(post),
        sample_prior(post.density, SHOWN_DRAWS, post.seed),
        post.thin_draws(SHOWN_DRAWS),
    )
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
                x, y = _convert_to_unit(post, draws, i), _convert_to_unit(post, draws, j)
                panel.plot(x, y, ".", ms=1.5, alpha=0.5, color=colour, rasterized=True, gid=name)
                if name == "prior":
                    panel.set(xlim=np.quantile(x, (0.01, 0.99)), ylim=np.quantile(y, (0.01, 0.99)))
            panel.set_xlabel(_format_axis_label(post, i).replace("\n", ""))
            panel.set_ylabel(_format_axis_label(post, j).replace("\n", ""))
        for panel in panels[len(pairs) :]:
            panel.set_axis_off()
        i, j = pairs[0]
        title = f"{post.names[i]} and {post.names[j]}\nare known only together"
        drawing.suptitle(title, x=0.01, ha="left")
        marks = [
            create_mark("believed before", marker="o", ms=3),
            create_mark("after", marker="o", ms=3, color=POSTERIOR_COLOUR),
        ]
        drawing.legend(handles=marks, loc="outside lower center", ncols=2)
    return drawing


def plot_marginals(post: Posterior, narrow: bool = False) -> Figure:
    """Return prior and posterior of each parameter, a panel each."""
    indices = _select_parameters(post)
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
                _convert_to_unit(post, prior_samples, k),
                _convert_to_unit(post, post.flat, k),
                bool(post.density.space.log_scale[k]),
            )
            panel.set_xlabel(_format_axis_label(post, k).replace("\n", ""), fontsize=7)
        for panel in panels[len(indices) :]:
            panel.set_axis_off()
        determined_count = sum(v.kind == "determined" for v in post.verdicts.values())
        drawing.suptitle(
            f"The recording determines {determined_count} of {len(post.verdicts)} numbers", x=0.01, ha="left"
        )
        marks = [
            create_mark("believed before", marker="s", alpha=0.5),
            create_mark("after", marker="s", color=POSTERIOR_COLOUR),
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
        # Both as high as their peaks: a narrow posterior would flatten its prior.
        panel.stairs(counts / counts.max(), edges, fill=True, alpha=0.5, color=colour, gid=name)
    panel.set_yticks([])
    if on_log_axis:
        panel.set_xscale("log")


def plot_profiles(post: Posterior, narrow: bool = False) -> Figure:
    """Return the profile likelihood of every parameter: χ² above its minimum, with all others refitted."""
    verdicts = post.verdicts
    columns = min(2 if narrow else 3, len(verdicts))
    with apply_theme():
        rows = math.ceil(len(verdicts) / columns)
        drawing = create_figure(SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 0.8 + 1.6 * rows)
        panels = drawing.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        for panel, (name, verdict) in zip(panels, verdicts.items(), strict=False):
            profile = verdict.profile
            k = post.names.index(name)
            scale = compute_si_factor(post.find_units(name)[1])
            panel.plot(
                profile.values / scale, profile.rise, "o-", color=POSTERIOR_COLOUR, ms=3, gid="profile"
            )
            panel.axhline(CHI2_RISE_95, color=REFERENCE_COLOUR, ls="--", lw=0.8, gid="sure")
            label = _format_axis_label(post, k)
            panel.set_xlabel(label if narrow else label.replace("\n", ""), fontsize=7)
            panel.set_title(verdict.kind, fontsize=7)
            panel.set_ylim(0, 10)
        for panel in panels[len(verdicts) :]:
            panel.set_axis_off()
        panels[0].set_ylabel("χ² above its least")
        drawing.legend(handles=[create_mark("95 % interval", ls="--")], loc="outside lower center")
    return drawing


def plot_traces(post: Posterior, narrow: bool = False) -> Figure:
    """Return traces of some chains for every parameter; a narrow figure has labels above the panels."""
    indices = _select_parameters(post)
    n, chains, _ = post.draws.shape
    stride = max(1, n // 500)
    with apply_theme():
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 0.6 + (1.0 if narrow else 0.75) * len(indices)
        )
        panels = drawing.subplots(len(indices), 1, sharex=True, squeeze=False)[:, 0]
        for panel, k in zip(panels, indices, strict=True):
            for chain in range(min(chains, TRACED_CHAINS)):
                trace = _convert_to_unit(post, post.draws[::stride, chain], k)
                panel.plot(np.arange(n)[::stride], trace, lw=0.5, alpha=0.7, gid="trace")
            text = f"R-hat {post.convergence.rhat[k]:.3f}, ESS {post.convergence.ess[k]:.0f}"
            label = _format_axis_label(post, k)
            if narrow:
                name = label.replace("\n", "")
                panel.set_title(f"{name}: {text}", fontsize=6.5)
            else:
                panel.text(1.01, 0.5, text, transform=panel.transAxes, fontsize=6, va="center")
                panel.set_ylabel(label, fontsize=5.5)
            panel.tick_params(labelsize=6)
        panels[-1].set_xlabel("draw, after the first fifth")
        agreement = "The chains agree" if post.converged else "The chains are NOT yet good enough"
        health_text = (
            f"at least {post.convergence.ess.min():.0f} effective samples, R-hat ≤"
            f" {post.convergence.rhat.max():.3f}"
        )
        title = f"{agreement}: {health_text}"
        drawing.suptitle(textwrap.fill(title, 46) if narrow else title, x=0.01, ha="left")
    return drawing


def plot_band(post: Posterior, k: int = 0, narrow: bool = False) -> Figure:
    """Return measured points on bands in which 90 % of new samples are expected, a panel per channel."""
    case_fit = post.fit.cases[k]
    row_layout, values = build_layout(case_fit.case), post.thin_draws(BAND_DRAWS)
    smooth_predictions = predict_channels(post.density, values, k)
    with apply_theme():
        likelihoods = post.density.likelihoods[k]
        drawing, panels = create_panels(len(likelihoods), narrow)
        for panel, likelihood in zip(panels, likelihoods, strict=True):
            channel = CHANNELS[likelihood.channel]
            simulated = add_noise(
                case_fit, likelihood, smooth_predictions[channel], values, post.seed
            ) / compute_si_factor(DISPLAY_UNIT[channel])
            _plot_channel_band(panel, case_fit, row_layout, channel, simulated)
            panel.set(xlabel=row_layout.xlabel, ylabel=f"{channel} [{DISPLAY_UNIT[channel]}]")
        add_key(
            drawing,
            panels,
            row_layout,
            create_mark("measured", marker="o", ms=3),
            create_mark("90 % expected", marker="s", alpha=0.3),
        )
    return drawing


def _plot_channel_band(
    panel: Axes, case_fit: CaseFit, row_layout, channel: str, simulated: np.ndarray
) -> None:
    measured = getattr(case_fit.case.recording, channel) / compute_si_factor(DISPLAY_UNIT[channel])
    measured_rows = np.isfinite(measured) & np.all(np.isfinite(simulated), axis=0)
    low, high = np.full(measured_rows.size, np.nan), np.full(measured_rows.size, np.nan)
    low[measured_rows], high[measured_rows] = np.quantile(simulated[:, measured_rows], (0.05, 0.95), axis=0)
    drawn_rows = thin_points(
        np.where(row_layout.group >= 0, row_layout.x, np.nan), np.where(measured_rows, measured, np.nan)
    )
    for group, colour in enumerate(row_layout.colours):
        group_rows = drawn_rows[row_layout.group[drawn_rows] == group]
        panel.plot(
            row_layout.x[group_rows],
            measured[group_rows],
            "o",
            color=colour,
            ms=2.3,
            mew=0,
            alpha=0.7,
            gid="measured",
        )
        for group_rows in iterate_lines(case_fit.case, row_layout, group, measured_rows):
            ordered_rows = group_rows[np.argsort(row_layout.x[group_rows], kind="stable")]
            if row_layout.connected and len(ordered_rows) > 1:
                panel.fill_between(
                    row_layout.x[ordered_rows],
                    low[ordered_rows],
                    high[ordered_rows],
                    color=colour,
                    alpha=0.25,
                    lw=0,
                    gid="band",
                )
            else:
                panel.vlines(
                    row_layout.x[ordered_rows],
                    low[ordered_rows],
                    high[ordered_rows],
                    color=colour,
                    alpha=0.5,
                    lw=3,
                    gid="band",
                )
    inside = (measured >= low) & (measured <= high)
    share = 100 * inside[measured_rows].mean()
    panel.set_title(f"{channel.capitalize()}: {share:.0f} % of samples\nin the band that is to hold 90 %")


def save_posterior_figures(post: Posterior, folder: Path) -> list[Path]:
    """Write every figure of a posterior as PNG and return the files."""
    plots = {"corner": plot_corner, "belief": plot_marginals, "trace": plot_traces}
    if post.verdicts:
        plots["profile"] = plot_profiles
    if find_ridges(post):
        plots["ridge"] = plot_ridges
    for name in {"profile", "ridge"} - set(plots):
        # One that an earlier posterior left in this folder speaks of that one.
        (folder / f"{name}.png").unlink(missing_ok=True)
    written = [save_png(plot(post), folder / name) for name, plot in plots.items()]
    for k, case_fit in enumerate(post.fit.cases):
        prefix = "" if len(post.fit.cases) == 1 else f"{case_fit.case.name}-"
        written.append(save_png(plot_band(post, k), folder / f"{prefix}band"))
    return written
