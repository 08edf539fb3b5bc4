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

from pamjax.sizing.candidate import EACH, PLACES, index, many
from pamjax.sizing.enumerate import Tried
from pamjax.sizing.optimise import relax
from pamjax.sizing.problem import Problem
from pamjax.sizing.requirements import Requirement
from pamjax.units import in_unit

#: Choices, the nearest first, over which the least is sought.
NEAREST = 8
#: Margin by which others may be broken while one is relaxed.
ALLOWED = 1e-4
#: Share of the conflict below which a requirement is no part of it.
PART = 1e-3


@dataclass(frozen=True)
class Gives:
    """What one requirement would have to give.

    Attributes:
        requirement: which.
        part: its share of the conflict.
        amount: what would be met instead of its bound, SI; None where it alone does not do.
        contraction: alike as a contraction, for a free contraction.
        lacks: what the nearest muscle has of it, and by how much that is off; "" where it alone does.
    """

    requirement: Requirement
    part: float
    amount: float | None
    contraction: float | None = None
    lacks: str = ""

    @property
    def says(self) -> str:
        """In words."""
        one = self.requirement
        if self.amount is None:
            return f"{one.says}: the nearest muscle has {self.lacks}"
        if self.contraction is not None:
            return f"{one.says}: about {100 * self.contraction:.3g} % would do"
        if one.factor:
            return f"{one.says}: {1 / self.amount:.3g} times would do"
        if len(one.bounds) > 1 and one.key == "stroke":
            return f"{one.says}: {100 * self.amount / one.bounds[-1]:.3g} % of the load would do"
        return f"{one.says}: {plain(self.amount, one.unit)} would do"


def lacks(one: Requirement, y: np.ndarray) -> str:
    """What a muscle with these outputs has of a requirement that it misses, and by how much, with units."""
    worst = int(np.argmin(one.margins(y)))
    has, bound = float(y[one.rows[worst]]), one.bounds[worst]
    if one.factor:
        return f"{plain(1 / has, '1')} times, {plain(1 / bound - 1 / has, '1')} short"
    off = f"{plain(abs(has - bound), one.unit)} {'short' if one.sense > 0 else 'too much'}"
    return f"{plain(has + one.beside, one.unit)}, {off}"


def plain(amount: float, unit: str) -> str:
    """An SI amount to three digits, without a power of ten.

    >>> plain(1897.3, "N")
    '1900 N'
    """
    number = f"{float(f'{amount / in_unit(unit):.3g}'):.6g}"
    return number if unit == "1" else f"{number} {unit}"


def conflict(tried: Sequence[Tried]) -> tuple[Tried, list[Gives]]:
    """The choice that comes nearest, and what would have to give.

    Args:
        tried: choices of which none keeps everything.
    """
    near = sorted(tried, key=lambda one: one.broken)[:NEAREST]
    problem = near[0].problem
    z, _, sizes = relax(problem, near[0].start)
    parts = [float(sizes[problem.owner == k].sum()) for k in range(len(problem.asked.requirements))]
    found = []
    for k, one in enumerate(problem.asked.requirements):
        if parts[k] < PART:
            continue
        least = min((_alone(other.problem, other.start, k) for other in near), default=math.inf)
        found.append(_gives(problem, z, one, parts[k], least))
    nearest = Tried(problem, None, z, near[0].broken)
    return nearest, sorted(found, key=lambda one: (one.amount is None, -one.part))


def _alone(problem: Problem, start: np.ndarray, k: int) -> float:
    """The least relaxation of requirement k that keeps all others; infinite where it does not do.

    The search is local: from what nearly fits, and, where that fails, from what is usual.
    """
    weights = (problem.owner == k).astype(float)
    for begin in (start, problem.scaled(problem.usual), np.full(start.size, 0.5)):
        z, s, _ = relax(problem, begin, weights)
        others = problem.at(z)[2][weights == 0]
        if others.size == 0 or float(np.min(others)) > -ALLOWED:
            return s
    return math.inf


def _gives(problem: Problem, z: np.ndarray, one: Requirement, part: float, s: float) -> Gives:
    if not math.isfinite(s):
        return Gives(one, part, None, lacks=lacks(one, problem.outputs(z)))
    bound = one.bounds[-1]
    if bound > 0:
        share = math.exp(-one.sense * s)
        # Below a tenth the logarithm goes on as its tangent.
        share = 0.1 * (1 - (s - math.log(10))) if one.sense > 0 and s > math.log(10) else share
        return Gives(one, part, bound * share + one.beside)
    lacking = s * one.scale
    return Gives(one, part, -lacking, _contraction(problem, z, one, lacking))


def _contraction(problem: Problem, z: np.ndarray, one: Requirement, lacking: float) -> float:
    """The free contraction at which the force would not lack, by the slope of force in contraction."""
    place = one.rows[0] - EACH.index("force") * PLACES
    at = problem.asked.places
    less = np.array(at.contraction, float)
    less[place] -= 0.01
    y = many(
        problem.coordinates(z)[None],
        problem.made,
        problem.numbers,
        at._replace(contraction=less),
        problem.ids,
    )
    row = index("force", place)
    slope = (float(y[0, row]) - float(problem.outputs(z)[row])) / 0.01
    return float(at.contraction[place]) - lacking / max(slope, 1e-9)
