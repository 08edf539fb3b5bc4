"""Unexplained misfit that many recordings have in common: its kind and its region."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pamjax.fleet.frames import list_rows, select_rows

#: Number of cells of the grid of pressure and contraction, in each direction.
_REGION_GRID = 40
#: Smallest share of the recordings with unexplained misfit that a common region must have.
_MIN_COMMON_SHARE = 0.5


@dataclass(frozen=True)
class CommonRegion:
    """Region in which several recordings have unexplained misfit.

    Attributes:
        channel, direction: where the misfit is.
        pressure: lowest and highest pressure, kPa.
        contraction: smallest and largest contraction.
        cases: number of recordings with misfit everywhere in this region.
    """

    channel: str
    direction: str
    pressure: tuple[float, float]
    contraction: tuple[float, float]
    cases: int


@dataclass(frozen=True)
class UnexplainedSummary:
    """Unexplained misfit of a fleet.

    Attributes:
        count, total: recordings with unexplained misfit, and diagnosed recordings.
        likenesses: number of recordings by the effect that the misfit resembles.
        region: the region that most of them have in common; None if fewer than half have one.
    """

    count: int
    total: int
    likenesses: dict[str, int]
    region: CommonRegion | None


def summarise_unexplained(cases: pd.DataFrame, regions: pd.DataFrame) -> UnexplainedSummary:
    """Return what remains unexplained in the diagnosed recordings.

    Args:
        cases, regions: tables of a `Fleet`.
    """
    diagnosed = select_rows(cases, cases["misfit_p_value"].notna())
    affected = select_rows(diagnosed, diagnosed["unexplained"])
    likenesses = Counter(str(name) for name in affected["unexplained_like"].dropna())
    region = _find_common_region(select_rows(regions, regions["case"].isin(affected["case"].tolist())))
    if region is not None and (region.cases < 2 or region.cases < _MIN_COMMON_SHARE * len(affected)):
        region = None
    return UnexplainedSummary(len(affected), len(diagnosed), dict(likenesses.most_common()), region)


def _find_common_region(regions: pd.DataFrame) -> CommonRegion | None:
    """Return the region of pressure and contraction that most cases have in common."""
    best: CommonRegion | None = None
    places = sorted(set(zip(regions["channel"], regions["direction"], strict=True)))
    for channel, direction in places:
        inside = (regions["channel"] == channel) & (regions["direction"] == direction)
        candidate = _intersect(channel, direction, list_rows(select_rows(regions, inside)))
        if best is None or candidate.cases > best.cases:
            best = candidate
    return best


def _intersect(channel: str, direction: str, regions: list[dict[str, Any]]) -> CommonRegion:
    pressure = _build_centres(regions, "pressure_low_kPa", "pressure_high_kPa")
    contraction = _build_centres(regions, "contraction_low", "contraction_high")
    covered: dict[str, np.ndarray] = {}
    for region in regions:
        in_pressure = (pressure >= region["pressure_low_kPa"]) & (pressure <= region["pressure_high_kPa"])
        in_contraction = (contraction >= region["contraction_low"]) & (
            contraction <= region["contraction_high"]
        )
        inside = in_pressure[:, None] & in_contraction
        covered[region["case"]] = covered.get(region["case"], False) | inside
    count = np.sum(list(covered.values()), axis=0)
    rows, columns = np.nonzero(count == count.max())
    return CommonRegion(
        channel,
        direction,
        (float(pressure[rows.min()]), float(pressure[rows.max()])),
        (float(contraction[columns.min()]), float(contraction[columns.max()])),
        int(count.max()),
    )


def _build_centres(regions: list[dict[str, Any]], low: str, high: str) -> np.ndarray:
    """Return the centres of the cells between the lowest and the highest end of all regions."""
    ends = min(region[low] for region in regions), max(region[high] for region in regions)
    step = (ends[1] - ends[0]) / _REGION_GRID
    return np.linspace(ends[0] + step / 2, ends[1] - step / 2, _REGION_GRID)
