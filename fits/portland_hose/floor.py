"""How well a hose repeats itself: what no model of a held-out length can be asked to beat.

python fits/portland_hose/floor.py FOLDER_WITH_CASES

At each length the pressure climbs and falls in several tests. Between neighbouring pressures the force of a
test is read on a common grid, filling and venting apart, above the slack force of two percent:

    test    sd of tests around their mean at the same length, pressure and direction
    ruler   1 mm times the slope of force by length at the same pressure, between neighbouring lengths
    floor   the root of the sum of their squares, over all grid points of the inner lengths

Length was set once for all tests of a length, so that a ruler's error is the same for all of them and is no
part of `test`. Slow relaxation and conditioning are part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from words import taker

from pamjax.records.case import Case, read_case
from pamjax.records.levels import find_levels, nearest_level

#: The ruler, m; force below this share of the largest is slack; pressures of the common grid.
RULER, SLACK, GRID = 1e-3, 0.02, 40


@dataclass(frozen=True)
class Floor:
    """Repeatability of the inner lengths and of all, N."""

    test: float
    ruler: float
    floor: float
    everywhere: float
    full_scale: float


def curves(case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lengths, m; pressures, Pa; force, N, as (length, test, direction, pressure), NaN where not met."""
    recording = case.recording
    top = np.nanmax(recording.force)
    lengths = find_levels(recording.length)
    at = nearest_level(recording.length, lengths)
    grid = np.linspace(np.nanmin(recording.pressure), np.nanmax(recording.pressure), GRID)
    tests = [np.unique(recording.cycle[at == k]) for k in range(len(lengths))]
    out = np.full((len(lengths), max(map(len, tests)), 2, GRID), np.nan)
    for k, numbers in enumerate(tests):
        for j, number in enumerate(numbers):
            rows = np.flatnonzero((at == k) & (recording.cycle == number))
            peak = rows[np.argmax(recording.pressure[rows])]
            for way, part in enumerate((rows[rows <= peak], rows[rows >= peak])):
                if part.size < 5:
                    continue
                order = part[np.argsort(recording.pressure[part], kind="stable")]
                p, f = recording.pressure[order], recording.force[order]
                inside = (grid >= p[0]) & (grid <= p[-1])
                read = np.interp(grid[inside], p, f)
                out[k, j, way, inside] = np.where(read > SLACK * top, read, np.nan)
    return lengths, grid, out


def floor(case: Case) -> Floor:
    """The floor of one hose."""
    lengths, _, force = curves(case)
    with np.errstate(all="ignore"):
        many = np.isfinite(force).sum(axis=1)
        mean = np.where(many > 0, np.nansum(force, axis=1) / np.maximum(many, 1), np.nan)
        spread = np.nansum((force - mean[:, None]) ** 2, axis=1) / np.maximum(many - 1, 1)
        spread = np.where(many > 1, spread, np.nan)
        slope = np.abs(np.gradient(mean, lengths, axis=0))
    inner = slice(1, -1)
    test = float(np.sqrt(np.nanmean(spread[inner])))
    ruler = float(RULER * np.sqrt(np.nanmean(slope[inner] ** 2)))
    return Floor(
        test, ruler, float(np.hypot(test, ruler)), float(np.sqrt(np.nanmean(spread))), float(np.nanmax(force))
    )


def main(arguments: list[str] | None = None) -> None:
    asked = taker(__doc__, writes=False).parse_args(arguments)
    print("| hose | tests, N | ruler, N | floor, N | tests at all lengths, N | full scale, N |")
    print("|---|---|---|---|---|---|")
    for toml in sorted(asked.cases.glob("*/muscle.toml")):
        case = read_case(toml.parent)
        found = floor(case)
        print(
            f"| {case.name} | {found.test:.3g} | {found.ruler:.3g} | {found.floor:.3g} |"
            f" {found.everywhere:.3g} | {found.full_scale:.4g} |"
        )


if __name__ == "__main__":
    main()
