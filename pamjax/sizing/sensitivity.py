"""What the answer is sensitive to: multipliers as prices of the requirements, and of what was assumed.

    d ln(objective) / d ln(bound_j) = ± λ_j                  a requirement, exact
    d ln(objective) / d ln θ = ∂f/∂θ θ − Σ λ_j ∂m_j/∂θ θ     a property, by the envelope theorem

The property's slopes at fixed geometry are central differences of the outputs; the multipliers are those of
the exact slopes. Both speak of small changes, of this choice of threads: a larger one may change what binds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import COORDINATES
from pamjax.sizing.optimise import SearchResult
from pamjax.sizing.problem import SizingProblem
from pamjax.sizing.requirements import Requirement

#: Relative step of a property for its central difference.
RELATIVE_STEP = 1e-4
#: Multiplier below which nothing is said.
MIN_MULTIPLIER = 1e-4

#: Properties that are asked about, by field of `MuscleBuild`.
PROPERTY_LABELS = {
    "modulus": "thread modulus",
    "strength": "thread strength",
    "shear": "shear modulus of the rubber",
    "thread_diameter": "thread diameter (at the same count)",
    "threads": "number of threads",
}


@dataclass(frozen=True)
class ShadowPrice:
    """What a requirement costs.

    Attributes:
        requirement: which.
        percent_saved: by how many per cent the objective falls where it gives one per cent.
        slope: change of the objective for a unit of the bound (of the safety factor), SI.
    """

    requirement: Requirement
    percent_saved: float
    slope: float


def compute_prices(problem: SizingProblem, optimum: SearchResult) -> list[ShadowPrice]:
    """The requirements that cost something, the dearest first."""
    shadow_prices = []
    value = float(np.exp(optimum.log_objective))
    for k, requirement in enumerate(problem.task.requirements):
        is_own = problem.owner == k
        weights = optimum.multipliers[is_own]
        if weights.sum() < MIN_MULTIPLIER:
            continue
        bounds = np.array(requirement.bounds)
        safe_bounds = np.where(bounds > 0, bounds, requirement.scale)
        slope = float(value * np.sum(weights * requirement.sense / safe_bounds))
        if requirement.is_safety_factor:
            # The spec states 1 / bound.
            slope = float(-value * np.sum(weights * requirement.sense * bounds))
        # One per cent of what the spec states is more than one of what the fittings leave.
        stated_ratio = (
            1 + requirement.fitting_length / requirement.bounds[0] if requirement.fitting_length else 1.0
        )
        shadow_prices.append(ShadowPrice(requirement, float(weights.sum()) * stated_ratio, slope))
    return sorted(shadow_prices, key=lambda price: -price.percent_saved)


def compute_property_sensitivities(problem: SizingProblem, optimum: SearchResult) -> dict[str, float]:
    """Per cent by which the objective changes where a property grows by one per cent, by its words."""

    def lagrangian(field: str, factor: float) -> float:
        changed = {field: getattr(problem.build, field) * factor}
        if field == "thread_diameter":
            changed["thread_area"] = problem.build.thread_area * factor**2
        value, _, margins, _ = problem.copy_with(build=problem.build._replace(**changed)).evaluate(optimum.z)
        return value - float(optimum.multipliers @ margins)

    sensitivities = {}
    for field, label in PROPERTY_LABELS.items():
        sensitivities[label] = (
            lagrangian(field, 1 + RELATIVE_STEP) - lagrangian(field, 1 - RELATIVE_STEP)
        ) / (2 * RELATIVE_STEP)
    return sensitivities


def list_active_limits(problem: SizingProblem, optimum: SearchResult) -> list[str]:
    """Coordinates that stand at an end of their range, in words."""
    descriptions = []
    for k, scaled in zip(problem.free_indices, optimum.z, strict=True):
        if scaled < 1e-6 or scaled > 1 - 1e-6:
            end = "smallest" if scaled < 0.5 else "largest"
            descriptions.append(f"{COORDINATES[k].replace('_', ' ')} at its {end}")
    return descriptions
