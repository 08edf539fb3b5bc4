"""Rates: so many of so many, each with its exact interval, and lines of a table that hold them.

Two-sided intervals are Clopper and Pearson's at 95 %; upper limits of false alarms are one-sided.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from scipy.stats import beta


@dataclass(frozen=True)
class Rate:
    """So many of so many."""

    hits: int
    total: int

    @classmethod
    def from_outcomes(cls, outcomes: Iterable[bool]) -> Rate:
        hits = [bool(b) for b in outcomes]
        return cls(sum(hits), len(hits))

    @property
    def share(self) -> float:
        return self.hits / self.total if self.total else float("nan")

    def compute_interval(self, level: float = 0.95) -> tuple[float, float]:
        """Exact two-sided interval."""
        tail, hits, of = (1 - level) / 2, self.hits, self.total
        low = float(beta.ppf(tail, hits, of - hits + 1)) if hits else 0.0
        high = float(beta.ppf(1 - tail, hits + 1, of - hits)) if hits < of else 1.0
        return low, high

    @property
    def upper_limit(self) -> float:
        """One-sided 95 % upper limit."""
        return self.compute_interval(0.90)[1]

    def as_dict(self) -> dict[str, Any]:
        low, high = self.compute_interval()
        share = self.share if self.total else None
        return {"hits": self.hits, "of": self.total, "share": share, "low": low, "high": high}

    def __str__(self) -> str:
        if not self.total:
            return "none to count"
        low, high = self.compute_interval()
        return f"{self.hits} of {self.total}: {self.share:.1%} ({low:.1%} to {high:.1%})"


@dataclass(frozen=True)
class TableLine:
    """One line of a table: what was counted, and a rate or a number with its interval.

    Attributes:
        label: in words.
        rate: of pamjax; None where it is no rate.
        text: what stands in the table.
        common_practice: the same of common practice, or "".
        target: what was aimed at, or "".
    """

    label: str
    rate: Rate | None
    text: str
    common_practice: str = ""
    target: str = ""


def build_rate_line(
    label: str, hits: Iterable[bool], common_practice: Iterable[bool] | None = None, target: str = ""
) -> TableLine:
    """A line from what was hit."""
    rate = Rate.from_outcomes(hits)
    common_practice_text = str(Rate.from_outcomes(common_practice)) if common_practice is not None else ""
    return TableLine(label, rate, str(rate), common_practice_text, target)


def format_markdown(lines: Sequence[TableLine]) -> str:
    """A table for a README."""
    rows = [f"| {x.label} | {x.text} | {x.common_practice} | {x.target} |" for x in lines]
    return "\n".join(["| what | pamjax | common practice | aim |", "|---|---|---|---|", *rows, ""])


def build_rows(lines: Sequence[TableLine]) -> list[dict[str, Any]]:
    """The same for programs."""
    return [
        {"what": x.label, "pamjax": x.text, "common_practice": x.common_practice, "aim": x.target}
        | (x.rate.as_dict() if x.rate else {})
        for x in lines
    ]


def format_text(lines: Sequence[TableLine]) -> str:
    """The same for a screen."""
    out = []
    for line in lines:
        out.append(f"  {line.label}: {line.text}")
        if line.common_practice:
            out.append(f"      common practice: {line.common_practice}")
    return "\n".join(out)


def build_documents(lines: Sequence[TableLine]) -> dict[str, str]:
    """The table as files, by name."""
    rows = build_rows(lines)
    return {
        "table.md": format_markdown(lines),
        "table.csv": pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"),
        "table.json": json.dumps(rows, indent=1, allow_nan=False) + "\n",
    }
