"""Every choice of the catalogue: all looked at in one batched program, the promising ones searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from scipy.stats import qmc

from pamjax.progress import Progress, silent
from pamjax.sizing.candidate import index, many
from pamjax.sizing.optimise import Answer, relax, search
from pamjax.sizing.problem import OUTPUT, Problem

#: Candidates by which each choice is looked at first; a power of two.
LOOKS = 128
#: Starts of a choice, of which the first that keeps everything ends its search.
FIRST = 3
#: Largest broken margin from which a search for the best is worth its while.
NEARLY = 1e-3
#: Choices that are searched, the most promising first; what is left out is said.
SEARCHED = 300
#: Choices that are searched from many starts.
FINAL = 3
#: Where nothing fits: choices, the nearest first, that are searched again, and starts of each.
NEAREST, LOST = 8, 16
#: How much a broken margin weighs against the objective when choices are ranked.
WEIGH = 10.0


@dataclass(frozen=True, eq=False)
class Tried:
    """A choice, and the best that was found of it.

    Attributes:
        problem: of the choice.
        answer: the best that keeps every requirement; None where none was found.
        start: (free,) scaled, the most promising candidate of the first look.
        broken: least largest broken margin that was seen.
        agreeing, starts: how many searches ended at the best, and how many there were.
    """

    problem: Problem
    answer: Answer | None
    start: np.ndarray
    broken: float
    agreeing: int = 0
    starts: int = 1


def look(problems: Sequence[Problem], seed: int) -> list[np.ndarray]:
    """The most promising starts of each choice, (LOOKS, free) best first, by one batched program."""
    points = qmc.Sobol(5, rng=np.random.default_rng(seed)).random(LOOKS)
    c = np.concatenate([p.low + points * (p.usual - p.low) for p in problems])
    made = jax.tree.map(lambda *x: np.repeat(np.array(x, float), LOOKS), *[p.made for p in problems])
    one = problems[0]
    y = many(c, made, one.numbers, one.asked.places, one.ids).reshape(len(problems), LOOKS, -1)
    found = []
    for p, rows, at in zip(problems, y, c.reshape(len(problems), LOOKS, 5), strict=True):
        broken = np.maximum(-np.min(p.margins(rows), axis=1), 0.0)
        merit = np.log(np.maximum(rows[:, index(OUTPUT[p.objective])], 1e-12)) + WEIGH * broken
        merit = np.where(rows[:, index("unsolved")] > 0, np.inf, np.where(np.isfinite(merit), merit, np.inf))
        found.append(np.array([p.scaled(at[k]) for k in np.argsort(merit, kind="stable")]))
    return found


def best_of(
    problems: Sequence[Problem],
    *,
    starts: int,
    seed: int,
    method: str = "slsqp",
    progress: Progress = silent,
) -> tuple[list[Tried], int]:
    """Search the choices.

    Args:
        problems: one for each choice.
        starts: of each of the best few choices.
        seed: of the first look.
        method: one of `optimise.METHODS`, for the last searches.

    Returns:
        what was tried, the best first, and how many choices were looked at but not searched.
    """
    begin = look(problems, seed)
    order = sorted(range(len(problems)), key=lambda k: _promise(problems[k], begin[k][0]))
    tried = []
    for rank, k in enumerate(order[:SEARCHED]):
        progress(f"choice {rank + 1} of {min(len(order), SEARCHED)}", rank / min(len(order), SEARCHED))
        tried.append(_one(problems[k], begin[k][:FIRST], enough=1))
    tried.sort(key=_rank)
    looked = {id(problem): at for problem, at in zip(problems, begin, strict=True)}
    if tried[0].answer is None:
        # The way to what nearly fits is long, and most searches get stuck on it.
        near = tried[:NEAREST]
        tried[:NEAREST] = [_one(one.problem, looked[id(one.problem)][:LOST], enough=1) for one in near]
        tried.sort(key=_rank)
    for place, one in enumerate(tried[:FINAL]):
        if one.answer is not None:
            extra = np.concatenate([one.answer.z[None], looked[id(one.problem)][1:starts]])
            again = _one(one.problem, extra, method)
            tried[place] = again if again.answer is not None else one
    tried.sort(key=_rank)
    return tried, max(0, len(order) - SEARCHED)


def _promise(problem: Problem, z: np.ndarray) -> float:
    value, _, margins, _ = problem.at(z)
    return value + WEIGH * max(0.0, -float(np.min(margins)))


def _rank(one: Tried) -> tuple[int, float]:
    return (0, one.answer.value) if one.answer is not None else (1, one.broken)


def _one(problem: Problem, starts: np.ndarray, method: str = "slsqp", enough: int = 1000) -> Tried:
    """The best of several searches of one choice; where none keeps everything, what is least broken.

    Args:
        enough: answers after which no further start is tried.
    """
    best: Answer | None = None
    ends: list[float] = []
    least, where = np.inf, starts[0]
    for start in starts:
        if float(np.min(problem.at(start)[2])) < 0:
            # From where something is broken a search for the best runs off to the smallest muscle there is.
            start, s, _ = relax(problem, start)
            if s < least:
                least, where = s, start
            if s > NEARLY:
                continue
        answer = search(problem, start, method)
        if answer.kept:
            ends.append(answer.value)
            least = 0.0
            if best is None or answer.value < best.value:
                best, where = answer, answer.z
            if len(ends) >= enough:
                break
    agreeing = sum(abs(value - best.value) < 1e-4 for value in ends) if best is not None else 0
    return Tried(problem, best, where, float(least), agreeing, len(starts))
