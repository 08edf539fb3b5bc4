"""The front between two objectives: the best of one for each cap on the other, over the best choices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.sizing.candidate import index
from pamjax.sizing.enumerate import Tried
from pamjax.sizing.optimise import search
from pamjax.sizing.problem import OUTPUT, Choice, Problem

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
    ends = [_ends(one, second) for one in tried if one.answer is not None]
    ends = [each for each in ends if each][:CHOICES]
    if not ends:
        return Front(first, second, np.zeros((0, 2)), ())
    rows = [index(OUTPUT[first]), index(OUTPUT[second])]

    def point(one: Problem, z: np.ndarray) -> tuple[float, float, Choice]:
        a, b = one.outputs(z)[rows]
        return float(a), float(b), one.choice

    points = [point(one, z) for each in ends for one, z in each]
    start, stop = min(points, key=lambda p: p[0]), min(points, key=lambda p: p[1])
    found = [start, stop]
    if start[1] > stop[1] * (1 + 1e-6) and stop[1] > 0:
        # The same caps for all choices: points of different caps would hide each other by chance.
        for cap in np.geomspace(start[1], stop[1], POINTS)[1:-1]:
            under = [point(*there) for each in ends if (there := _capped(each, second, float(cap)))]
            found += [min(under, key=lambda p: p[0])] if under else []
    return _none_worse(first, second, found)


def _ends(one: Tried, second: str) -> list[tuple[Problem, np.ndarray]]:
    """A choice's least of the first objective, and of the second."""
    # Not the answer of the search: what uncertainty takes may have been added since.
    answer = search(one.problem, one.start)
    if not answer.kept:
        return []
    least = search(one.problem.with_(objective=second), answer.z)
    return [(one.problem, end.z) for end in (answer, least) if end.kept]


def _capped(
    ends: list[tuple[Problem, np.ndarray]], second: str, cap: float
) -> tuple[Problem, np.ndarray] | None:
    """A choice's least of the first objective under a cap on the second; None where it is not found."""
    found = [search(one.with_(caps={second: cap}), z) for one, z in ends]
    kept = [answer for answer in found if answer.kept]
    return (ends[0][0], min(kept, key=lambda answer: answer.value).z) if kept else None


def _none_worse(first: str, second: str, points: list[tuple[float, float, Choice]]) -> Front:
    """Those that no other beats in both."""
    kept: list[tuple[float, float, Choice]] = []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if not kept or point[1] < kept[-1][1] * (1 - 1e-6):
            kept.append(point)
    return Front(first, second, np.array([p[:2] for p in kept]), tuple(p[2] for p in kept))
