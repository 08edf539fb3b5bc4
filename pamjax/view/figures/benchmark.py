"""Figures of a benchmark: p-values without a concealed effect, and recovery of concealed effects.

| figure       | question                                                                              |
|--------------|---------------------------------------------------------------------------------------|
| `plot_null`  | are p-values uniform without a concealed effect?                                      |
| `plot_proof` | how well are effects identified, quantified, predicted and located, by effect size?   |
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure
from scipy.stats import beta

from pamjax.benchmark.rates import Rate
from pamjax.benchmark.tally import MAX_ERROR_NOISE_RATIO, compute_coverage, compute_reliability
from pamjax.benchmark.trial import Trial
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.view.theme import (
    DOUBLE_COLUMN,
    OKABE_ITO,
    REFERENCE_COLOUR,
    add_panel_letters,
    apply_theme,
    create_figure,
)

#: Edges of effect sizes, in noise standard deviations.
_SIZE_EDGES = (2.0, 4.0, 6.0, 9.0, 14.0, 30.0)
_PAMJAX_COLOUR, _BIC_COLOUR, _GP_COLOUR, _BASELINE_COLOUR = (
    OKABE_ITO[c] for c in ("blue", "vermilion", "orange", "purple")
)
#: Colours by autocorrelation of the noise, from low to high.
_CORRELATION_COLOURS = (OKABE_ITO["sky"], OKABE_ITO["blue"], OKABE_ITO["black"])


def plot_null(trials: Sequence[Trial]) -> Figure | None:
    """Return observed against expected p-values, a panel per stage and correlation; None without trials."""
    null_trials = [trial for trial in trials if trial.kind == "nothing" and not trial.error]
    groups = list(dict.fromkeys((trial.stage, trial.correlation) for trial in null_trials))
    if not groups:
        return None
    column_count = min(len(groups), 3)
    row_count = -(-len(groups) // column_count)
    with apply_theme():
        drawing = create_figure(DOUBLE_COLUMN, 2.6 * row_count)
        panels = drawing.subplots(row_count, column_count, squeeze=False).ravel()
        for panel, (stage, correlation) in zip(panels, groups, strict=False):
            group_trials = [
                trial for trial in null_trials if (trial.stage, trial.correlation) == (stage, correlation)
            ]
            _plot_quantiles(panel, [trial.p_value for trial in group_trials])
            hits = Rate.from_outcomes(trial.is_detected for trial in group_trials)
            stage_name = "score test only" if stage == "score" else "all steps"
            panel.set_title(
                f"Autocorrelation {correlation:g}, {stage_name}:\n"
                f"{hits.hits} of {hits.total} false alarms,\nrate at most {hits.upper_limit:.1%}"
            )
        for panel in panels[len(groups) :]:
            panel.remove()
    return drawing


def _plot_quantiles(panel: Panel, p_values: Sequence[float]) -> None:
    sorted_values, n = np.sort(p_values), len(p_values)
    rank = np.arange(1, n + 1)
    expected = (rank - 0.5) / n
    low, high = (np.clip(beta.ppf(q, rank, n + 1 - rank), 1e-12, 1) for q in (0.025, 0.975))
    panel.fill_between(
        expected, low, high, color=REFERENCE_COLOUR, alpha=0.25, lw=0, label="95 % band, uniform"
    )
    panel.plot(expected, expected, color=REFERENCE_COLOUR, lw=0.8)
    panel.plot(expected, np.maximum(sorted_values, 0.1 / n), ".", color=_PAMJAX_COLOUR, ms=3, gid="p-values")
    limit = DEFAULT_SETTINGS.detection_p_value
    panel.axhline(limit, color=_BASELINE_COLOUR, ls=":", lw=0.8, label="detection limit")
    panel.set(
        xscale="log", yscale="log", xlim=(min(0.5 / n, 0.03), 1), ylim=(min(0.08 / n, 0.005), 1.2),
        xlabel="expected p-value", ylabel="observed p-value",
    )  # fmt: skip
    panel.legend(loc="lower right")


def plot_proof(trials: Sequence[Trial]) -> Figure | None:
    """Return six panels on recovery, or None if no effect was concealed."""
    full_trials = [trial for trial in trials if trial.stage == "all" and not trial.error]
    effect_trials = [trial for trial in full_trials if trial.kind in ("single", "pair", "triple")]
    if not effect_trials:
        return None
    with apply_theme():
        drawing = create_figure(DOUBLE_COLUMN, 5.2)
        panels = drawing.subplots(2, 3).ravel()
        _plot_recovery(panels[0], effect_trials)
        _plot_false_names(panels[1], full_trials)
        _plot_reliability(panels[2], full_trials)
        _plot_coverage(panels[3], effect_trials)
        _plot_held_out(panels[4], effect_trials)
        _plot_location(panels[5], effect_trials)
    return drawing


def plot_bank(trials: Sequence[Trial]) -> Figure | None:
    """Return recovery and reliability of a bank with effects in other forms, or None without effects.

    The reliability has the named mechanisms of all recordings. Each is wrong in a recording without one.
    """
    full_trials = [trial for trial in trials if not trial.error]
    effect_trials = [trial for trial in full_trials if trial.concealed and not trial.outside]
    if not effect_trials:
        return None
    with apply_theme():
        drawing = create_figure(DOUBLE_COLUMN, 2.9)
        panels = drawing.subplots(1, 2).ravel()
        _plot_recovery(panels[0], effect_trials)
        _plot_reliability(panels[1], full_trials)
        add_panel_letters(panels)
    return drawing


def _plot_recovery(panel: Panel, trials: Sequence[Trial]) -> None:
    all_hits = [
        (size, hit) for trial in trials for size, hit in zip(trial.sizes, trial.effects_found, strict=True)
    ]
    correlations = sorted({trial.correlation for trial in trials})
    for k, correlation in enumerate(correlations):
        size_hits = [
            (size, hit)
            for trial in trials
            if trial.correlation == correlation
            for size, hit in zip(trial.sizes, trial.effects_found, strict=True)
        ]
        _plot_by_size(
            panel,
            size_hits,
            _CORRELATION_COLOURS[k % 3],
            "o",
            f"autocorrelation {correlation:g}",
            k - (len(correlations) - 1) / 2,
        )
    bic_hits = [
        (size, id in trial.selected)
        for trial in trials
        if trial.selected is not None
        for size, id in zip(trial.sizes, trial.concealed, strict=True)
    ]
    if bic_hits:
        _plot_by_size(panel, bic_hits, _BIC_COLOUR, "s", "BIC", 0.0, ls="--")
    rate = Rate.from_outcomes(hit for _, hit in all_hits)
    panel.set(
        ylim=(0, 1.03),
        ylabel="share of effects named",
        title=f"{rate.share:.0%} of {rate.total} effects are named",
    )
    _set_size_axis(panel)
    panel.legend(loc="lower right")


def _plot_by_size(panel: Panel, size_hits, colour, marker, label, shift, ls="-") -> None:
    sizes, rates = [], []
    for low, high in pairwise(_SIZE_EDGES):
        hits = [hit for size, hit in size_hits if low <= size < high]
        if hits:
            sizes.append(np.sqrt(low * high) * 1.04**shift)
            rates.append(Rate.from_outcomes(hits))
    _plot_rates(panel, sizes, rates, colour, marker, label, ls)


def _plot_rates(panel: Panel, x, rates: Sequence[Rate], colour, marker, label, ls="-") -> None:
    share = np.array([rate.share for rate in rates])
    limits = np.array([rate.compute_interval() for rate in rates]).reshape(-1, 2)
    intervals = np.abs(limits.T - share)
    panel.errorbar(
        x, share, intervals, color=colour, marker=marker, ms=3.5, lw=1, elinewidth=0.7, ls=ls, label=label
    )


def _set_size_axis(panel: Panel) -> None:
    panel.set(xscale="log", xlim=(_SIZE_EDGES[0], _SIZE_EDGES[-1]), xlabel="effect size [noise sd]")
    panel.set_xticks([3, 5, 8, 12, 20], ["3", "5", "8", "12", "20"])
    panel.minorticks_off()


def _plot_false_names(panel: Panel, trials: Sequence[Trial]) -> None:
    correlations = sorted({trial.correlation for trial in trials})
    pamjax_rates = [
        Rate.from_outcomes(not all(trial.names_right) for trial in trials if trial.correlation == correlation)
        for correlation in correlations
    ]
    x = np.arange(len(correlations))
    _plot_rates(panel, x - 0.08, pamjax_rates, _PAMJAX_COLOUR, "o", "pamjax", "none")
    bic_trials = [
        [trial for trial in trials if trial.correlation == correlation and trial.selected is not None]
        for correlation in correlations
    ]
    if all(bic_trials):
        bic_rates = [
            Rate.from_outcomes(bool(set(trial.selected or ()) - set(trial.concealed)) for trial in group)
            for group in bic_trials
        ]
        _plot_rates(panel, x + 0.08, bic_rates, _BIC_COLOUR, "s", "BIC", "none")
    panel.set_xticks(x, [f"{correlation:g}" for correlation in correlations])
    overall = Rate.from_outcomes(not all(trial.names_right) for trial in trials)
    panel.set(
        xlim=(-0.5, len(correlations) - 0.5), ylim=(0, 1.03), xlabel="autocorrelation of the noise",
        ylabel="recordings with a wrong mechanism",
        title=f"Wrong mechanism in {overall.share:.0%} of {overall.total} recordings",
    )  # fmt: skip
    panel.legend(loc="center left")


def _plot_reliability(panel: Panel, trials: Sequence[Trial]) -> None:
    bins = compute_reliability(trials)
    panel.plot([0.4, 1], [0.4, 1], color=REFERENCE_COLOUR, lw=0.8)
    _plot_rates(
        panel, [p for p, _ in bins], [rate for _, rate in bins], _PAMJAX_COLOUR, "o", "mechanisms", "none"
    )
    for p, rate in bins:
        offset = -10 if rate.share > 0.1 else 4
        panel.annotate(
            f"{rate.total}", (p, rate.share), (-4, offset), textcoords="offset points", fontsize=6, ha="right"
        )
    total = sum(rate.total for _, rate in bins)
    hits = sum(rate.hits for _, rate in bins)
    mean = sum(p * rate.total for p, rate in bins) / max(total, 1)
    panel.set(
        xlim=(0.48, 1.02), ylim=(0, 1.03), xlabel="stated probability", ylabel="share of correct mechanisms",
        title=f"Mean probability {mean:.2f}, share correct {hits / max(total, 1):.2f}",
    )  # fmt: skip


def _plot_coverage(panel: Panel, trials: Sequence[Trial]) -> None:
    correlations = sorted({trial.correlation for trial in trials})
    x = np.arange(len(correlations))
    kinds = (
        ("mechanism parameters", False, _PAMJAX_COLOUR, -0.08),
        ("baseline parameters", True, _BASELINE_COLOUR, 0.08),
    )
    for label, of_baseline, colour, shift in kinds:
        rates = [
            compute_coverage([trial for trial in trials if trial.correlation == correlation], of_baseline)
            for correlation in correlations
        ]
        indices = [k for k, rate in enumerate(rates) if rate.total]
        _plot_rates(panel, x[indices] + shift, [rates[k] for k in indices], colour, "o", label, "none")
    panel.axhspan(0.85, 0.95, color=REFERENCE_COLOUR, alpha=0.2, lw=0)
    panel.set_xticks(x, [f"{correlation:g}" for correlation in correlations])
    overall = compute_coverage(trials, False)
    panel.set(
        xlim=(-0.5, len(correlations) - 0.5), ylim=(0, 1.03), xlabel="autocorrelation of the noise",
        ylabel="coverage of 90 % intervals",
        title=f"90 % intervals cover {overall.share:.0%} of {overall.total} values",
    )  # fmt: skip
    panel.legend(loc="lower left")


def _plot_held_out(panel: Panel, trials: Sequence[Trial]) -> None:
    scored_trials = [trial for trial in trials if "force" in trial.after]
    kinds: tuple[tuple[str, str, Callable[[Trial], float | None]], ...] = (
        ("baseline", REFERENCE_COLOUR, lambda trial: trial.before["force"]),
        ("Gaussian process", _GP_COLOUR, lambda trial: trial.curve_after),
        ("BIC selection", _BIC_COLOUR, lambda trial: trial.selected_after),
        ("pamjax", _PAMJAX_COLOUR, lambda trial: trial.after["force"]),
    )
    for label, colour, score in kinds:
        sizes, medians, quantiles = [], [], []
        for low, high in pairwise(_SIZE_EDGES):
            raw_scores = [score(trial) for trial in scored_trials if low <= max(trial.sizes) < high]
            values = [v for v in raw_scores if v is not None]
            if values:
                sizes.append(np.sqrt(low * high))
                medians.append(np.median(values))
                quantiles.append(np.quantile(values, [0.1, 0.9]))
        if sizes:
            panel.plot(sizes, medians, "o-", color=colour, ms=3, lw=1, label=label)
            panel.fill_between(sizes, *np.array(quantiles).T, color=colour, alpha=0.12, lw=0)
    panel.axhline(MAX_ERROR_NOISE_RATIO, color=REFERENCE_COLOUR, ls=":", lw=0.8)
    success_rate = Rate.from_outcomes(
        trial.after["force"] <= MAX_ERROR_NOISE_RATIO for trial in scored_trials
    )
    panel.set(
        yscale="log", ylabel="held-out force error / noise",
        title=f"{success_rate.share:.0%} of {success_rate.total} below {MAX_ERROR_NOISE_RATIO:g} × noise",
    )  # fmt: skip
    panel.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    _set_size_axis(panel)
    panel.set_xlabel("largest effect size [noise sd]")
    panel.legend(loc="upper left")


def _plot_location(panel: Panel, trials: Sequence[Trial]) -> None:
    located_trials = [trial for trial in trials if trial.iou is not None]
    for label, colour, field in (
        ("pamjax", _PAMJAX_COLOUR, "iou"),
        ("entire recording", REFERENCE_COLOUR, "iou_blind"),
    ):
        sizes, means, errors = [], [], []
        for low, high in pairwise(_SIZE_EDGES):
            values = [getattr(trial, field) for trial in located_trials if low <= max(trial.sizes) < high]
            if values:
                sizes.append(np.sqrt(low * high))
                means.append(np.mean(values))
                errors.append(1.96 * np.std(values) / np.sqrt(len(values)))
        panel.errorbar(
            sizes, means, errors, color=colour, marker="o", ms=3, lw=1, elinewidth=0.7, label=label
        )
    mean = (
        np.mean([trial.iou for trial in located_trials if trial.iou is not None])
        if located_trials
        else float("nan")
    )
    panel.set(
        ylim=(0, 1.03), ylabel="overlap with the true region", title=f"Location: mean overlap {mean:.2f}"
    )
    _set_size_axis(panel)
    panel.set_xlabel("largest effect size [noise sd]")
    panel.legend(loc="lower right")
