"""Repeatability of a hose: the smallest error that a model can have at a length that was held out.

python fits/portland_hose/repeatability_floor.py FOLDER_WITH_CASES

At each length the pressure rises and falls in several tests. The force of each test is interpolated on a
common grid of pressures, separately for filling and venting. Forces below 2 % of the largest force are
left out, because the hose is slack there.

    tests   sd of the tests around their mean, at the same length, pressure and direction
    ruler   1 mm times the slope of force with length, at the same pressure
    floor   root of the sum of the two squares, over all grid points of the inner lengths

The length is set once for all tests of a length. An error of the ruler is therefore the same for all of
them and is not part of `tests`. Slow relaxation and conditioning are part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from command_line import build_parser, list_cases

from pamjax.records.case import Case, read_case
from pamjax.records.levels import find_levels, find_nearest_level

#: Sd of the ruler, m; share of the largest force below which the hose is slack; pressures of the grid.
RULER, SLACK, GRID = 1e-3, 0.02, 40


@dataclass(frozen=True)
class RepeatabilityFloor:
    """Repeatability of a hose, N.

    Attributes:
        tests: sd of the tests, at the inner lengths.
        ruler: error of the force from the ruler, at the inner lengths.
        floor: both together.
        tests_all_lengths: sd of the tests, at all lengths.
        full_scale: largest interpolated force.
    """

    tests: float
    ruler: float
    floor: float
    tests_all_lengths: float
    full_scale: float


def interpolate_tests(case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lengths (m), the pressures (Pa) and the force (N) on the common grid.

    The force has the axes (length, test, direction, pressure) and is NaN where a test has no reading.
    """
    recording = case.recording
    top = np.nanmax(recording.force)
    lengths = find_levels(recording.length)
    level = find_nearest_level(recording.length, lengths)
    grid = np.linspace(np.nanmin(recording.pressure), np.nanmax(recording.pressure), GRID)
    tests = [np.unique(recording.cycle[level == k]) for k in range(len(lengths))]
    force = np.full((len(lengths), max(map(len, tests)), 2, GRID), np.nan)
    for k, numbers in enumerate(tests):
        for j, number in enumerate(numbers):
            rows = np.flatnonzero((level == k) & (recording.cycle == number))
            peak = rows[np.argmax(recording.pressure[rows])]
            for direction, part in enumerate((rows[rows <= peak], rows[rows >= peak])):
                if part.size < 5:
                    continue
                order = part[np.argsort(recording.pressure[part], kind="stable")]
                p, f = recording.pressure[order], recording.force[order]
                inside = (grid >= p[0]) & (grid <= p[-1])
                values = np.interp(grid[inside], p, f)
                force[k, j, direction, inside] = np.where(values > SLACK * top, values, np.nan)
    return lengths, grid, force


def measure_floor(case: Case) -> RepeatabilityFloor:
    """Return the repeatability of one hose."""
    lengths, _, force = interpolate_tests(case)
    with np.errstate(all="ignore"):
        count = np.isfinite(force).sum(axis=1)
        mean = np.where(count > 0, np.nansum(force, axis=1) / np.maximum(count, 1), np.nan)
        variance = np.nansum((force - mean[:, None]) ** 2, axis=1) / np.maximum(count - 1, 1)
        variance = np.where(count > 1, variance, np.nan)
        slope = np.abs(np.gradient(mean, lengths, axis=0))
    inner = slice(1, -1)
    tests = float(np.sqrt(np.nanmean(variance[inner])))
    ruler = float(RULER * np.sqrt(np.nanmean(slope[inner] ** 2)))
    return RepeatabilityFloor(
        tests=tests,
        ruler=ruler,
        floor=float(np.hypot(tests, ruler)),
        tests_all_lengths=float(np.sqrt(np.nanmean(variance))),
        full_scale=float(np.nanmax(force)),
    )


def main(arguments: list[str] | None = None) -> None:
    options = build_parser(__doc__, writes=False).parse_args(arguments)
    print("| hose | tests, N | ruler, N | floor, N | tests at all lengths, N | full scale, N |")
    print("|---|---|---|---|---|---|")
    for folder in list_cases(options.cases):
        case = read_case(folder)
        result = measure_floor(case)
        print(
            f"| {case.name} | {result.tests:.3g} | {result.ruler:.3g} | {result.floor:.3g} |"
            f" {result.tests_all_lengths:.3g} | {result.full_scale:.4g} |"
        )


if __name__ == "__main__":
    main()
