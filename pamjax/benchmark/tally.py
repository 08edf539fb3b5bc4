"""Results of the simulation study as table lines, for pamjax and for common practice.

Effects of one recording are counted as independent. The intervals of recall, precision and coverage are
therefore slightly too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import kstest

from pamjax.benchmark.rates import Rate, TableLine, build_rate_line
from pamjax.benchmark.trial import Trial

#: Titles of the stages of a trial.
_STAGE_TITLES = {"all": "whole diagnosis", "score": "test of the baseline only"}
#: Effect sizes, in noise standard deviations, that are large for one effect and clear in pairs and triples.
_OBVIOUS_EFFECT_SD, _CLEAR_EFFECT_SD = 8.0, 5.0
#: Half-width of a 90 % interval, in standard deviations.
_NORMAL_QUANTILE_95 = 1.6449
#: Held-out error over noise up to which the model predicts to within noise.
MAX_ERROR_NOISE_RATIO = 1.15
#: Edges of the bins of reported probabilities, for comparison with the share of correct mechanisms.
_PROBABILITY_EDGES = (0.5, 0.8, 0.95, 0.995, 1.0)


def tabulate_false_alarms(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the false-alarm lines for recordings without effects, by stage and correlation."""
    lines = []
    nothing = [t for t in trials if t.kind == "nothing" and not t.error]
    for stage, correlation in dict.fromkeys((t.stage, t.correlation) for t in nothing):
        group = [t for t in nothing if (t.stage, t.correlation) == (stage, correlation)]
        p_values = [t.p_value for t in group]
        hits_by_label = {"detected (p < 0.01)": [t.is_detected for t in group]}
        if stage == "all":
            hits_by_label |= {
                "a mechanism named": [bool(t.named) for t in group],
                "an unexplained misfit reported": [t.unexplained for t in group],
                "any alarm": [t.is_alarm for t in group],
            }
        where = f"noise correlation {correlation:g}, {_STAGE_TITLES[stage]}"
        for label, hits in hits_by_label.items():
            rate = Rate.from_outcomes(hits)
            common_practice = ""
            if label == "a mechanism named":
                compared_trials = [t for t in group if t.selected is not None]
                common_practice = (
                    str(Rate.from_outcomes(bool(t.selected) for t in compared_trials))
                    if compared_trials
                    else ""
                )
            lines.append(
                TableLine(
                    f"{where}: {label}",
                    rate,
                    f"{rate}; at most {rate.upper_limit:.1%}",
                    common_practice,
                    "at most 2 %",
                )
            )
        test = kstest(p_values, "uniform")
        below = ", ".join(
            f"{np.mean(np.array(p_values) < edge):.3f} below {edge:g}" for edge in (0.05, 0.1, 0.5)
        )
        text = f"p = {test.pvalue:.2g} (distance {test.statistic:.3f}); {below}"
        lines.append(TableLine(f"{where}: uniform p-values (Kolmogorov-Smirnov)", None, text, "", "uniform"))
    return lines


def tabulate_recovery(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the lines on identified injected effects and on wrongly identified mechanisms."""
    effect_trials = [
        t for t in trials if t.stage == "all" and not t.error and t.kind in ("single", "pair", "triple")
    ]
    with_selection = [t for t in effect_trials if t.selected is not None]
    single, several = (
        [t for t in effect_trials if t.kind == "single"],
        [t for t in effect_trials if t.kind != "single"],
    )
    lines = []
    for word, low, high, target in (
        ("of 3 to 8 sd", 0.0, _OBVIOUS_EFFECT_SD, ">= 80 %"),
        ("of 8 sd or more", _OBVIOUS_EFFECT_SD, np.inf, ">= 95 %"),
    ):
        trials_of_size = [t for t in single if low <= t.sizes[0] < high]
        lines.append(
            build_rate_line(
                f"one effect {word}: first mechanism correct",
                [bool(t.names_right) and t.names_right[0] for t in trials_of_size],
                [_is_first_right(t) for t in trials_of_size if t.selected is not None],
                target,
            )
        )
        lines.append(
            build_rate_line(
                f"one effect {word}: only this effect named",
                [t.is_exact for t in trials_of_size],
                [set(t.selected or ()) == set(t.concealed) for t in trials_of_size if t.selected is not None],
            )
        )
    for word, group in (
        ("recordings with one effect", single),
        ("recordings with two or three effects", several),
    ):
        lines += _tabulate_names(word, group)
    lines.append(
        build_rate_line(
            "two or three effects: exactly these effects named",
            [t.is_exact for t in several],
            [set(t.selected or ()) == set(t.concealed) for t in several if t.selected is not None],
        )
    )
    outside = [t for t in trials if t.kind == "outside" and t.stage == "all" and not t.error]
    outside_with_selection = [t for t in outside if t.selected is not None]
    lines.append(
        build_rate_line(
            "effect outside the library: an unexplained misfit reported",
            [t.unexplained for t in outside],
            None,
            ">= 90 %",
        )
    )
    lines.append(
        build_rate_line(
            "effect outside the library: a mechanism named",
            [bool(t.named) for t in outside],
            [bool(t.selected) for t in outside_with_selection],
            "<= 10 %",
        )
    )
    lines.append(
        build_rate_line(
            "one to three effects: an unexplained misfit reported", [t.unexplained for t in effect_trials]
        )
    )
    reported_ties = [(t, tie) for t in effect_trials for ties in t.ties for tie in ties]
    are_indistinguishable = [
        any((id, tie) in t.verified_ties for id in t.concealed) for t, tie in reported_ties
    ]
    lines.append(build_rate_line("reported ties that are indistinguishable", are_indistinguishable))
    return (
        [line for line in lines if line.rate and line.rate.total]
        if with_selection or effect_trials or outside
        else []
    )


def _is_first_right(t: Trial) -> bool:
    return bool(t.selected) and (t.selected or ("",))[0] in t.concealed


def _tabulate_names(word: str, group: Sequence[Trial]) -> list[TableLine]:
    """Return recall of all effects and of clear ones, precision and F1."""
    with_selection = [t for t in group if t.selected is not None]
    clear = [(t, i) for t in group for i, size in enumerate(t.sizes) if size >= _CLEAR_EFFECT_SD]
    lines = [
        build_rate_line(
            f"{word}: effects named",
            [hit for t in group for hit in t.effects_found],
            [id in (t.selected or ()) for t in with_selection for id in t.concealed],
        ),
        build_rate_line(
            f"{word}: effects of {_CLEAR_EFFECT_SD:g} sd or more named",
            [t.effects_found[i] for t, i in clear],
            [t.concealed[i] in (t.selected or ()) for t, i in clear if t.selected is not None],
        ),
        build_rate_line(
            f"{word}: correct mechanisms",
            [hit for t in group for hit in t.names_right],
            [id in t.concealed for t in with_selection for id in t.selected or ()],
            ">= 90 %",
        ),
    ]
    recall, precision = lines[1].rate, lines[2].rate
    if recall and precision and recall.total and precision.total and recall.share + precision.share > 0:
        f1 = 2 * recall.share * precision.share / (recall.share + precision.share)
        lines.append(
            TableLine(
                f"{word}: F1 (effects of {_CLEAR_EFFECT_SD:g} sd or more)", recall, f"{f1:.2f}", "", ">= 0.85"
            )
        )
    return lines


def compute_reliability(trials: Sequence[Trial]) -> list[tuple[float, Rate]]:
    """Return for each bin the mean reported probability, and the rate of right mechanisms."""
    pairs = [
        (p, hit)
        for t in trials
        if t.stage == "all" and not t.error
        for p, hit in zip(t.probabilities, t.names_right, strict=True)
    ]
    out = []
    for low, high in pairwise(_PROBABILITY_EDGES):
        last = high == _PROBABILITY_EDGES[-1]
        bin_pairs = [(p, hit) for p, hit in pairs if low <= p and (p < high or last)]
        if bin_pairs:
            out.append(
                (float(np.mean([p for p, _ in bin_pairs])), Rate.from_outcomes(hit for _, hit in bin_pairs))
            )
    return out


def compute_coverage(trials: Sequence[Trial], own: bool, same_model: bool = True) -> Rate:
    """Return the coverage of 90 % intervals of parameters.

    Args:
        trials: the trials.
        own: whether to count the baseline's parameters instead of the mechanisms'.
        same_model: whether to count only models with the same free parameters as the true one.
    """
    numbers = [
        n
        for t in trials
        for n in t.parameters
        if (n.name.partition(".")[0] in ("muscle", "thread")) == own
        and (n.same or not same_model)
        and n.sd > 0
    ]
    return Rate.from_outcomes(abs(n.value - n.true) <= _NORMAL_QUANTILE_95 * n.sd for n in numbers)


def _tabulate_quantities(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the lines on probabilities, intervals, held-out errors and located regions."""
    full_trials = [t for t in trials if t.stage == "all" and not t.error]
    effect_trials = [t for t in full_trials if t.kind in ("single", "pair", "triple")]
    lines = []
    for mean, rate in compute_reliability(full_trials):
        lines.append(TableLine(f"mechanisms with a mean probability of {mean:.3f}: correct", rate, str(rate)))
    for word, own in (
        ("parameters of correct mechanisms", False),
        ("parameters of the baseline, if all named mechanisms are correct", True),
    ):
        rate = compute_coverage(effect_trials, own)
        lines.append(
            TableLine(
                f"90 % intervals that contain the true value: {word}", rate, str(rate), "", "85 to 95 %"
            )
        )
    stiffness_estimates = [
        n for t in effect_trials for n in t.parameters if n.name.startswith("thread.") and n.same and n.sd > 0
    ]
    rate = Rate.from_outcomes(
        abs(n.value - n.true) <= _NORMAL_QUANTILE_95 * n.sd for n in stiffness_estimates
    )
    lines.append(
        TableLine(
            "90 % intervals that contain the true value: thread stiffness", rate, str(rate), "", "85 to 95 %"
        )
    )
    scored_trials = [t for t in effect_trials if "force" in t.after]
    lines.append(
        build_rate_line(
            f"held-out force error at most {MAX_ERROR_NOISE_RATIO:g} times the noise",
            [t.after["force"] <= MAX_ERROR_NOISE_RATIO for t in scored_trials],
            [
                t.selected_after <= MAX_ERROR_NOISE_RATIO
                for t in scored_trials
                if t.selected_after is not None
            ],
            "all",
        )
    )
    lines += _tabulate_medians(scored_trials)
    regions = [t for t in effect_trials if t.iou is not None]
    if regions:
        blind, mean_overlap = (np.mean([getattr(t, word) for t in regions]) for word in ("iou_blind", "iou"))
        error = np.std([t.iou for t in regions if t.iou is not None]) / np.sqrt(len(regions))
        text = f"{mean_overlap:.2f} ± {error:.2f}; whole recording {blind:.2f}"
        lines.append(TableLine("located region: mean overlap with a true region", None, text, "", ">= 0.75"))
    return [line for line in lines if line.rate is None or line.rate.total]


def _tabulate_medians(scores: Sequence[Trial]) -> list[TableLine]:
    columns = {
        "baseline": [t.before["force"] for t in scores],
        "with mechanisms": [t.after["force"] for t in scores],
        "selected by BIC": [t.selected_after for t in scores if t.selected_after is not None],
        "Gaussian process": [t.curve_after for t in scores if t.curve_after is not None],
    }
    text = {word: f"{np.median(v):.2f} ({np.quantile(v, 0.9):.2f})" for word, v in columns.items() if len(v)}
    own_models = ("baseline", "with mechanisms")
    pamjax_text = ", ".join(f"{word} {text[word]}" for word in own_models if word in text)
    common_practice_text = ", ".join(f"{word} {v}" for word, v in text.items() if word not in own_models)
    label = "held-out force error over noise: median (90 % quantile)"
    return [TableLine(label, None, pamjax_text, common_practice_text)] if text else []


def tabulate_trials(trials: Sequence[Trial]) -> list[TableLine]:
    """Return all table lines of the trials."""
    failed_trials = [t for t in trials if t.error]
    lines = [*tabulate_false_alarms(trials), *tabulate_recovery(trials)]
    if any(t.stage == "all" and t.kind != "nothing" for t in trials):
        lines += _tabulate_quantities(trials)
    if failed_trials:
        rate = Rate(len(failed_trials), len(trials))
        lines.append(TableLine(f"recordings without a diagnosis ({failed_trials[0].error})", rate, str(rate)))
    return lines
