"""Analysis of an infeasible spec: the conflicting requirements, and the necessary relaxation of each.

The nearest muscle has the smallest largest violation. The requirements with a multiplier above zero at this
muscle are in conflict. For each of them, the smallest sufficient relaxation is computed over the nearest
choices; all other requirements are kept. If no relaxation of one requirement is sufficient, the shortfall
of the nearest muscle is reported.
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

#: Number of nearest choices over which the smallest relaxation is computed.
_NEAREST_CHOICES = 8
#: Permitted violation of the other requirements while one is relaxed.
_MAX_OTHER_VIOLATION = 1e-4
#: Share of the conflict below which a requirement is not reported.
_MIN_CONFLICT_SHARE = 1e-3


@dataclass(frozen=True)
class Relaxation:
    """The relaxation of one requirement that makes the spec feasible.

    Attributes:
        requirement: the requirement.
        conflict_share: its share of the conflict, from the multipliers; all shares sum to 1.
        relaxed_bound: the feasible bound, SI; None if relaxing this requirement alone is not sufficient.
        contraction: the feasible contraction, for a free contraction.
        shortfall: value of the nearest muscle, and its difference from the bound; "" with a relaxed bound.
    """

    requirement: Requirement
    conflict_share: float
    relaxed_bound: float | None
    contraction: float | None = None
    shortfall: str = ""

    @property
    def description(self) -> str:
        """Return the requirement and its relaxation as text."""
        requirement = self.requirement
        if self.relaxed_bound is None:
            return f"{requirement.description}: the nearest muscle has {self.shortfall}"
        if self.contraction is not None:
            return f"{requirement.description}: relax to about {100 * self.contraction:.3g} %"
        if requirement.is_safety_factor:
            return f"{requirement.description}: relax to a factor of {1 / self.relaxed_bound:.3g}"
        if len(requirement.bounds) > 1 and requirement.key == "stroke":
            return (
                f"{requirement.description}: relax to"
                f" {100 * self.relaxed_bound / requirement.bounds[-1]:.3g} % of the load"
            )
        return f"{requirement.description}: relax to {format_amount(self.relaxed_bound, requirement.unit)}"


def format_shortfall(requirement: Requirement, y: np.ndarray) -> str:
    """Return the value of a violated requirement and its difference from the bound, with units."""
    worst = int(np.argmin(requirement.compute_margins(y)))
    reached_value, bound = float(y[requirement.rows[worst]]), requirement.bounds[worst]
    if requirement.is_safety_factor:
        difference = f"{format_amount(1 / bound - 1 / reached_value, '1')} too low"
        return f"a factor of {format_amount(1 / reached_value, '1')}, {difference}"
    difference = (
        f"{format_amount(abs(reached_value - bound), requirement.unit)}"
        f" {'too low' if requirement.sense > 0 else 'too high'}"
    )
    return f"{format_amount(reached_value + requirement.fitting_length, requirement.unit)}, {difference}"


def format_amount(amount: float, unit: str) -> str:
    """Return an SI amount with its unit to three digits, without a power of ten.

    >>> format_amount(1897.3, "N")
    '1900 N'
    """
    number = f"{float(f'{amount / compute_si_factor(unit):.3g}'):.6g}"
    return number if unit == "1" else f"{number} {unit}"


def find_conflict(results: Sequence[ChoiceResult]) -> tuple[ChoiceResult, list[Relaxation]]:
    """Return the nearest choice, and the relaxation of each conflicting requirement.

    Args:
        results: choices, none of which is feasible.
    """
    nearest_results = sorted(results, key=lambda result: result.violation)[:_NEAREST_CHOICES]
    problem = nearest_results[0].problem
    z, _, multipliers = minimise_violation(problem, nearest_results[0].start)
    conflict_shares = [
        float(multipliers[problem.owner == k].sum()) for k in range(len(problem.task.requirements))
    ]
    relaxations = []
    for k, requirement in enumerate(problem.task.requirements):
        if conflict_shares[k] < _MIN_CONFLICT_SHARE:
            continue
        least_relaxation = min(
            (_relax_alone(result.problem, result.start, k) for result in nearest_results), default=math.inf
        )
        relaxations.append(_build_relaxation(problem, z, requirement, conflict_shares[k], least_relaxation))
    nearest = ChoiceResult(problem, None, z, nearest_results[0].violation)
    return nearest, sorted(
        relaxations, key=lambda relaxation: (relaxation.relaxed_bound is None, -relaxation.conflict_share)
    )


def _relax_alone(problem: SizingProblem, start: np.ndarray, k: int) -> float:
    """Return the smallest sufficient relaxation of requirement k; infinite if none is sufficient.

    All other requirements are kept. The search is local. It starts from the nearest candidate and, if that
    fails, from typical dimensions.
    """
    weights = (problem.owner == k).astype(float)
    for trial_start in (start, problem.to_scaled(problem.start_high), np.full(start.size, 0.5)):
        z, violation, _ = minimise_violation(problem, trial_start, weights)
        others = problem.evaluate(z)[2][weights == 0]
        if others.size == 0 or float(np.min(others)) > -_MAX_OTHER_VIOLATION:
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
        # Below a tenth of the bound the margin is linear, see `requirements.compute_margin`.
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
    """Return the contraction at which the force suffices, by linear extrapolation of the force."""
    point = requirement.rows[0] - POINT_OUTPUTS.index("force") * POINT_COUNT
    points = problem.task.points
    lower_contraction = np.array(points.contraction, float)
    lower_contraction[point] -= 0.01
    y = evaluate_many(
        problem.to_coordinates(z)[None],
        problem.build,
        problem.numbers,
        points._replace(contraction=lower_contraction),
        problem.ids,
    )
    row = locate_output("force", point)
    slope = (float(y[0, row]) - float(problem.compute_outputs(z)[row])) / 0.01
    return float(points.contraction[point]) - shortfall / max(slope, 1e-9)
