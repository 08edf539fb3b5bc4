"""A spec that no muscle meets: what binds, and by how much each requirement alone would have to give.

What binds: the requirements whose multipliers are not zero where the largest broken margin is least. How
much: for each of them the least by which it alone must be relaxed, all others kept, over the choices that
come nearest; where one alone is not enough, how far the nearest muscle is from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import POINT_COUNT, POINT_OUTPUTS, evaluate_many, locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.optimise import minimise_violation
from pamjax.sizing.problem import SizingProblem
from pamjax.sizing.requirements import Requirement
from pamjax.units import compute_si_factor

#: Choices, the nearest first, over which the least is sought.
NEAREST_CHOICES = 8
#: Margin by which others may be broken while one is relaxed.
MAX_OTHER_VIOLATION = 1e-4
#: Share of the conflict below which a requirement is no part of it.
MIN_CONFLICT_SHARE = 1e-3


@dataclass(frozen=True)
class Relaxation:
    """What one requirement would have to give.

    Attributes:
        requirement: which.
        conflict_share: its share of the conflict.
        relaxed_bound: what would be met instead of its bound, SI; None where it alone does not do.
        contraction: alike as a contraction, for a free contraction.
        shortfall: what the nearest muscle has of it, and by how much that is off; "" where it alone does.
    """

    requirement: Requirement
    conflict_share: float
    relaxed_bound: float | None
    contraction: float | None = None
    shortfall: str = ""

    @property
    def description(self) -> str:
        """In words."""
        requirement = self.requirement
        if self.relaxed_bound is None:
            return f"{requirement.description}: the nearest muscle has {self.shortfall}"
        if self.contraction is not None:
            return f"{requirement.description}: about {100 * self.contraction:.3g} % would do"
        if requirement.is_safety_factor:
            return f"{requirement.description}: {1 / self.relaxed_bound:.3g} times would do"
        if len(requirement.bounds) > 1 and requirement.key == "stroke":
            return (
                f"{requirement.description}: {100 * self.relaxed_bound / requirement.bounds[-1]:.3g} %"
                f" of the load would do"
            )
        return f"{requirement.description}: {format_amount(self.relaxed_bound, requirement.unit)} would do"


def format_shortfall(requirement: Requirement, y: np.ndarray) -> str:
    """What a muscle with these outputs has of a requirement that it misses, and by how much, with units."""
    worst = int(np.argmin(requirement.compute_margins(y)))
    reached, bound = float(y[requirement.rows[worst]]), requirement.bounds[worst]
    if requirement.is_safety_factor:
        return f"{format_amount(1 / reached, '1')} times, {format_amount(1 / bound - 1 / reached, '1')} short"
    difference = (
        f"{format_amount(abs(reached - bound), requirement.unit)}"
        f" {'short' if requirement.sense > 0 else 'too much'}"
    )
    return f"{format_amount(reached + requirement.fitting_length, requirement.unit)}, {difference}"


def format_amount(amount: float, unit: str) -> str:
    """An SI amount to three digits, without a power of ten.

    >>> format_amount(1897.3, "N")
    '1900 N'
    """
    number = f"{float(f'{amount / compute_si_factor(unit):.3g}'):.6g}"
    return number if unit == "1" else f"{number} {unit}"


def find_conflict(results: Sequence[ChoiceResult]) -> tuple[ChoiceResult, list[Relaxation]]:
    """The choice that comes nearest, and what would have to give.

    Args:
        results: choices of which none keeps everything.
    """
    nearest_results = sorted(results, key=lambda requirement: requirement.violation)[:NEAREST_CHOICES]
    problem = nearest_results[0].problem
    z, _, sizes = minimise_violation(problem, nearest_results[0].start)
    conflict_shares = [float(sizes[problem.owner == k].sum()) for k in range(len(problem.task.requirements))]
    relaxations = []
    for k, requirement in enumerate(problem.task.requirements):
        if conflict_shares[k] < MIN_CONFLICT_SHARE:
            continue
        least_relaxation = min(
            (_relax_alone(result.problem, result.start, k) for result in nearest_results), default=math.inf
        )
        relaxations.append(_build_relaxation(problem, z, requirement, conflict_shares[k], least_relaxation))
    nearest = ChoiceResult(problem, None, z, nearest_results[0].violation)
    return nearest, sorted(
        relaxations, key=lambda requirement: (requirement.relaxed_bound is None, -requirement.conflict_share)
    )


def _relax_alone(problem: SizingProblem, start: np.ndarray, k: int) -> float:
    """The least relaxation of requirement k that keeps all others; infinite where it does not do.

    The search is local: from what nearly fits, and, where that fails, from what is usual.
    """
    weights = (problem.owner == k).astype(float)
    for trial_start in (start, problem.to_scaled(problem.start_high), np.full(start.size, 0.5)):
        z, violation, _ = minimise_violation(problem, trial_start, weights)
        others = problem.evaluate(z)[2][weights == 0]
        if others.size == 0 or float(np.min(others)) > -MAX_OTHER_VIOLATION:
            return violation
    return math.inf


def _build_relaxation(
    problem: SizingProblem, z: np.ndarray, requirement: Requirement, conflict_share: float, violation: float
) -> Relaxation:
    if not math.isfinite(violation):
        return Relaxation(
            requirement,
            conflict_share,
            None,
            shortfall=format_shortfall(requirement, problem.compute_outputs(z)),
        )
    bound = requirement.bounds[-1]
    if bound > 0:
        share = math.exp(-requirement.sense * violation)
        # Below a tenth the logarithm goes on as its tangent.
        share = (
            0.1 * (1 - (violation - math.log(10)))
            if requirement.sense > 0 and violation > math.log(10)
            else share
        )
        return Relaxation(requirement, conflict_share, bound * share + requirement.fitting_length)
    shortfall = violation * requirement.scale
    return Relaxation(
        requirement, conflict_share, -shortfall, _estimate_contraction(problem, z, requirement, shortfall)
    )


def _estimate_contraction(
    problem: SizingProblem, z: np.ndarray, requirement: Requirement, shortfall: float
) -> float:
    """The free contraction at which the force would not lack, by the slope of force in contraction."""
    point = requirement.rows[0] - POINT_OUTPUTS.index("force") * POINT_COUNT
    points = problem.task.points
    lowered = np.array(points.contraction, float)
    lowered[point] -= 0.01
    y = evaluate_many(
        problem.to_coordinates(z)[None],
        problem.build,
        problem.numbers,
        points._replace(contraction=lowered),
        problem.ids,
    )
    row = locate_output("force", point)
    slope = (float(y[0, row]) - float(problem.compute_outputs(z)[row])) / 0.01
    return float(points.contraction[point]) - shortfall / max(slope, 1e-9)
