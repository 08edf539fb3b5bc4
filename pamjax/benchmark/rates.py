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
    of: int

    @classmethod
    def of_all(cls, one: Iterable[bool]) -> Rate:
        told = [bool(b) for b in one]
        return cls(sum(told), len(told))

    @property
    def share(self) -> float:
        return self.hits / self.of if self.of else float("nan")

    def limits(self, level: float = 0.95) -> tuple[float, float]:
        """Exact two-sided interval."""
        tail, hits, of = (1 - level) / 2, self.hits, self.of
        low = float(beta.ppf(tail, hits, of - hits + 1)) if hits else 0.0
        high = float(beta.ppf(1 - tail, hits + 1, of - hits)) if hits < of else 1.0
        return low, high

    @property
    def at_most(self) -> float:
        """One-sided 95 % upper limit."""
        return self.limits(0.90)[1]

    def as_dict(self) -> dict[str, Any]:
        low, high = self.limits()
        share = self.share if self.of else None
        return {"hits": self.hits, "of": self.of, "share": share, "low": low, "high": high}

    def __str__(self) -> str:
        if not self.of:
            return "none to count"
        low, high = self.limits()
        return f"{self.hits} of {self.of}: {self.share:.1%} ({low:.1%} to {high:.1%})"


@dataclass(frozen=True)
class Line:
    """One line of a table: what was counted, and a rate or a number with its interval.

    Attributes:
        what: in words.
        rate: of pamjax; None where it is no rate.
        text: what stands in the table.
        usual: the same of common practice, or "".
        target: what was aimed at, or "".
    """

    what: str
    rate: Rate | None
    text: str
    usual: str = ""
    target: str = ""


def counted(what: str, hits: Iterable[bool], usual: Iterable[bool] | None = None, target: str = "") -> Line:
    """A line from what was hit."""
    rate = Rate.of_all(hits)
    beside = str(Rate.of_all(usual)) if usual is not None else ""
    return Line(what, rate, str(rate), beside, target)


def as_markdown(lines: Sequence[Line]) -> str:
    """A table for a README."""
    rows = [f"| {x.what} | {x.text} | {x.usual} | {x.target} |" for x in lines]
    return "\n".join(["| what | pamjax | common practice | aim |", "|---|---|---|---|", *rows, ""])


def as_rows(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """The same for programs."""
    return [
        {"what": x.what, "pamjax": x.text, "common_practice": x.usual, "aim": x.target}
        | (x.rate.as_dict() if x.rate else {})
        for x in lines
    ]


def as_text(lines: Sequence[Line]) -> str:
    """The same for a screen."""
    out = []
    for line in lines:
        out.append(f"  {line.what}: {line.text}")
        if line.usual:
            out.append(f"      common practice: {line.usual}")
    return "\n".join(out)


def documents(lines: Sequence[Line]) -> dict[str, str]:
    """The table as files, by name."""
    rows = as_rows(lines)
    return {
        "table.md": as_markdown(lines),
        "table.csv": pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"),
        "table.json": json.dumps(rows, indent=1, allow_nan=False) + "\n",
    }
