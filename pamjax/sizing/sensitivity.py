"""Sensitivity of the optimum to the requirements (shadow prices) and to material properties.

    d ln(objective) / d ln(bound_j) = ± λ_j                  a requirement, exact
    d ln(objective) / d ln θ = ∂f/∂θ θ − Σ λ_j ∂m_j/∂θ θ     a property, by the envelope theorem

The derivatives with respect to θ at fixed geometry are central differences; the multipliers λ come from exact
derivatives. Both are valid for small changes and a fixed choice of threads: a large change may activate other
requirements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import COORDINATES
from pamjax.sizing.optimise import SearchResult
from pamjax.sizing.problem import SizingProblem
from pamjax.sizing.requirements import Requirement

#: Relative step of a property for its central difference.
_RELATIVE_STEP = 1e-4
#: Multiplier below which a requirement is not reported.
_MIN_MULTIPLIER = 1e-4

#: Labels of the examined properties, by field of `MuscleBuild`.
_PROPERTY_LABELS = {
    "modulus": "thread modulus",
    "strength": "thread strength",
    "shear": "shear modulus of the rubber",
    "thread_diameter": "thread diameter (at the same count)",
    "threads": "number of threads",
}


@dataclass(frozen=True)
class RequirementSensitivity:
    """Sensitivity of the objective to one requirement.

    Attributes:
        requirement: the requirement.
        percent_saved: reduction of the objective, %, if the requirement is relaxed by 1 %.
        slope: derivative of the objective with respect to the bound (or to the safety factor), SI.
    """

    requirement: Requirement
    percent_saved: float
    slope: float


def compute_requirement_sensitivities(
    problem: SizingProblem, optimum: SearchResult
) -> list[RequirementSensitivity]:
    """Return the sensitivities to the active requirements, the largest first."""
    sensitivities = []
    value = float(np.exp(optimum.log_objective))
    for k, requirement in enumerate(problem.task.requirements):
        weights = optimum.multipliers[problem.owner == k]
        if weights.sum() < _MIN_MULTIPLIER:
            continue
        bounds = np.array(requirement.bounds)
        safe_bounds = np.where(bounds > 0, bounds, requirement.scale)
        slope = float(value * np.sum(weights * requirement.sense / safe_bounds))
        if requirement.is_safety_factor:
            # A safety factor is 1 / bound.
            slope = float(-value * np.sum(weights * requirement.sense * bounds))
        # 1 % of the stated length is more than 1 % of the length without fittings.
        stated_ratio = (
            1 + requirement.fitting_length / requirement.bounds[0] if requirement.fitting_length else 1.0
        )
        sensitivities.append(RequirementSensitivity(requirement, float(weights.sum()) * stated_ratio, slope))
    return sorted(sensitivities, key=lambda sensitivity: -sensitivity.percent_saved)


def compute_property_sensitivities(problem: SizingProblem, optimum: SearchResult) -> dict[str, float]:
    """Return the change of the objective, %, for a 1 % increase of each property, by label."""

    def lagrangian(field: str, factor: float) -> float:
        changes = {field: getattr(problem.build, field) * factor}
        if field == "thread_diameter":
            changes["thread_area"] = problem.build.thread_area * factor**2
        value, _, margins, _ = problem.copy_with(build=problem.build._replace(**changes)).evaluate(optimum.z)
        return value - float(optimum.multipliers @ margins)

    sensitivities = {}
    for field, label in _PROPERTY_LABELS.items():
        sensitivities[label] = (
            lagrangian(field, 1 + _RELATIVE_STEP) - lagrangian(field, 1 - _RELATIVE_STEP)
        ) / (2 * _RELATIVE_STEP)
    return sensitivities


def list_active_limits(problem: SizingProblem, optimum: SearchResult) -> list[str]:
    """Return the coordinates at a bound of their range, as text."""
    descriptions = []
    for k, scaled_value in zip(problem.free_indices, optimum.z, strict=True):
        if scaled_value < 1e-6 or scaled_value > 1 - 1e-6:
            bound = "lower" if scaled_value < 0.5 else "upper"
            descriptions.append(f"{COORDINATES[k].replace('_', ' ')} at its {bound} limit")
    return descriptions
