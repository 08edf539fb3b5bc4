"""Sentences about a fleet: one finding each, the most important first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pamjax.fleet.analysis import FleetAnswers, ParameterDistribution
from pamjax.fleet.fleet import Fleet
from pamjax.fleet.frequency import BenchFrequency
from pamjax.fleet.pooling import MIN_SPECIMENS
from pamjax.fleet.store import DONE, OPEN, REFUSED, SET_ASIDE
from pamjax.text import join_words
from pamjax.units import compute_si_factor, format_count, format_estimate, format_number

#: Largest number of specimens in one sentence about outliers.
_MAX_NAMED_SPECIMENS = 5


def format_value(value: float, sd: float | None, unit: str) -> str:
    """Return a value in its display unit as text, with the digits of its sd.

    >>> format_value(83.512, 3.43, "GPa")
    '83.5 ± 3.4 GPa'
    """
    factor = compute_si_factor(unit)
    return format_estimate(value * factor, None if sd is None else sd * factor, unit)


def format_sd(sd: float, unit: str) -> str:
    """Return a standard deviation in its display unit as text with two digits."""
    return format_number(sd, 2) if unit == "1" else f"{format_number(sd, 2)} {unit}"


def list_findings(answers: FleetAnswers) -> list[str]:
    """Return the findings: differing benches, outliers, drift, unexplained misfit, failed validations."""
    findings = [
        *(line for f in answers.mechanisms for line in _format_bench_frequency(f, "identified")),
        *(line for f in answers.limits for line in _format_bench_frequency(f, "at its limit")),
        *(line for distribution in answers.distributions for line in _format_bench_differences(distribution)),
        *(line for distribution in answers.distributions for line in format_outliers(distribution)),
        *(line for distribution in answers.distributions for line in _format_drift(distribution)),
        *_format_unexplained(answers),
        *_format_missed_validations(answers),
    ]
    findings = findings or [_format_quiet_result(answers)]
    findings += [*_format_unconverged(answers), *_format_passed_validations(answers)]
    return [*findings, *map(_format_copies, answers.copies)]


def _format_quiet_result(answers: FleetAnswers) -> str:
    """Return the sentence of a fleet without a finding: nothing differs, or nothing was compared."""
    if answers.distributions:
        return "No outlier, no difference between rigs and no drift."
    return (
        f"No specimens were compared: fewer than {MIN_SPECIMENS} of one type have an estimate of the same"
        " parameter."
    )


def _format_copies(copies: tuple[str, ...]) -> str:
    """Return a sentence about cases with identical inputs."""
    return f"{join_words(copies)} have identical inputs and count as one recording."


def _format_bench_frequency(frequency: BenchFrequency, condition: str) -> Iterator[str]:
    """Yield a sentence for each bench on which a condition is more or less frequent.

    Args:
        frequency: the frequency of a mechanism, or of a parameter at its limit.
        condition: "identified" or "at its limit".
    """
    kind = f" of {frequency.type}" if frequency.type else ""
    for bench in frequency.deviating_benches:
        count, total = frequency.by_bench[bench]
        yield (
            f"{frequency.id} is {condition} in {count} of {total} recordings{kind} on rig {bench},"
            f" and in {frequency.count - count} of {frequency.total - total} of the others"
            f" (p = {frequency.p_values[bench]:.1g})."
        )


def _format_bench_differences(distribution: ParameterDistribution) -> Iterator[str]:
    """Yield a sentence for each bench whose specimens differ in a parameter."""
    for bench in distribution.deviating_benches:
        slope = distribution.benches[bench]
        direction = "higher" if slope.value > 0 else "lower"
        change = format_value(abs(slope.value), slope.sd, distribution.unit)
        yield (
            f"{name_distribution(distribution)} is {direction} on rig {bench} by {change}"
            f" (p = {slope.p_value:.1g})."
        )


def format_outliers(distribution: ParameterDistribution) -> Iterator[str]:
    """Yield a sentence about each outlier of a parameter, the farthest first."""
    pooled = distribution.pooled
    places = [int(k) for k in np.argsort(-np.abs(pooled.deviation)) if pooled.outliers[k]]
    for k in places[:_MAX_NAMED_SPECIMENS]:
        value = format_value(float(pooled.estimate[k]), float(pooled.sd[k]), distribution.unit)
        direction = "above" if pooled.deviation[k] > 0 else "below"
        yield (
            f"{distribution.estimates.names[k]} is an outlier in {name_distribution(distribution)}: {value},"
            f" {abs(pooled.deviation[k]):.1f} sd {direction} the other specimens."
        )
    if len(places) > _MAX_NAMED_SPECIMENS:
        rest = format_count(len(places) - _MAX_NAMED_SPECIMENS, "more outlier")
        yield f"{name_distribution(distribution)} has {rest}."


def _format_drift(distribution: ParameterDistribution) -> Iterator[str]:
    """Yield a sentence about a significant drift."""
    if distribution.drift is None or not distribution.drifts:
        return
    slope, unit = distribution.drift, "year" if distribution.order_name == "date" else "serial number"
    direction = "increases" if slope.value > 0 else "decreases"
    change = format_value(abs(slope.value), slope.sd, distribution.unit)
    yield (
        f"{name_distribution(distribution)} {direction} with {distribution.order_name} by {change}"
        f" per {unit} (p = {slope.p_value:.1g})."
    )


def _format_unexplained(answers: FleetAnswers) -> Iterator[str]:
    """Yield sentences about misfit that no mechanism explains."""
    summary = answers.unexplained
    if not summary.count:
        return
    like = ", ".join(f"{name} in {count}" for name, count in list(summary.likenesses.items())[:3])
    tail = f"; it resembles {like}" if like else ""
    yield f"{summary.count} of {summary.total} diagnosed recordings have unexplained misfit{tail}."
    region = summary.region
    if region is not None:
        yield (
            f"{region.cases} of them have it in {region.channel} ({region.direction}) between"
            f" {region.pressure[0]:.0f} and {region.pressure[1]:.0f} kPa,"
            f" {region.contraction[0]:.0%} to {region.contraction[1]:.0%} contracted."
        )


def _format_missed_validations(answers: FleetAnswers) -> Iterator[str]:
    """Yield a sentence about the recordings that the tested model does not predict."""
    missed, total = answers.validation.missed, answers.validation.total
    if missed:
        yield (
            f"The tested model has errors above the noise in {len(missed)} of"
            f" {format_count(total, 'recording')}: {_list_first(missed)}."
        )


def _format_passed_validations(answers: FleetAnswers) -> Iterator[str]:
    """Yield a sentence if the tested model predicts every recording."""
    missed, total = answers.validation.missed, answers.validation.total
    if total and not missed:
        recordings = "the recording" if total == 1 else f"all {total} recordings"
        yield f"The tested model predicts {recordings} to the noise."


def _format_unconverged(answers: FleetAnswers) -> Iterator[str]:
    """Yield a sentence about posteriors that are not reliable."""
    if answers.unconverged:
        count = format_count(len(answers.unconverged), "posterior")
        yield f"{count} did not converge: {_list_first(answers.unconverged)}."


def _list_first(names: Sequence[str]) -> str:
    """Return the first names of a list as text.

    >>> _list_first(["a", "b"]), _list_first(["a", "b", "c", "d", "e", "f", "g"])
    ('a and b', 'a, b, c, d, e and 2 more')
    """
    rest = len(names) - _MAX_NAMED_SPECIMENS
    return join_words([*names[:_MAX_NAMED_SPECIMENS], *([f"{rest} more"] if rest > 0 else [])])


def format_distribution(distribution: ParameterDistribution) -> str:
    """Return mean and sd between specimens of a parameter in one sentence."""
    pooled, unit = distribution.pooled, distribution.unit
    low, high = pooled.between_interval
    spread = (
        f"sd between specimens {format_sd(pooled.between_sd, unit)}"
        f" (95 % interval {format_sd(low, '1')} to {format_sd(high, unit)})"
        if pooled.between_sd > 0
        else f"no spread between specimens detected (below {format_sd(high, unit)})"
    )
    mean = format_value(pooled.mean, pooled.mean_sd, unit)
    return f"{name_distribution(distribution)}: {mean}, {spread}, {len(pooled.estimate)} specimens"


def name_distribution(distribution: ParameterDistribution) -> str:
    """Return the name of a parameter with the type of its muscles."""
    return f"{distribution.name} of {distribution.type}" if distribution.type else distribution.name


def name_frequency(frequency: BenchFrequency) -> str:
    """Return a mechanism, or a parameter at its limit, with the type of its muscles."""
    return f"{frequency.id} of {frequency.type}" if frequency.type else frequency.id


def format_states(fleet: Fleet) -> str:
    """Return how many cases are complete, refused, set aside or open."""
    counts = fleet.cases["state"].value_counts()
    parts = [
        f"{counts[state]} {label}"
        for state, label in (
            (DONE, "complete"),
            (REFUSED, "refused"),
            (SET_ASIDE, "set aside"),
            (OPEN, "not finished"),
        )
        if state in counts
    ]
    return f"{format_count(len(fleet.cases), 'case')}: {', '.join(parts)}"
