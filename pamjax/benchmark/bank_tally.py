"""Results of the bank of other forms as table lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

from pamjax.benchmark.rates import Rate, TableLine, build_rate_line
from pamjax.benchmark.tally import compute_coverage, compute_reliability
from pamjax.benchmark.trial import Trial

#: Edges of the classes of sizes, in noise standard deviations.
_SIZE_CLASS_EDGES = (2.0, 5.0, 10.0, 30.0)


def tabulate_bank(trials: Sequence[Trial]) -> list[TableLine]:
    """Return all table lines of the bank of other forms; lines without data are left out."""
    finished_trials = [t for t in trials if not t.error]
    lines = [
        *_tabulate_effects(finished_trials), *_tabulate_outside(finished_trials),
        *_tabulate_nulls(finished_trials),
        *_tabulate_claims(finished_trials), *_tabulate_details(finished_trials),
    ]  # fmt: skip
    failed_trials = [t for t in trials if t.error]
    if failed_trials:
        rate = Rate(len(failed_trials), len(trials))
        lines.append(TableLine(f"recordings without a diagnosis ({failed_trials[0].error})", rate, str(rate)))
    return [line for line in lines if line.rate is None or line.rate.total]


def _select_effect_trials(trials: Sequence[Trial]) -> list[Trial]:
    """Return the recordings with one to three mechanisms and nothing outside the library."""
    return [t for t in trials if t.concealed and not t.outside]


def _tabulate_effects(trials: Sequence[Trial]) -> list[TableLine]:
    """Return recall, precision, F1, exact sets and first mechanisms."""
    group = _select_effect_trials(trials)
    single = [t for t in group if t.kind == "single"]
    hits = [(t.forms[i] == "usual", hit) for t in group for i, hit in enumerate(t.effects_found)]
    recall = build_rate_line("recall: effects named", [hit for _, hit in hits])
    precision = build_rate_line(
        "precision: named mechanisms that are correct", [hit for t in group for hit in t.names_right]
    )
    lines = [
        recall,
        build_rate_line("recall, effects in another form", [hit for usual, hit in hits if not usual]),
        build_rate_line("recall, offsets, gains and delays", [hit for usual, hit in hits if usual]),
        precision,
    ]
    f1 = compute_f1(recall.rate, precision.rate)
    if f1 is not None:
        lines.append(TableLine("F1", None, f"{f1:.2f}"))
    return [
        *lines,
        build_rate_line("exact, one effect", [t.is_exact for t in single]),
        build_rate_line("exact, one to three effects", [t.is_exact for t in group]),
        build_rate_line("first mechanism correct", [bool(t.names_right) and t.names_right[0] for t in group]),
        build_rate_line("one to three effects: an unexplained misfit", [t.unexplained for t in group]),
    ]


def compute_f1(recall: Rate | None, precision: Rate | None) -> float | None:
    """Return the harmonic mean of recall and precision; None without data.

    >>> compute_f1(Rate(1, 2), Rate(1, 1))
    0.6666666666666666
    """
    if not recall or not precision or not recall.total:
        return None
    if not precision.total or recall.share + precision.share == 0:
        return 0.0
    return 2 * recall.share * precision.share / (recall.share + precision.share)


def _tabulate_outside(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the lines on effects outside the library, alone and together with one mechanism."""
    outside_trials, mixed_trials = ([t for t in trials if t.kind == kind] for kind in ("outside", "mixed"))
    return [
        build_rate_line("outside alone: an unexplained misfit", [t.unexplained for t in outside_trials]),
        build_rate_line("outside alone: a mechanism named", [bool(t.named) for t in outside_trials]),
        build_rate_line(
            "outside with a mechanism: an unexplained misfit", [t.unexplained for t in mixed_trials]
        ),
        build_rate_line(
            "outside with a mechanism: the mechanism named",
            [hit for t in mixed_trials for hit in t.effects_found],
        ),
        build_rate_line(
            "outside with a mechanism: named mechanisms that are correct",
            [hit for t in mixed_trials for hit in t.names_right],
        ),
    ]


def _tabulate_nulls(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the false alarms by the statement of the sensors."""
    lines = []
    for label, is_misstated in (("exact", False), ("misstated", True)):
        group = [t for t in trials if t.kind == "nothing" and t.misstated == is_misstated]
        lines += [
            build_rate_line(f"nothing concealed, {label} sensors: any alarm", [t.is_alarm for t in group]),
            build_rate_line(
                f"nothing concealed, {label} sensors: a mechanism named", [bool(t.named) for t in group]
            ),
        ]
    return lines


def _tabulate_claims(trials: Sequence[Trial]) -> list[TableLine]:
    """Return the lines on intervals, held-out errors and probabilities, of all recordings."""
    ratios = [ratio for t in trials for ratio in t.held_out_ratios]
    lines = [
        _build_line("90 % intervals of offsets, gains and delays", compute_coverage(trials, own=False)),
        build_rate_line("mechanisms that make the held-out error larger", [ratio > 1 for ratio in ratios]),
    ]
    for mean, rate in compute_reliability(trials):
        lines.append(_build_line(f"mechanisms with a mean probability of {mean:.3f}: correct", rate))
    for probability in sorted({t.unexplained_probability for t in trials if t.unexplained_probability}):
        outcomes = [bool(t.outside) for t in trials if t.unexplained_probability == probability]
        label = f"an effect outside the library with probability {probability:.3f}: present"
        lines.append(build_rate_line(label, outcomes))
    return lines


def _tabulate_details(trials: Sequence[Trial]) -> list[TableLine]:
    """Return recall by size and by mechanism, and unexplained misfit by family."""
    group = _select_effect_trials(trials)
    hits = [
        (id, size, hit)
        for t in group
        for id, size, hit in zip(t.concealed, t.sizes, t.effects_found, strict=True)
    ]
    lines = [
        build_rate_line(f"effects of {low:g} to {high:g} sd named", _select_sizes(hits, low, high))
        for low, high in pairwise(_SIZE_CLASS_EDGES)
    ]
    for id in sorted({id for id, _, _ in hits}):
        lines.append(build_rate_line(f"{id} named", [hit for other, _, hit in hits if other == id]))
    outside_trials = [t for t in trials if t.kind == "outside"]
    for family in sorted({t.outside for t in outside_trials}):
        outcomes = [t.unexplained for t in outside_trials if t.outside == family]
        lines.append(build_rate_line(f"{family}: an unexplained misfit", outcomes))
    return lines


def _select_sizes(hits: Iterable[tuple[str, float, bool]], low: float, high: float) -> list[bool]:
    # Sizes meet their targets within some percent: the outer classes are open.
    least = -1.0 if low == _SIZE_CLASS_EDGES[0] else low
    most = float("inf") if high == _SIZE_CLASS_EDGES[-1] else high
    return [hit for _, size, hit in hits if least <= size < most]


def _build_line(label: str, rate: Rate) -> TableLine:
    return TableLine(label, rate, str(rate))
