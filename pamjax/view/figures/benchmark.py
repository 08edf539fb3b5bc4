"""Figures of a proof: p-values where nothing is, and what was recovered where something is.

| figure          | question                                                                       |
|-----------------|--------------------------------------------------------------------------------|
| `null_figure`   | are p-values uniform where nothing is concealed?                                |
| `proof_figure`  | what is named, invented, covered, predicted and located, for which effect size? |
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure
from scipy.stats import beta

from pamjax.benchmark.rates import Rate
from pamjax.benchmark.tally import DOWN, covered, reliability
from pamjax.benchmark.trial import Trial
from pamjax.diagnosis.detect.significance import DETECTED
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, figure, theme

#: Edges of effect sizes, in noise standard deviations.
SIZES = (2.0, 4.0, 6.0, 9.0, 14.0, 30.0)
MINE, BIC, CURVE, NOTHING = (OKABE_ITO[c] for c in ("blue", "vermilion", "orange", "purple"))
#: By correlation of the noise, from none to much.
SHADES = (OKABE_ITO["sky"], OKABE_ITO["blue"], OKABE_ITO["black"])


def null_figure(trials: Sequence[Trial]) -> Figure | None:
    """Observed against expected p-values, stage by stage and correlation by correlation; None without any."""
    nothing = [t for t in trials if t.kind == "nothing" and not t.error]
    groups = list(dict.fromkeys((t.stage, t.correlation) for t in nothing))
    if not groups:
        return None
    across = min(len(groups), 3)
    down = -(-len(groups) // across)
    with theme():
        made = figure(DOUBLE, 2.6 * down)
        panels = made.subplots(down, across, squeeze=False).ravel()
        for panel, (stage, correlation) in zip(panels, groups, strict=False):
            some = [t for t in nothing if (t.stage, t.correlation) == (stage, correlation)]
            _quantiles(panel, [t.p_value for t in some])
            hits = Rate.of_all(t.detected for t in some)
            word = "scoring stage" if stage == "score" else "whole pipeline"
            panel.set_title(
                f"Noise {correlation:g}, {word}:\n"
                f"{hits.hits} of {hits.of} detected,\nat most {hits.at_most:.1%}"
            )
        for panel in panels[len(groups) :]:
            panel.remove()
    return made


def _quantiles(panel: Panel, p_values: Sequence[float]) -> None:
    seen, n = np.sort(p_values), len(p_values)
    rank = np.arange(1, n + 1)
    expected = (rank - 0.5) / n
    low, high = (np.clip(beta.ppf(q, rank, n + 1 - rank), 1e-12, 1) for q in (0.025, 0.975))
    panel.fill_between(expected, low, high, color=QUIET, alpha=0.25, lw=0, label="95 % of uniform ones")
    panel.plot(expected, expected, color=QUIET, lw=0.8)
    panel.plot(expected, np.maximum(seen, 0.1 / n), ".", color=MINE, ms=3, gid="p-values")
    panel.axhline(DETECTED, color=NOTHING, ls=":", lw=0.8, label="detected below")
    panel.set(
        xscale="log", yscale="log", xlim=(min(0.5 / n, 0.03), 1), ylim=(min(0.08 / n, 0.005), 1.2),
        xlabel="expected p-value", ylabel="observed p-value",
    )  # fmt: skip
    panel.legend(loc="lower right")


def proof_figure(trials: Sequence[Trial]) -> Figure | None:
    """Six panels; None where nothing was concealed."""
    some = [t for t in trials if t.stage == "all" and not t.error]
    real = [t for t in some if t.kind in ("single", "pair", "triple")]
    if not real:
        return None
    with theme():
        made = figure(DOUBLE, 5.2)
        panels = made.subplots(2, 3).ravel()
        _recovered(panels[0], real)
        _invented(panels[1], some)
        _reliable(panels[2], some)
        _covering(panels[3], real)
        _held_out(panels[4], real)
        _located(panels[5], real)
    return made


def _recovered(panel: Panel, real: Sequence[Trial]) -> None:
    pairs = [(size, hit) for t in real for size, hit in zip(t.sizes, t.found, strict=True)]
    correlations = sorted({t.correlation for t in real})
    for k, correlation in enumerate(correlations):
        mine = [
            (s, h)
            for t in real
            if t.correlation == correlation
            for s, h in zip(t.sizes, t.found, strict=True)
        ]
        _by_size(panel, mine, SHADES[k % 3], "o", f"noise {correlation:g}", k - (len(correlations) - 1) / 2)
    usual = [
        (size, id in t.selected)
        for t in real
        if t.selected is not None
        for size, id in zip(t.sizes, t.concealed, strict=True)
    ]
    if usual:
        _by_size(panel, usual, BIC, "s", "BIC", 0.0, ls="--")
    rate = Rate.of_all(hit for _, hit in pairs)
    panel.set(ylim=(0, 1.03), ylabel="share named", title=f"{rate.share:.0%} of {rate.of} effects are named")
    _sized(panel)
    panel.legend(loc="lower right")


def _by_size(panel: Panel, pairs, colour, marker, label, shift, ls="-") -> None:
    at, rates = [], []
    for low, high in pairwise(SIZES):
        hits = [hit for size, hit in pairs if low <= size < high]
        if hits:
            at.append(np.sqrt(low * high) * 1.04**shift)
            rates.append(Rate.of_all(hits))
    _bars(panel, at, rates, colour, marker, label, ls)


def _bars(panel: Panel, at, rates: Sequence[Rate], colour, marker, label, ls="-") -> None:
    share = np.array([rate.share for rate in rates])
    limits = np.array([rate.limits() for rate in rates]).reshape(-1, 2)
    spread = np.abs(limits.T - share)
    panel.errorbar(
        at, share, spread, color=colour, marker=marker, ms=3.5, lw=1, elinewidth=0.7, ls=ls, label=label
    )


def _sized(panel: Panel) -> None:
    panel.set(xscale="log", xlim=(SIZES[0], SIZES[-1]), xlabel="effect [noise sd]")
    panel.set_xticks([3, 5, 8, 12, 20], ["3", "5", "8", "12", "20"])
    panel.minorticks_off()


def _invented(panel: Panel, some: Sequence[Trial]) -> None:
    correlations = sorted({t.correlation for t in some})
    mine = [Rate.of_all(not all(t.right) for t in some if t.correlation == c) for c in correlations]
    at = np.arange(len(correlations))
    _bars(panel, at - 0.08, mine, MINE, "o", "pamjax", "none")
    asked = [[t for t in some if t.correlation == c and t.selected is not None] for c in correlations]
    if all(asked):
        usual = [
            Rate.of_all(bool(set(t.selected or ()) - set(t.concealed)) for t in group) for group in asked
        ]
        _bars(panel, at + 0.08, usual, BIC, "s", "BIC", "none")
    panel.set_xticks(at, [f"{c:g}" for c in correlations])
    whole = Rate.of_all(not all(t.right) for t in some)
    panel.set(
        xlim=(-0.5, len(correlations) - 0.5), ylim=(0, 1.03), xlabel="correlation of neighbouring noise",
        ylabel="share of recordings with a wrong name",
        title=f"A wrong name in {whole.share:.0%} of {whole.of}",
    )  # fmt: skip
    panel.legend(loc="upper left")


def _reliable(panel: Panel, some: Sequence[Trial]) -> None:
    told = reliability(some)
    panel.plot([0.4, 1], [0.4, 1], color=QUIET, lw=0.8)
    _bars(panel, [p for p, _ in told], [rate for _, rate in told], MINE, "o", "names", "none")
    for p, rate in told:
        below = -10 if rate.share > 0.1 else 4
        panel.annotate(
            f"{rate.of}", (p, rate.share), (-4, below), textcoords="offset points", fontsize=6, ha="right"
        )
    total = sum(rate.of for _, rate in told)
    hits = sum(rate.hits for _, rate in told)
    mean = sum(p * rate.of for p, rate in told) / max(total, 1)
    panel.set(
        xlim=(0.48, 1.02), ylim=(0, 1.03), xlabel="stated probability", ylabel="share right",
        title=f"Stated {mean:.2f} on average, right {hits / max(total, 1):.2f}",
    )  # fmt: skip


def _covering(panel: Panel, real: Sequence[Trial]) -> None:
    correlations = sorted({t.correlation for t in real})
    at = np.arange(len(correlations))
    kinds = (("numbers of names", False, MINE, -0.08), ("baseline's numbers", True, NOTHING, 0.08))
    for label, own, colour, shift in kinds:
        rates = [covered([t for t in real if t.correlation == c], own) for c in correlations]
        kept = [k for k, rate in enumerate(rates) if rate.of]
        _bars(panel, at[kept] + shift, [rates[k] for k in kept], colour, "o", label, "none")
    panel.axhspan(0.85, 0.95, color=QUIET, alpha=0.2, lw=0)
    panel.set_xticks(at, [f"{c:g}" for c in correlations])
    whole = covered(real, False)
    panel.set(
        xlim=(-0.5, len(correlations) - 0.5), ylim=(0, 1.03), xlabel="correlation of neighbouring noise",
        ylabel="share of 90 % intervals with the truth",
        title=f"90 % intervals hold {whole.share:.0%} of {whole.of} numbers",
    )  # fmt: skip
    panel.legend(loc="lower left")


def _held_out(panel: Panel, real: Sequence[Trial]) -> None:
    scores = [t for t in real if "force" in t.after]
    kinds: tuple[tuple[str, str, Callable[[Trial], float | None]], ...] = (
        ("baseline", QUIET, lambda t: t.before["force"]),
        ("Gaussian process", CURVE, lambda t: t.curve_after),
        ("selected by BIC", BIC, lambda t: t.selected_after),
        ("named", MINE, lambda t: t.after["force"]),
    )
    for label, colour, score in kinds:
        at, middle, reach = [], [], []
        for low, high in pairwise(SIZES):
            told = [score(t) for t in scores if low <= max(t.sizes) < high]
            values = [v for v in told if v is not None]
            if values:
                at.append(np.sqrt(low * high))
                middle.append(np.median(values))
                reach.append(np.quantile(values, [0.1, 0.9]))
        if at:
            panel.plot(at, middle, "o-", color=colour, ms=3, lw=1, label=label)
            panel.fill_between(at, *np.array(reach).T, color=colour, alpha=0.12, lw=0)
    panel.axhline(DOWN, color=QUIET, ls=":", lw=0.8)
    down = Rate.of_all(t.after["force"] <= DOWN for t in scores)
    panel.set(
        yscale="log", ylabel="held-out force error / noise",
        title=f"{down.share:.0%} of {down.of} within {DOWN:g} of the noise",
    )  # fmt: skip
    panel.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    _sized(panel)
    panel.set_xlabel("largest effect [noise sd]")
    panel.legend(loc="upper left")


def _located(panel: Panel, real: Sequence[Trial]) -> None:
    boxes = [t for t in real if t.iou is not None]
    for label, colour, word in (("claimed", MINE, "iou"), ("all of the recording", QUIET, "iou_blind")):
        at, means, errors = [], [], []
        for low, high in pairwise(SIZES):
            values = [getattr(t, word) for t in boxes if low <= max(t.sizes) < high]
            if values:
                at.append(np.sqrt(low * high))
                means.append(np.mean(values))
                errors.append(1.96 * np.std(values) / np.sqrt(len(values)))
        panel.errorbar(at, means, errors, color=colour, marker="o", ms=3, lw=1, elinewidth=0.7, label=label)
    mean = np.mean([t.iou for t in boxes if t.iou is not None]) if boxes else float("nan")
    panel.set(ylim=(0, 1.03), ylabel="overlap with the true box", title=f"Located: mean overlap {mean:.2f}")
    _sized(panel)
    panel.set_xlabel("largest effect [noise sd]")
    panel.legend(loc="lower right")
