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
from pamjax.sizing.optimise import Answer
from pamjax.sizing.problem import Problem
from pamjax.sizing.requirements import Requirement

#: Relative step of a property for its central difference.
STEP = 1e-4
#: Multiplier below which nothing is said.
LEAST = 1e-4

#: Properties that are asked about, by field of `Made`.
PROPERTIES = {
    "modulus": "thread modulus",
    "strength": "thread strength",
    "shear": "shear modulus of the rubber",
    "thread_diameter": "thread diameter (at the same count)",
    "threads": "number of threads",
}


@dataclass(frozen=True)
class Price:
    """What a requirement costs.

    Attributes:
        requirement: which.
        share: by how many per cent the objective falls where it gives one per cent.
        slope: change of the objective for a unit of the bound (of the safety factor), SI.
    """

    requirement: Requirement
    share: float
    slope: float


def prices(problem: Problem, answer: Answer) -> list[Price]:
    """The requirements that cost something, the dearest first."""
    found = []
    value = float(np.exp(answer.value))
    for k, one in enumerate(problem.asked.requirements):
        own = problem.owner == k
        weights = answer.multipliers[own]
        if weights.sum() < LEAST:
            continue
        bounds = np.array(one.bounds)
        safe = np.where(bounds > 0, bounds, one.scale)
        slope = float(value * np.sum(weights * one.sense / safe))
        if one.factor:
            # The spec states 1 / bound.
            slope = float(-value * np.sum(weights * one.sense * bounds))
        # One per cent of what the spec states is more than one of what the fittings leave.
        stated = 1 + one.beside / one.bounds[0] if one.beside else 1.0
        found.append(Price(one, float(weights.sum()) * stated, slope))
    return sorted(found, key=lambda price: -price.share)


def properties(problem: Problem, answer: Answer) -> dict[str, float]:
    """Per cent by which the objective changes where a property grows by one per cent, by its words."""

    def lagrangian(field: str, factor: float) -> float:
        changed = {field: getattr(problem.made, field) * factor}
        if field == "thread_diameter":
            changed["thread_area"] = problem.made.thread_area * factor**2
        value, _, margins, _ = problem.with_(made=problem.made._replace(**changed)).at(answer.z)
        return value - float(answer.multipliers @ margins)

    found = {}
    for field, words in PROPERTIES.items():
        found[words] = (lagrangian(field, 1 + STEP) - lagrangian(field, 1 - STEP)) / (2 * STEP)
    return found


def at_limits(problem: Problem, answer: Answer) -> list[str]:
    """Coordinates that stand at an end of their range, in words."""
    found = []
    for k, at in zip(problem.free, answer.z, strict=True):
        if at < 1e-6 or at > 1 - 1e-6:
            end = "smallest" if at < 0.5 else "largest"
            found.append(f"{COORDINATES[k].replace('_', ' ')} at its {end}")
    return found
