"""How often a mechanism is identified, or a number is at its limit: in all recordings and on each bench."""

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
    """Number of recordings in which a mechanism is identified, or a number is at its limit.

    Attributes:
        id: the mechanism or the number.
        count, total: affected recordings, and all diagnosed or fitted ones.
        interval: exact 95 % interval of the share (Clopper and Pearson).
        by_bench: count and total of each bench.
        p_values: by bench, Fisher's exact test of this bench against all others.
        deviating_benches: benches that differ, with a Bonferroni correction over benches and ids.
    """

    id: str
    count: int
    total: int
    interval: tuple[float, float]
    by_bench: dict[str, tuple[int, int]]
    p_values: dict[str, float]
    deviating_benches: tuple[str, ...]


def count_mechanisms(cases: pd.DataFrame, mechanisms: pd.DataFrame) -> list[BenchFrequency]:
    """Return the frequency of each identified mechanism, most frequent first.

    Args:
        cases: `Fleet.cases`; only diagnosed ones count.
        mechanisms: `Fleet.mechanisms`.
    """
    diagnosed = select_rows(cases, cases["misfit_p_value"].notna())
    affected = {
        str(mechanism): {str(case) for case in table["case"]} for mechanism, table in mechanisms.groupby("id")
    }
    return _count_all(diagnosed, affected)


def count_limits(cases: pd.DataFrame, numbers: pd.DataFrame) -> list[BenchFrequency]:
    """Return how often each number of a fit is at its limit, most frequent first.

    A wrong gauge may drive a number to its limit on one bench.

    Args:
        cases, numbers: tables of a `Fleet`.
    """
    fitted = select_rows(cases, cases["converged"].notna())
    is_fit = numbers["source"] == "fit"
    at_limit = select_rows(numbers, is_fit & numbers["at_limit"].fillna(False).astype(bool))
    affected: dict[str, set[str]] = {}
    for case, name in zip(at_limit["case"], at_limit["name"], strict=True):
        affected.setdefault(str(name), set()).add(str(case))
    return _count_all(fitted, affected)


def _count_all(cases: pd.DataFrame, affected: dict[str, set[str]]) -> list[BenchFrequency]:
    """Return the frequency of each id among cases, most frequent first."""
    benches = {str(case): bench for case, bench in zip(cases["case"], cases["bench"], strict=True)}
    names = sorted({str(bench) for bench in benches.values() if not pd.isna(bench)})
    comparisons = max(len(affected) * len(names), 1)
    counts = [_count_one_id(name, members, benches, names, comparisons) for name, members in affected.items()]
    return sorted(counts, key=lambda frequency: (-frequency.count, frequency.id))


def _count_one_id(
    name: str, affected: set[str], benches: dict[str, str], names: list[str], comparisons: int
) -> BenchFrequency:
    total, count = len(benches), len(affected & set(benches))
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
        name, count, total, (float(interval.low), float(interval.high)), by_bench, p_values, deviating
    )
