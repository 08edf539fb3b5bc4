"""Rates with exact binomial intervals, and the table lines of the simulation study.

Two-sided intervals are those of Clopper and Pearson at 95 %. Upper limits of false alarms are one-sided.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd


@dataclass(frozen=True)
class Rate:
    """A number of hits in a total number of outcomes."""

    hits: int
    total: int

    @classmethod
    def from_outcomes(cls, outcomes: Iterable[bool]) -> Rate:
        """Return the rate of true outcomes."""
        hits = [bool(outcome) for outcome in outcomes]
        return cls(sum(hits), len(hits))

    @property
    def share(self) -> float:
        """Return hits over total; NaN without data."""
        return self.hits / self.total if self.total else float("nan")

    def compute_interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the exact two-sided interval; (0, 1) without data."""
        from scipy.stats import binomtest

        if not self.total:
            return 0.0, 1.0
        interval = binomtest(self.hits, self.total).proportion_ci(level, method="exact")
        return float(interval.low), float(interval.high)

    @property
    def upper_limit(self) -> float:
        """Return the one-sided 95 % upper limit."""
        return self.compute_interval(0.90)[1]

    def as_dict(self) -> dict[str, Any]:
        """Return hits, total, share and 95 % interval."""
        low, high = self.compute_interval()
        share = self.share if self.total else None
        return {"hits": self.hits, "of": self.total, "share": share, "low": low, "high": high}

    def __str__(self) -> str:
        if not self.total:
            return "no data"
        low, high = self.compute_interval()
        return f"{self.hits} of {self.total}: {self.share:.1%} ({low:.1%} to {high:.1%})"


@dataclass(frozen=True)
class TableLine:
    """One line of a table: a label and a rate with its interval, or another number.

    Attributes:
        label: description of the result.
        rate: rate of pamjax; None if the number is no rate.
        text: result of pamjax, as text.
        common_practice: result of common practice, or "".
        target: target value, or "".
    """

    label: str
    rate: Rate | None
    text: str
    common_practice: str = ""
    target: str = ""


def build_rate_line(
    label: str, hits: Iterable[bool], common_practice: Iterable[bool] | None = None, target: str = ""
) -> TableLine:
    """Return a table line from hits of pamjax and, optionally, of common practice."""
    rate = Rate.from_outcomes(hits)
    common_practice_text = str(Rate.from_outcomes(common_practice)) if common_practice is not None else ""
    return TableLine(label, rate, str(rate), common_practice_text, target)


def format_markdown(lines: Sequence[TableLine]) -> str:
    """Return the table in Markdown."""
    rows = [f"| {x.label} | {x.text} | {x.common_practice} | {x.target} |" for x in lines]
    return "\n".join(["| result | pamjax | common practice | target |", "|---|---|---|---|", *rows, ""])


def build_rows(lines: Sequence[TableLine]) -> list[dict[str, Any]]:
    """Return the table as a list of dictionaries."""
    return [
        {"what": x.label, "pamjax": x.text, "common_practice": x.common_practice, "aim": x.target}
        | (x.rate.as_dict() if x.rate else {})
        for x in lines
    ]


def format_text(lines: Sequence[TableLine]) -> str:
    """Return the table as text for the terminal."""
    out = []
    for line in lines:
        out.append(f"  {line.label}: {line.text}")
        if line.common_practice:
            out.append(f"      common practice: {line.common_practice}")
    return "\n".join(out)


def build_documents(lines: Sequence[TableLine]) -> dict[str, str]:
    """Return the contents of the table's files by name."""
    rows = build_rows(lines)
    return {
        "table.md": format_markdown(lines),
        "table.csv": pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"),
        "table.json": json.dumps(rows, indent=1, allow_nan=False) + "\n",
    }
