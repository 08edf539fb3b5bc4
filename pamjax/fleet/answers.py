"""Answers about a fleet: distributions over specimens, outliers, benches, drift, and unexplained misfit."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pamjax.fleet.common_prior import extract_estimates, has_common_prior
from pamjax.fleet.contrast import Slope, fit_slope
from pamjax.fleet.fleet import Fleet
from pamjax.fleet.frames import select_rows
from pamjax.fleet.frequency import BENCH_P_VALUE, BenchFrequency, count_limits, count_mechanisms
from pamjax.fleet.pooling import MIN_SPECIMENS, PooledNumber, pool_estimates
from pamjax.fleet.unexplained import UnexplainedSummary, summarise_unexplained
from pamjax.model.parameters import LENGTH_ERROR_PREFIX

#: Largest p-value of a drift, after a correction for the number of distributions.
DRIFT_P_VALUE = 0.05
#: Days of a year, the unit of a drift with time.
DAYS_PER_YEAR = 365.25


@dataclass(frozen=True, eq=False)
class NumberDistribution:
    """Distribution of one number over the specimens of one type.

    Attributes:
        type: type of the muscle.
        name, unit: the number and its display unit.
        cases: names of the cases, in the order of the arrays in `pooled`.
        pooled: the distribution.
        shares_prior: whether a prior that all specimens share was taken out.
        left_out: number of specimens without a usable estimate.
        benches: by bench, difference of its specimens to all others.
        deviating_benches: benches that differ, with a Bonferroni correction over benches and distributions.
        order: (n,) date or serial number of each case, NaN if not stated; None without any order.
        order_name: "date" (years), "serial number", or "" without any.
        drift: change for one unit of `order`; None if it cannot be estimated.
        drifts: whether the drift is significant, with a Bonferroni correction over distributions.
    """

    type: str
    name: str
    unit: str
    cases: tuple[str, ...]
    pooled: PooledNumber
    shares_prior: bool
    left_out: int
    benches: dict[str, Slope]
    deviating_benches: tuple[str, ...]
    order: np.ndarray | None
    order_name: str
    drift: Slope | None
    drifts: bool


@dataclass(frozen=True, eq=False)
class FleetAnswers:
    """Answers about a fleet.

    Attributes:
        distributions: one for each type and number with enough specimens.
        mechanisms: frequency of each identified mechanism.
        limits: frequency of each number that is at its limit.
        unexplained: what remains unexplained.
    """

    distributions: tuple[NumberDistribution, ...]
    mechanisms: tuple[BenchFrequency, ...]
    limits: tuple[BenchFrequency, ...]
    unexplained: UnexplainedSummary


def analyse_fleet(fleet: Fleet) -> FleetAnswers:
    """Return the answers about a fleet from its tables."""
    groups = list(_list_groups(fleet))
    bench_count = max(len(set(fleet.cases["bench"].dropna())), 1)
    distributions = [_build_distribution(fleet, *group, len(groups), bench_count) for group in groups]
    return FleetAnswers(
        tuple(distributions),
        tuple(count_mechanisms(fleet.cases, fleet.mechanisms)),
        tuple(count_limits(fleet.cases, fleet.numbers)),
        summarise_unexplained(fleet.cases, fleet.regions),
    )


def _list_groups(fleet: Fleet) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Yield type, name and rows of each number with enough usable estimates."""
    numbers = select_rows(fleet.numbers, fleet.numbers["source"] == "fit")
    if numbers.empty:
        numbers = select_rows(fleet.numbers, fleet.numbers["source"] == "diagnose")
    types = dict(zip(fleet.cases["case"], fleet.cases["type"].fillna(""), strict=True))
    places: dict[tuple[str, str], list[int]] = {}
    for k, (case, name) in enumerate(zip(numbers["case"], numbers["name"], strict=True)):
        # The error of one length setting is no property of a specimen.
        if not name.startswith(LENGTH_ERROR_PREFIX):
            places.setdefault((types[case], name), []).append(k)
    for (kind, name), rows in sorted(places.items()):
        table = numbers.iloc[rows]
        if len(extract_estimates(table)) >= MIN_SPECIMENS:
            yield kind, name, table


def _build_distribution(
    fleet: Fleet, kind: str, name: str, table: pd.DataFrame, group_count: int, bench_count: int
) -> NumberDistribution:
    estimates = extract_estimates(table)
    cases = fleet.cases.set_index("case").loc[estimates["case"]]
    value, sd = estimates["value"].to_numpy(), estimates["sd"].to_numpy()
    benches = _compare_benches(value, sd, cases["bench"])
    order_name, order = find_order(cases)
    drift = None
    if order is not None:
        stated = np.isfinite(order)
        drift = fit_slope(value[stated], sd[stated], order[stated])
    return NumberDistribution(
        type=kind,
        name=name,
        unit=str(table["unit"].iloc[0]),
        cases=tuple(estimates["case"]),
        pooled=pool_estimates(value, sd),
        shares_prior=has_common_prior(table),
        left_out=len(table) - len(estimates),
        benches=benches,
        deviating_benches=_select_benches(benches, group_count * bench_count),
        order=order,
        order_name=order_name,
        drift=drift,
        drifts=drift is not None and drift.p_value * group_count < DRIFT_P_VALUE,
    )


def _compare_benches(value: np.ndarray, sd: np.ndarray, bench: pd.Series) -> dict[str, Slope]:
    slopes = {}
    for name in sorted(set(bench.dropna())):
        slope = fit_slope(value, sd, (bench == name).fillna(False).to_numpy(float))
        if slope is not None:
            slopes[str(name)] = slope
    return slopes


def _select_benches(benches: dict[str, Slope], comparisons: int) -> tuple[str, ...]:
    names = [name for name, slope in benches.items() if slope.p_value * comparisons < BENCH_P_VALUE]
    # With two benches both differ alike, and one sentence is enough.
    return tuple(names[:1] if len(benches) == 2 else names)


def find_order(cases: pd.DataFrame) -> tuple[str, np.ndarray | None]:
    """Return the name of the order of cases and its values: dates in years, else serial numbers.

    Args:
        cases: rows of `Fleet.cases`.
    """
    if np.count_nonzero(cases["date"].notna()) > 1:
        days = pd.to_datetime(cases["date"])
        return "date", ((days - pd.Timestamp("1970-01-01")) / pd.Timedelta(days=DAYS_PER_YEAR)).to_numpy(
            float
        )
    serials = [_read_serial_number(serial) for serial in cases["serial"]]
    if np.isfinite(serials).sum() > 1:
        return "serial number", np.array(serials)
    return "", None


def _read_serial_number(serial: Any) -> float:
    """Return the last whole number of a serial number, as 12 of "A-0012"; NaN without one."""
    digits = re.findall(r"\d+", "" if pd.isna(serial) else str(serial))
    return float(digits[-1]) if digits else float("nan")
