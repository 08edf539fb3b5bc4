"""The front between two objectives: the best of one for each cap on the other, over the best choices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.design.candidate import index
from pamjax.design.enumerate import Tried
from pamjax.design.optimise import search
from pamjax.design.problem import OUTPUT, Choice

#: Points of a front, and choices that it is sought over.
POINTS, CHOICES = 9, 6


@dataclass(frozen=True, eq=False)
class Front:
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


def other(objective: str, said: str | None) -> str:
    """The second objective: what the spec says, or mass, or diameter."""
    if said is not None and said != objective:
        return said
    return "mass" if objective != "mass" else "diameter"


def front(tried: Sequence[Tried], second: str) -> Front:
    """The front of the best choices.

    Args:
        tried: the best first; only those with an answer count.
    """
    first = tried[0].problem.objective
    points: list[tuple[float, float, Choice]] = []
    for one in [one for one in tried if one.answer is not None][:CHOICES]:
        points += _of_choice(one, first, second)
    points.sort(key=lambda point: (point[0], point[1]))
    kept: list[tuple[float, float, Choice]] = []
    for point in points:
        if not kept or point[1] < kept[-1][1] * (1 - 1e-6):
            kept.append(point)
    return Front(first, second, np.array([p[:2] for p in kept]), tuple(p[2] for p in kept))


def _of_choice(one: Tried, first: str, second: str) -> list[tuple[float, float, Choice]]:
    # Not the answer of the search: what uncertainty takes may have been added since.
    problem, answer = one.problem, search(one.problem, one.start)
    if not answer.kept:
        return []
    rows = [index(OUTPUT[first]), index(OUTPUT[second])]

    def point(z):
        a, b = problem.outputs(z)[rows]
        return float(a), float(b), problem.choice

    found = [point(answer.z)]
    least = search(problem.with_(objective=second), answer.z)
    if not least.kept:
        return found
    found.append(point(least.z))
    low, high = found[1][1], found[0][1]
    z = answer.z
    if high > low * (1 + 1e-6) and low > 0:
        for cap in np.geomspace(high, low, POINTS)[1:-1]:
            there = search(problem.with_(caps={second: float(cap)}), z)
            if there.kept:
                z = there.z
                found.append(point(z))
    return found
