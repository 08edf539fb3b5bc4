"""The front between two objectives: the best of one for each cap on the other, over the best choices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.optimise import search_optimum
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, Choice, SizingProblem

#: Points of a front, and choices that it is sought over.
FRONT_POINTS, FRONT_CHOICES = 9, 6


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """Points none of which is worse than another in both.

    Attributes:
        first, second: names of the objectives.
        values: (n, 2), SI, the first rising.
        choices: of each point.
    """

    first: str
    second: str
    values: np.ndarray
    choices: tuple[Choice, ...]


def select_second_objective(objective: str, stated: str | None) -> str:
    """The second objective: what the spec says, or mass, or diameter."""
    if stated is not None and stated != objective:
        return stated
    return "mass" if objective != "mass" else "diameter"


def compute_front(results: Sequence[ChoiceResult], second: str) -> ParetoFront:
    """The front of the best choices.

    Args:
        results: the best first; only those with an answer count.
    """
    first = results[0].problem.objective
    ends = [_find_ends(result, second) for result in results if result.optimum is not None]
    ends = [choice_ends for choice_ends in ends if choice_ends][:FRONT_CHOICES]
    if not ends:
        return ParetoFront(first, second, np.zeros((0, 2)), ())
    rows = [locate_output(OBJECTIVE_OUTPUTS[first]), locate_output(OBJECTIVE_OUTPUTS[second])]

    def build_point(result: SizingProblem, z: np.ndarray) -> tuple[float, float, Choice]:
        a, b = result.compute_outputs(z)[rows]
        return float(a), float(b), result.choice

    points = [build_point(result, z) for choice_ends in ends for result, z in choice_ends]
    start, stop = min(points, key=lambda p: p[0]), min(points, key=lambda p: p[1])
    points_on_front = [start, stop]
    if start[1] > stop[1] * (1 + 1e-6) and stop[1] > 0:
        # The same caps for all choices: points of different caps would hide each other by chance.
        for cap in np.geomspace(start[1], stop[1], FRONT_POINTS)[1:-1]:
            capped_points = [
                build_point(*found_end)
                for choice_ends in ends
                if (found_end := _search_under_cap(choice_ends, second, float(cap)))
            ]
            points_on_front += [min(capped_points, key=lambda p: p[0])] if capped_points else []
    return _select_nondominated(first, second, points_on_front)


def _find_ends(result: ChoiceResult, second: str) -> list[tuple[SizingProblem, np.ndarray]]:
    """A choice's least of the first objective, and of the second."""
    # Not the answer of the search: what uncertainty takes may have been added since.
    optimum = search_optimum(result.problem, result.start)
    if not optimum.is_feasible:
        return []
    second_optimum = search_optimum(result.problem.copy_with(objective=second), optimum.z)
    return [
        (result.problem, end_result.z) for end_result in (optimum, second_optimum) if end_result.is_feasible
    ]


def _search_under_cap(
    ends: list[tuple[SizingProblem, np.ndarray]], second: str, cap: float
) -> tuple[SizingProblem, np.ndarray] | None:
    """A choice's least of the first objective under a cap on the second; None where it is not found."""
    optima = [search_optimum(problem.copy_with(caps={second: cap}), z) for problem, z in ends]
    feasible = [optimum for optimum in optima if optimum.is_feasible]
    return (ends[0][0], min(feasible, key=lambda optimum: optimum.log_objective).z) if feasible else None


def _select_nondominated(first: str, second: str, points: list[tuple[float, float, Choice]]) -> ParetoFront:
    """Those that no other beats in both."""
    nondominated: list[tuple[float, float, Choice]] = []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if not nondominated or point[1] < nondominated[-1][1] * (1 - 1e-6):
            nondominated.append(point)
    return ParetoFront(
        first, second, np.array([p[:2] for p in nondominated]), tuple(p[2] for p in nondominated)
    )
