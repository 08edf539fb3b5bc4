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

#: Effect, in noise standard deviations, from which it is obvious, and from which pairs and triples count.
OBVIOUS_EFFECT_SD, CLEAR_EFFECT_SD = 8.0, 5.0
#: 90 % intervals reach so many standard deviations.
NORMAL_QUANTILE_95 = 1.6449
#: Held-out error over noise that counts as down to the noise.
MAX_ERROR_NOISE_RATIO = 1.15
#: Edges of the stated probabilities that are held against how often they were right.
PROBABILITY_EDGES = (0.5, 0.8, 0.95, 0.995, 1.0)


def tabulate_false_alarms(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the false-alarm lines for recordings without effects, by stage and correlation."""
    lines = []
    nothing = [t for t in trials if t.kind == "nothing" and not t.error]
    for stage, correlation in dict.fromkeys((t.stage, t.correlation) for t in nothing):
        group = [t for t in nothing if (t.stage, t.correlation) == (stage, correlation)]
        p = [t.p_value for t in group]
        hits_by_word = {"detected (p < 0.01)": [t.detected for t in group]}
        if stage == "all":
            hits_by_word |= {
                "named": [bool(t.named) for t in group],
                "unexplained": [t.unexplained for t in group],
                "an alarm of any kind": [t.is_alarm for t in group],
            }
        where = f"noise {correlation:g}, {'scoring stage' if stage == 'score' else 'whole pipeline'}"
        for word, hits in hits_by_word.items():
            rate = Rate.from_outcomes(hits)
            usual = ""
            if word == "named":
                asked = [t for t in group if t.selected is not None]
                usual = str(Rate.from_outcomes(bool(t.selected) for t in asked)) if asked else ""
            lines.append(
                TableLine(
                    f"{where}: {word}", rate, f"{rate}; at most {rate.upper_limit:.1%}", usual, "at most 2 %"
                )
            )
        test = kstest(p, "uniform")
        below = ", ".join(f"{np.mean(np.array(p) < edge):.3f} below {edge:g}" for edge in (0.05, 0.1, 0.5))
        text = f"p = {test.pvalue:.2g} (distance {test.statistic:.3f}); {below}"
        lines.append(
            TableLine(f"{where}: are p-values uniform (Kolmogorov-Smirnov)", None, text, "", "uniform")
        )
    return lines


def tabulate_recovery(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the lines on identified injected effects and on wrongly identified mechanisms."""
    some = [t for t in trials if t.stage == "all" and not t.error and t.kind in ("single", "pair", "triple")]
    asked = [t for t in some if t.selected is not None]
    single, several = [t for t in some if t.kind == "single"], [t for t in some if t.kind != "single"]
    lines = []
    for word, low, high, target in (
        ("just detectable (3 to 8 sd)", 0.0, OBVIOUS_EFFECT_SD, ">= 80 %"),
        ("obvious (8 sd and more)", OBVIOUS_EFFECT_SD, np.inf, ">= 95 %"),
    ):
        sized = [t for t in single if low <= t.sizes[0] < high]
        lines.append(
            build_rate_line(
                f"single, {word}: first name right",
                [bool(t.names_right) and t.names_right[0] for t in sized],
                [_is_first_right(t) for t in sized if t.selected is not None],
                target,
            )
        )
        lines.append(
            build_rate_line(
                f"single, {word}: exactly that and nothing besides",
                [t.is_exact for t in sized],
                [set(t.selected or ()) == set(t.concealed) for t in sized if t.selected is not None],
            )
        )
    for word, group in (("single", single), ("pairs and triples", several)):
        lines += _tabulate_names(word, group)
    lines.append(
        build_rate_line(
            "pairs and triples: exactly the set",
            [t.is_exact for t in several],
            [set(t.selected or ()) == set(t.concealed) for t in several if t.selected is not None],
        )
    )
    outside = [t for t in trials if t.kind == "outside" and t.stage == "all" and not t.error]
    with_baselines = [t for t in outside if t.selected is not None]
    lines.append(
        build_rate_line(
            "outside the catalogue: unexplained", [t.unexplained for t in outside], None, ">= 90 %"
        )
    )
    lines.append(
        build_rate_line(
            "outside the catalogue: given a name",
            [bool(t.named) for t in outside],
            [bool(t.selected) for t in with_baselines],
            "<= 10 %",
        )
    )
    lines.append(
        build_rate_line(
            "one to three effects: something said to be unexplained", [t.unexplained for t in some]
        )
    )
    offered = [(t, tie) for t in some for ties in t.ties for tie in ties]
    real = [any((id, tie) in t.stand_ins for id in t.concealed) for t, tie in offered]
    lines.append(build_rate_line("ids offered as ties that truly are", real))
    return [line for line in lines if line.rate and line.rate.total] if asked or some or outside else []


def _is_first_right(t: Trial) -> bool:
    return bool(t.selected) and (t.selected or ("",))[0] in t.concealed


def _tabulate_names(word: str, group: Sequence[Trial]) -> list[TableLine]:
    """Return recall of all effects and of clear ones, precision and F1."""
    asked = [t for t in group if t.selected is not None]
    clear = [(t, i) for t in group for i, size in enumerate(t.sizes) if size >= CLEAR_EFFECT_SD]
    lines = [
        build_rate_line(
            f"{word}: effects named",
            [hit for t in group for hit in t.effects_found],
            [id in (t.selected or ()) for t in asked for id in t.concealed],
        ),
        build_rate_line(
            f"{word}: effects of {CLEAR_EFFECT_SD:g} sd and more named",
            [t.effects_found[i] for t, i in clear],
            [t.concealed[i] in (t.selected or ()) for t, i in clear if t.selected is not None],
        ),
        build_rate_line(
            f"{word}: names that are right",
            [hit for t in group for hit in t.names_right],
            [id in t.concealed for t in asked for id in t.selected or ()],
            ">= 90 %",
        ),
    ]
    recall, precision = lines[1].rate, lines[2].rate
    if recall and precision and recall.total and precision.total and recall.share + precision.share > 0:
        f1 = 2 * recall.share * precision.share / (recall.share + precision.share)
        lines.append(
            TableLine(
                f"{word}: F1 (effects of {CLEAR_EFFECT_SD:g} sd and more)", recall, f"{f1:.2f}", "", ">= 0.85"
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
    for low, high in pairwise(PROBABILITY_EDGES):
        last = high == PROBABILITY_EDGES[-1]
        some = [(p, hit) for p, hit in pairs if low <= p and (p < high or last)]
        if some:
            out.append((float(np.mean([p for p, _ in some])), Rate.from_outcomes(hit for _, hit in some)))
    return out


def compute_coverage(trials: Sequence[Trial], own: bool, same: bool = True) -> Rate:
    """Return the coverage of 90 % intervals of parameters.

    Args:
        trials: the trials.
        own: whether to count the baseline's parameters instead of the mechanisms'.
        same: whether to count only models with the same free parameters as the true one.
    """
    numbers = [
        n
        for t in trials
        for n in t.numbers
        if (n.name.partition(".")[0] in ("muscle", "thread")) == own and (n.same or not same) and n.sd > 0
    ]
    return Rate.from_outcomes(abs(n.value - n.true) <= NORMAL_QUANTILE_95 * n.sd for n in numbers)


def tabulate_quantities(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the lines on probabilities, intervals, held-out errors and located boxes."""
    some = [t for t in trials if t.stage == "all" and not t.error]
    real = [t for t in some if t.kind in ("single", "pair", "triple")]
    lines = []
    for mean, rate in compute_reliability(some):
        lines.append(TableLine(f"names given with probability {mean:.3f} on average: right", rate, str(rate)))
    for word, own in (("numbers of right names", False), ("baseline's numbers, names exactly right", True)):
        rate = compute_coverage(real, own)
        lines.append(
            TableLine(f"90 % intervals that hold the truth: {word}", rate, str(rate), "", "85 to 95 %")
        )
    stiff = [n for t in real for n in t.numbers if n.name.startswith("thread.") and n.same and n.sd > 0]
    rate = Rate.from_outcomes(abs(n.value - n.true) <= NORMAL_QUANTILE_95 * n.sd for n in stiff)
    lines.append(
        TableLine("90 % intervals that hold the truth: threads' stiffness", rate, str(rate), "", "85 to 95 %")
    )
    scores = [t for t in real if "force" in t.after]
    lines.append(
        build_rate_line(
            f"held-out force down to {MAX_ERROR_NOISE_RATIO:g} of its noise",
            [t.after["force"] <= MAX_ERROR_NOISE_RATIO for t in scores],
            [t.selected_after <= MAX_ERROR_NOISE_RATIO for t in scores if t.selected_after is not None],
            "all",
        )
    )
    lines += _tabulate_medians(scores)
    boxes = [t for t in real if t.iou is not None]
    if boxes:
        blind, mean_overlap = (np.mean([getattr(t, word) for t in boxes]) for word in ("iou_blind", "iou"))
        error = np.std([t.iou for t in boxes if t.iou is not None]) / np.sqrt(len(boxes))
        text = f"{mean_overlap:.2f} ± {error:.2f}; all of the recording {blind:.2f}"
        lines.append(TableLine("located box: mean overlap with a true one", None, text, "", ">= 0.75"))
    return [line for line in lines if line.rate is None or line.rate.total]


def _tabulate_medians(scores: Sequence[Trial]) -> list[TableLine]:
    columns = {
        "baseline": [t.before["force"] for t in scores],
        "named": [t.after["force"] for t in scores],
        "selected by BIC": [t.selected_after for t in scores if t.selected_after is not None],
        "Gaussian process": [t.curve_after for t in scores if t.curve_after is not None],
    }
    text = {word: f"{np.median(v):.2f} ({np.quantile(v, 0.9):.2f})" for word, v in columns.items() if len(v)}
    mine = ", ".join(f"{word} {text[word]}" for word in ("baseline", "named") if word in text)
    usual = ", ".join(f"{word} {v}" for word, v in text.items() if word not in ("baseline", "named"))
    what = "held-out force error over its noise: median (nine in ten below)"
    return [TableLine(what, None, mine, usual)] if text else []


def tabulate_trials(trials: Sequence[Trial]) -> list[TableLine]:
    """Return all table lines of the trials."""
    failed = [t for t in trials if t.error]
    lines = [*tabulate_false_alarms(trials), *tabulate_recovery(trials)]
    if any(t.stage == "all" and t.kind != "nothing" for t in trials):
        lines += tabulate_quantities(trials)
    if failed:
        rate = Rate(len(failed), len(trials))
        lines.append(TableLine(f"recordings without a verdict ({failed[0].error})", rate, str(rate)))
    return lines
