"""How often a mechanism is identified, or a parameter is at its limit: for each type and bench."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd
from scipy import stats

from pamjax.fleet.frames import select_rows

#: Largest p-value at which a bench differs, after a correction for the number of comparisons.
BENCH_P_VALUE = 0.05


@dataclass(frozen=True)
class BenchFrequency:
    """Number of recordings of one type in which a mechanism is identified, or a parameter is at its limit.

    Attributes:
        type: type of the muscle.
        id: the mechanism or the parameter.
        count, total: affected recordings, and all diagnosed or fitted ones of this type.
        interval: exact 95 % interval of the share (Clopper and Pearson).
        by_bench: count and total of each bench.
        p_values: by bench, Fisher's exact test of this bench against all others.
        deviating_benches: benches that differ, with a Bonferroni correction over types, benches and ids.
    """

    type: str
    id: str
    count: int
    total: int
    interval: tuple[float, float]
    by_bench: dict[str, tuple[int, int]]
    p_values: dict[str, float]
    deviating_benches: tuple[str, ...]


def count_mechanisms(cases: pd.DataFrame, mechanisms: pd.DataFrame) -> list[BenchFrequency]:
    """Return the frequency of each identified mechanism in each type, most frequent first.

    Args:
        cases: `Fleet.cases`; only diagnosed ones count.
        mechanisms: `Fleet.mechanisms`.
    """
    diagnosed = select_rows(cases, cases["misfit_p_value"].notna())
    affected = {
        str(mechanism): {str(case) for case in table["case"]} for mechanism, table in mechanisms.groupby("id")
    }
    return _count_all(diagnosed, affected)


def count_limits(cases: pd.DataFrame, parameters: pd.DataFrame) -> list[BenchFrequency]:
    """Return how often each parameter of a fit is at its limit in each type, most frequent first.

    A wrong gauge may drive a parameter to its limit on one bench.

    Args:
        cases: `Fleet.cases`; only fitted ones count.
        parameters: `Fleet.numbers`.
    """
    fitted = select_rows(cases, cases["converged"].notna())
    is_fit = parameters["source"] == "fit"
    at_limit = select_rows(parameters, is_fit & parameters["at_limit"].fillna(False).astype(bool))
    affected: dict[str, set[str]] = {}
    for case, name in zip(at_limit["case"], at_limit["name"], strict=True):
        affected.setdefault(str(name), set()).add(str(case))
    return _count_all(fitted, affected)


@dataclass(frozen=True)
class _TypeGroup:
    """Recordings of one type.

    Attributes:
        type: the type.
        benches: bench by recording; None if not stated.
        names: names of the benches.
        affected: affected recordings by id.
    """

    type: str
    benches: dict[str, str | None]
    names: list[str]
    affected: dict[str, set[str]]


def _count_all(cases: pd.DataFrame, affected: dict[str, set[str]]) -> list[BenchFrequency]:
    """Return the frequency of each id among the recordings of each type, most frequent first."""
    types = cases["type"].fillna("")
    groups = [_build_group(kind, select_rows(cases, types == kind), affected) for kind in sorted(set(types))]
    comparisons = max(sum(len(group.affected) * len(group.names) for group in groups), 1)
    counts = [_count_one_id(group, name, comparisons) for group in groups for name in group.affected]
    return sorted(counts, key=lambda frequency: (-frequency.count, frequency.id, frequency.type))


def _build_group(kind: str, cases: pd.DataFrame, affected: dict[str, set[str]]) -> _TypeGroup:
    benches = {
        str(case): None if pd.isna(bench) else str(bench)
        for case, bench in zip(cases["case"], cases["bench"], strict=True)
    }
    names = sorted({bench for bench in benches.values() if bench is not None})
    present = {name: members & benches.keys() for name, members in affected.items()}
    return _TypeGroup(kind, benches, names, {name: members for name, members in present.items() if members})


def _count_one_id(group: _TypeGroup, name: str, comparisons: int) -> BenchFrequency:
    benches, names, affected = group.benches, group.names, group.affected[name]
    total, count = len(benches), len(affected)
    interval = stats.binomtest(count, total).proportion_ci(0.95, "exact")
    by_bench, p_values = {}, {}
    for bench in names:
        members = {case for case, other in benches.items() if other == bench}
        inside = len(affected & members)
        by_bench[bench] = inside, len(members)
        if len(members) < total:
            table = [
                [inside, len(members) - inside],
                [count - inside, total - len(members) - count + inside],
            ]
            test: Any = stats.fisher_exact(table)
            p_values[bench] = float(test.pvalue)
    deviating = tuple(bench for bench, p in p_values.items() if p * comparisons < BENCH_P_VALUE)
    if len(names) == 2 and deviating:
        # With two benches both deviate alike; the one with more affected cases is reported.
        deviating = (max(names, key=lambda bench: by_bench[bench][0] / by_bench[bench][1]),)
    return BenchFrequency(
        group.type,
        name,
        count,
        total,
        (float(interval.low), float(interval.high)),
        by_bench,
        p_values,
        deviating,
    )
