"""Answers about a fleet: distributions over specimens, outliers, benches, drift, and unexplained misfit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pamjax.fleet.common_prior import extract_estimates
from pamjax.fleet.copies import drop_copies, find_copies
from pamjax.fleet.fleet import Fleet
from pamjax.fleet.frames import select_rows
from pamjax.fleet.frequency import BENCH_P_VALUE, BenchFrequency, count_limits, count_mechanisms
from pamjax.fleet.pooling import MIN_SPECIMENS, PooledParameter, pool_estimates
from pamjax.fleet.regression import Slope, fit_slope
from pamjax.fleet.specimens import SpecimenEstimates, combine_recordings, index_specimens
from pamjax.fleet.unexplained import UnexplainedSummary, summarise_unexplained
from pamjax.fleet.validation import ValidationSummary, summarise_validation
from pamjax.model.parameters import LENGTH_ERROR_PREFIX

#: Largest p-value of a drift, after a correction for the number of distributions.
_DRIFT_P_VALUE = 0.05
#: Days of a year, the unit of a drift with time.
DAYS_PER_YEAR = 365.25


@dataclass(frozen=True, eq=False)
class ParameterDistribution:
    """Distribution of one parameter over the specimens of one type.

    Attributes:
        type: type of the muscle.
        name, unit: the parameter and its display unit.
        estimates: estimate of each specimen, in the order of the arrays in `pooled`.
        pooled: the distribution.
        shares_prior: whether a prior that several specimens share was removed.
        unusable_count: number of recordings without a usable estimate.
        benches: by bench, difference of its specimens to all others.
        deviating_benches: benches that differ, with a Bonferroni correction over benches and distributions.
        order: (n,) date or serial number of each specimen, NaN if not stated; None without any order.
        order_name: "date" (years), "serial number", or "" without any.
        drift: change for one unit of `order`; None if it cannot be estimated.
        drifts: whether the drift is significant, with a Bonferroni correction over distributions.
    """

    type: str
    name: str
    unit: str
    estimates: SpecimenEstimates
    pooled: PooledParameter
    shares_prior: bool
    unusable_count: int
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
        distributions: one for each type and parameter with enough specimens.
        mechanisms: frequency of each identified mechanism.
        limits: frequency of each parameter that is at its limit.
        unexplained: what remains unexplained.
        validation: test of one model on all recordings.
        unconverged: names of the recordings whose posterior did not converge.
        copies: groups of cases with identical inputs; the first of each counts.
    """

    distributions: tuple[ParameterDistribution, ...]
    mechanisms: tuple[BenchFrequency, ...]
    limits: tuple[BenchFrequency, ...]
    unexplained: UnexplainedSummary
    validation: ValidationSummary
    unconverged: tuple[str, ...] = ()
    copies: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class _ParameterGroup:
    """Usable estimates of one parameter of one type, and the rows of their cases in the same order."""

    type: str
    name: str
    unit: str
    cases: pd.DataFrame
    estimates: SpecimenEstimates
    shares_prior: bool
    unusable_count: int


def analyse_fleet(fleet: Fleet) -> FleetAnswers:
    """Return the answers about a fleet from its tables; identical cases count once."""
    copies = find_copies(fleet)
    fleet = drop_copies(fleet, copies)
    groups = _list_groups(fleet)
    bench_count = max(len(set(fleet.cases["bench"].dropna())), 1)
    return FleetAnswers(
        tuple(_build_distribution(group, len(groups), bench_count) for group in groups),
        tuple(count_mechanisms(fleet.cases, fleet.mechanisms)),
        tuple(count_limits(fleet.cases, fleet.numbers)),
        summarise_unexplained(fleet.cases, fleet.regions),
        summarise_validation(fleet.cases),
        tuple(select_rows(fleet.cases, ~fleet.cases["sample_converged"].fillna(True))["case"]),
        copies,
    )


def _list_groups(fleet: Fleet) -> list[_ParameterGroup]:
    """Return the parameters with usable estimates of enough specimens, by type and name."""
    parameters = _select_parameters(fleet)
    specimens = index_specimens(fleet.cases)
    positions = {case: k for k, case in enumerate(fleet.cases["case"])}
    parameters = parameters.assign(specimen=[specimens[case] for case in parameters["case"]])
    types = dict(zip(fleet.cases["case"], fleet.cases["type"].fillna(""), strict=True))
    places: dict[tuple[str, str], list[int]] = {}
    for k, (case, name) in enumerate(zip(parameters["case"], parameters["name"], strict=True)):
        # Neither the error of one length level nor the noise of a sensor is a property of a specimen.
        if not name.startswith((LENGTH_ERROR_PREFIX, "noise.")):
            places.setdefault((types[case], name), []).append(k)
    groups = []
    for (kind, name), rows in sorted(places.items()):
        table = parameters.iloc[rows]
        usable, shares_prior = extract_estimates(table)
        case_rows = fleet.cases.iloc[[positions[case] for case in usable["case"]]]
        if len(set(usable["specimen"])) >= MIN_SPECIMENS:
            estimates, unit = combine_recordings(usable, case_rows), str(table["unit"].iloc[0])
            unusable_count = len(table) - len(usable)
            groups.append(
                _ParameterGroup(kind, name, unit, case_rows, estimates, shares_prior, unusable_count)
            )
    return groups


def _select_parameters(fleet: Fleet) -> pd.DataFrame:
    """Return the rows of `Fleet.numbers` to compare: of fits, else of posteriors, else of diagnoses.

    A posterior does not state limits, and a diagnosis no priors. Posteriors without convergence are left out.
    """
    sources = set(fleet.numbers["source"])
    source = next((name for name in ("fit", "sample", "diagnose") if name in sources), "fit")
    parameters = select_rows(fleet.numbers, fleet.numbers["source"] == source)
    if source != "sample":
        return parameters
    converged = set(select_rows(fleet.cases, fleet.cases["sample_converged"])["case"])
    return select_rows(parameters, [case in converged for case in parameters["case"]])


def _build_distribution(group: _ParameterGroup, group_count: int, bench_count: int) -> ParameterDistribution:
    estimates = group.estimates
    benches = _compare_benches(estimates, group.cases)
    order_name, order = _find_order(group.cases)
    drift = None
    if order is not None:
        order = estimates.average(order)
        stated = np.isfinite(order)
        shares = _compute_bench_shares(estimates, group.cases).values()
        others = np.array([share[stated] for share in shares]).reshape(-1, stated.sum()).T
        drift = fit_slope(estimates.value[stated], estimates.sd[stated], order[stated], others)
    return ParameterDistribution(
        type=group.type,
        name=group.name,
        unit=group.unit,
        estimates=estimates,
        pooled=pool_estimates(estimates.value, estimates.sd, group_count),
        shares_prior=group.shares_prior,
        unusable_count=group.unusable_count,
        benches=benches,
        deviating_benches=_select_benches(benches, group_count * bench_count),
        order=order,
        order_name=order_name,
        drift=drift,
        drifts=drift is not None and drift.p_value * group_count < _DRIFT_P_VALUE,
    )


def _compare_benches(estimates: SpecimenEstimates, cases: pd.DataFrame) -> dict[str, Slope]:
    """Return the difference of each bench."""
    slopes = {
        name: fit_slope(estimates.value, estimates.sd, share)
        for name, share in _compute_bench_shares(estimates, cases).items()
    }
    return {name: slope for name, slope in slopes.items() if slope is not None}


def _compute_bench_shares(estimates: SpecimenEstimates, cases: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the share of each specimen's recordings on each bench, (n,) from 0 to 1."""
    benches = cases["bench"].tolist()
    return {
        str(name): estimates.average(
            np.array([not pd.isna(bench) and bench == name for bench in benches], float)
        )
        for name in sorted({bench for bench in benches if not pd.isna(bench)})
    }


def _select_benches(benches: dict[str, Slope], comparisons: int) -> tuple[str, ...]:
    names = [name for name, slope in benches.items() if slope.p_value * comparisons < BENCH_P_VALUE]
    # With two benches both differ alike, and one sentence is enough.
    return tuple(names[:1] if len(benches) == 2 else names)


def _find_order(cases: pd.DataFrame) -> tuple[str, np.ndarray | None]:
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
