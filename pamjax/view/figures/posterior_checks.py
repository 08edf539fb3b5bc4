"""Figures that check a posterior.

| figure           | question                                                            |
|------------------|---------------------------------------------------------------------|
| `plot_profiles`  | how much worse is the fit at another value of a parameter?          |
| `plot_traces`    | have the chains converged?                                          |
| `plot_band`      | do the measured values agree with the posterior prediction?         |
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pamjax.channels import DISPLAY_UNIT
from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.posterior.predictive import add_noise, predict_channels
from pamjax.infer.posterior.profile import CHI2_RISE_95
from pamjax.infer.posterior.result import Posterior
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.units import compute_si_factor
from pamjax.view.figures.fit import create_panels
from pamjax.view.figures.layout import Layout, add_key, build_layout, create_mark, draw_band, thin_points
from pamjax.view.figures.posterior_axes import (
    POSTERIOR_COLOUR,
    convert_to_unit,
    format_axis_label,
    select_parameters,
)
from pamjax.view.theme import DOUBLE_COLUMN, REFERENCE_COLOUR, SINGLE_COLUMN, apply_theme, create_figure
from pamjax.view.wording import wrap_title

#: Largest number of chains in a trace plot.
_TRACED_CHAINS = 8
#: Number of draws from which a prediction band is computed.
_BAND_DRAWS = 100


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
            panel.axhline(CHI2_RISE_95, color=REFERENCE_COLOUR, ls="--", lw=0.8, gid="limit")
            label = format_axis_label(post, k)
            panel.set_xlabel(label if narrow else label.replace("\n", ""), fontsize=7)
            panel.set_title(verdict.kind, fontsize=7)
            panel.locator_params(axis="x", nbins=3 if narrow else 5)
            panel.set_ylim(0, 10)
        for panel in panels[len(verdicts) :]:
            panel.set_axis_off()
        panels[0].set_ylabel("increase of χ²")
        drawing.legend(
            handles=[create_mark("limit of the 95 % interval", ls="--")], loc="outside lower center"
        )
    return drawing


def plot_traces(post: Posterior, narrow: bool = False) -> Figure:
    """Return traces of up to `_TRACED_CHAINS` chains for every parameter.

    A narrow figure has its labels above the panels.
    """
    indices = select_parameters(post)
    n, chains, _ = post.draws.shape
    stride = max(1, n // 500)
    with apply_theme():
        drawing = create_figure(
            SINGLE_COLUMN if narrow else DOUBLE_COLUMN, 0.6 + (1.0 if narrow else 0.75) * len(indices)
        )
        panels = drawing.subplots(len(indices), 1, sharex=True, squeeze=False)[:, 0]
        for panel, k in zip(panels, indices, strict=True):
            for chain in range(min(chains, _TRACED_CHAINS)):
                trace = convert_to_unit(post, post.draws[::stride, chain], k)
                panel.plot(np.arange(n)[::stride], trace, lw=0.5, alpha=0.7, gid="trace")
            text = f"R-hat {post.convergence.rhat[k]:.3f}, ESS {post.convergence.ess[k]:.0f}"
            label = format_axis_label(post, k)
            if narrow:
                name = label.replace("\n", "")
                panel.set_title(f"{name}: {text}", fontsize=6.5)
            else:
                panel.text(1.01, 0.5, text, transform=panel.transAxes, fontsize=6, va="center")
                panel.set_ylabel(label, fontsize=5.5)
            panel.tick_params(labelsize=6)
        panels[-1].set_xlabel("draw (first fifth discarded)")
        state = "The chains have converged" if post.converged else "The chains have NOT converged"
        title = (
            f"{state}: effective sample size ≥ {post.convergence.ess.min():.0f},"
            f" R-hat ≤ {post.convergence.rhat.max():.3f}"
        )
        drawing.suptitle(wrap_title(title, 46) if narrow else title, x=0.01, ha="left")
    return drawing


def plot_band(post: Posterior, k: int = 0, narrow: bool = False) -> Figure:
    """Return measured points on the 90 % posterior prediction band, a panel per channel."""
    case_fit = post.fit.cases[k]
    row_layout, values = build_layout(case_fit.case), post.thin_draws(_BAND_DRAWS)
    smooth_predictions = predict_channels(post.density, values, post.draw_coefficients(values)[k], k)
    with apply_theme():
        likelihoods = post.density.likelihoods[k]
        drawing, panels = create_panels(len(likelihoods), narrow)
        for panel, likelihood in zip(panels, likelihoods, strict=True):
            channel = CHANNELS[likelihood.channel]
            simulated_values = add_noise(
                case_fit, likelihood, smooth_predictions[channel], values, post.seed
            ) / compute_si_factor(DISPLAY_UNIT[channel])
            _plot_channel_band(panel, case_fit, row_layout, channel, simulated_values)
            panel.set(xlabel=row_layout.xlabel, ylabel=f"{channel} [{DISPLAY_UNIT[channel]}]")
        add_key(
            drawing,
            panels,
            row_layout,
            create_mark("measured", marker="o", ms=3),
            create_mark("90 % prediction band", marker="s", alpha=0.3),
        )
    return drawing


def _plot_channel_band(
    panel: Axes, case_fit: CaseFit, row_layout: Layout, channel: str, simulated_values: np.ndarray
) -> None:
    measured = getattr(case_fit.case.recording, channel) / compute_si_factor(DISPLAY_UNIT[channel])
    measured_rows = np.isfinite(measured) & np.all(np.isfinite(simulated_values), axis=0)
    low, high = np.full(measured_rows.size, np.nan), np.full(measured_rows.size, np.nan)
    low[measured_rows], high[measured_rows] = np.quantile(
        simulated_values[:, measured_rows], (0.05, 0.95), axis=0
    )
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
        draw_band(panel, case_fit.case, row_layout, group, measured_rows, low, high)
    inside = (measured >= low) & (measured <= high)
    share = 100 * inside[measured_rows].mean()
    panel.set_title(f"{channel.capitalize()}: {share:.0f} % of rows\nin the 90 % prediction band")
