"""Pareto front of two objectives by the ε-constraint method: one is minimised under a cap on the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.optimise import search_optimum
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, Choice, SizingProblem

#: Number of points of a front, and number of choices in its search.
_FRONT_POINTS, _FRONT_CHOICES = 9, 6


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """Non-dominated points: no other point is better in both objectives.

    Attributes:
        first, second: names of the objectives.
        values: (n, 2), SI, sorted by the first objective.
        choices: choice of each point.
    """

    first: str
    second: str
    values: np.ndarray
    choices: tuple[Choice, ...]


def select_second_objective(objective: str, stated_objective: str | None) -> str:
    """Return the second objective: that of the spec, else mass, else diameter."""
    if stated_objective is not None and stated_objective != objective:
        return stated_objective
    return "mass" if objective != "mass" else "diameter"


def compute_front(results: Sequence[ChoiceResult], second: str) -> ParetoFront:
    """Return the Pareto front of the best choices.

    Args:
        results: the best first; infeasible choices are ignored.
        second: name of the second objective.
    """
    first = results[0].problem.objective
    ends = [_find_ends(result, second) for result in results if result.optimum is not None]
    ends = [choice_ends for choice_ends in ends if choice_ends][:_FRONT_CHOICES]
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
        # All choices have the same caps: with different ones, points would dominate each other by chance.
        for cap in np.geomspace(start[1], stop[1], _FRONT_POINTS)[1:-1]:
            capped_points = [
                build_point(*capped_optimum)
                for choice_ends in ends
                if (capped_optimum := _search_under_cap(choice_ends, second, float(cap)))
            ]
            points_on_front += [min(capped_points, key=lambda p: p[0])] if capped_points else []
    return _select_nondominated(first, second, points_on_front)


def _find_ends(result: ChoiceResult, second: str) -> list[tuple[SizingProblem, np.ndarray]]:
    """Return the optima of one choice for the first and for the second objective."""
    # Optimise again: the optimum of the result may include a back-off for uncertainty.
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
    """Return the optimum of the first objective with an upper bound on the second, or None if infeasible."""
    optima = [search_optimum(problem.copy_with(caps={second: cap}), z) for problem, z in ends]
    feasible = [optimum for optimum in optima if optimum.is_feasible]
    return (ends[0][0], min(feasible, key=lambda optimum: optimum.log_objective).z) if feasible else None


def _select_nondominated(first: str, second: str, points: list[tuple[float, float, Choice]]) -> ParetoFront:
    """Return the points that no other point dominates."""
    front: list[tuple[float, float, Choice]] = []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if not front or point[1] < front[-1][1] * (1 - 1e-6):
            front.append(point)
    return ParetoFront(first, second, np.array([p[:2] for p in front]), tuple(p[2] for p in front))
