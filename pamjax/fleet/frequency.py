"""How often each mechanism is identified, in all recordings and on each bench."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd
from scipy import stats

from pamjax.fleet.frames import select_rows

#: Largest p-value at which a bench differs, after a correction for the number of comparisons.
BENCH_P_VALUE = 0.05


@dataclass(frozen=True)
class MechanismFrequency:
    """Number of recordings in which a mechanism is identified.

    Attributes:
        id: the mechanism.
        count, total: recordings with the mechanism, and diagnosed recordings.
        interval: exact 95 % interval of the share (Clopper and Pearson).
        by_bench: count and total of each bench.
        p_values: by bench, Fisher's exact test of this bench against all others.
        deviating_benches: benches that differ, with a Bonferroni correction over benches and mechanisms.
    """

    id: str
    count: int
    total: int
    interval: tuple[float, float]
    by_bench: dict[str, tuple[int, int]]
    p_values: dict[str, float]
    deviating_benches: tuple[str, ...]


def count_mechanisms(cases: pd.DataFrame, mechanisms: pd.DataFrame) -> list[MechanismFrequency]:
    """Return the frequency of each identified mechanism, most frequent first.

    Args:
        cases: `Fleet.cases`; only diagnosed ones count.
        mechanisms: `Fleet.mechanisms`.
    """
    diagnosed = select_rows(cases, cases["misfit_p_value"].notna())
    benches = {str(case): bench for case, bench in zip(diagnosed["case"], diagnosed["bench"], strict=True)}
    names = sorted({str(bench) for bench in benches.values() if not pd.isna(bench)})
    affected = {
        str(mechanism): {str(case) for case in table["case"]} for mechanism, table in mechanisms.groupby("id")
    }
    comparisons = max(len(affected) * len(names), 1)
    counts = [
        _count_mechanism(name, members, benches, names, comparisons) for name, members in affected.items()
    ]
    return sorted(counts, key=lambda frequency: (-frequency.count, frequency.id))


def _count_mechanism(
    name: str, affected: set[str], benches: dict[str, str], names: list[str], comparisons: int
) -> MechanismFrequency:
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
        # With two benches both deviate alike; the one with more cases of the mechanism is reported.
        deviating = (max(names, key=lambda bench: by_bench[bench][0] / by_bench[bench][1]),)
    return MechanismFrequency(
        name, count, total, (float(interval.low), float(interval.high)), by_bench, p_values, deviating
    )
