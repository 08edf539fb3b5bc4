"""Requirements that hold with a stated probability: draws of what is not known, and the margin they take.

What is drawn: posterior draws of a calibration (its materials and friction), else the range that the table's
sources span, evenly; how exactly it is built, if the spec says so; what the model misses of the force.

Every requirement j keeps back a margin b_j, the part of its draws below the candidate's own value that is cut
off at one level for all; the level is the loosest at which all of them together hold with the probability
wanted. The candidate is searched again with b, drawn again, until both agree. What is left of the draws'
dependence on the candidate shows in the probability that is told, which is found from draws of another seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.sizing.calibration import Handed
from pamjax.sizing.candidate import Made, many
from pamjax.sizing.enumerate import Tried
from pamjax.sizing.optimise import KEPT, Answer, relax, search
from pamjax.sizing.problem import Problem
from pamjax.sizing.schema import Tolerance

#: Draws while searching, and for the probability that is told. A margin found on few draws fits their gaps:
#: of three sets of 256 that held with 0.9, others held with 0.88, 0.89, 0.91; of 1,024 with 0.91 to 0.92.
DRAWS, TOLD = 1024, 4096
#: Times that margins are found again, at most.
ROUNDS = 12
#: Rounds after which the draws follow the candidate no more.
SETTLED = 3


@dataclass(frozen=True, eq=False)
class Doubt:
    """Draws of what is not known of one choice: `made` and `numbers` with (k,) in place of a number."""

    made: Made
    numbers: dict[str, np.ndarray]
    count: int


def draw(problem: Problem, handed: Handed, tolerance: Tolerance, count: int, seed: int) -> Doubt:
    """Draws for a choice."""
    random = np.random.default_rng([seed, 21])
    choice, made = problem.choice, problem.made
    size = len(next(iter(handed.draws.values()))) if handed.draws else 1
    # One set of rows for all numbers: they know each other.
    rows = random.integers(size, size=count)

    def spread(known) -> np.ndarray:
        return random.uniform(known.low, known.high, count)

    modulus, shear = spread(choice.thread.modulus), spread(choice.bladder.modulus)
    if handed.thread_modulus is not None and handed.thread == choice.thread.name:
        modulus = made.modulus * _ratio(handed, "thread", rows)
    if handed.shear is not None and handed.bladder == choice.bladder.name:
        shear = made.shear * _ratio(handed, "shear", rows)
    strength = spread(choice.thread.strength)

    def off(sd: float | None) -> np.ndarray:
        return (sd or 0.0) * random.standard_normal(count)

    drawn = made._replace(
        modulus=modulus,
        shear=shear,
        strength=strength,
        off_length=off(tolerance.rest_length),
        off_thread=off(tolerance.thread_length),
        off_turns=off(tolerance.turns),
        off_wall=off(tolerance.wall),
        off_force=off(handed.discrepancy),
    )
    numbers = {
        name: handed.draws[name][rows] if name in handed.draws else np.full(count, value)
        for name, value in problem.numbers.items()
    }
    return Doubt(drawn, numbers, count)


def _ratio(handed: Handed, name: str, rows: np.ndarray) -> np.ndarray:
    return handed.draws[name][rows] if name in handed.draws else np.ones(rows.size)


def margins(problem: Problem, z: np.ndarray, doubt: Doubt) -> np.ndarray:
    """(draws, requirements) smallest room of each requirement at each draw, nothing kept back."""
    c = np.tile(problem.coordinates(z), (doubt.count, 1))
    y = many(c, doubt.made, doubt.numbers, problem.asked.places, problem.ids)
    y = np.where(np.isfinite(y), y, 1e9)
    return np.stack([one.margins(y).min(axis=1) for one in problem.asked.requirements], axis=1)


def probability(problem: Problem, z: np.ndarray, doubt: Doubt) -> float:
    """That every requirement holds."""
    return float(np.mean(np.all(margins(problem, z, doubt) >= -KEPT, axis=1)))


def by_requirement(problem: Problem, z: np.ndarray, doubt: Doubt) -> dict[str, float]:
    """That each requirement holds, by key."""
    held = np.mean(margins(problem, z, doubt) >= -KEPT, axis=0)
    return {one.key: float(p) for one, p in zip(problem.asked.requirements, held, strict=True)}


def hold(tried: Tried, doubt: Doubt, wanted: float) -> Tried | None:
    """The best candidate of a choice whose requirements hold together with a probability.

    Returns:
        None where none was found.
    """
    problem, answer = tried.problem, tried.answer
    if answer is None or tried.answer is None:
        return None
    keys = [one.key for one in problem.asked.requirements]
    z, back, aim = answer.z, np.zeros(len(keys)), wanted
    for turn in range(ROUNDS):
        drawn = margins(problem, z, doubt)
        together = float(np.mean(np.all(drawn >= -KEPT, axis=1)))
        if back.any():
            if together >= wanted:
                break
            if turn >= SETTLED:
                # What the shift of the draws with the candidate takes for good, by a draw's worth.
                aim = min(aim + 1 / doubt.count, 1 - 1 / doubt.count)
        y = problem.outputs(z)
        own = np.array([float(np.min(one.margins(y))) for one in problem.asked.requirements])
        back = _kept_back(drawn - own, own, aim)
        problem = tried.problem.with_(back_off=dict(zip(keys, back, strict=True)))
        answer = _again(problem, (z, tried.answer.z, tried.start))
        if answer is None:
            return None
        z = answer.z
    if np.mean(np.all(margins(problem, z, doubt) >= -KEPT, axis=1)) < wanted:
        return None
    return Tried(problem, answer, z, 0.0, tried.agreeing, tried.starts)


def _again(problem: Problem, starts: tuple[np.ndarray, ...]) -> Answer | None:
    """The first search that keeps everything."""
    for start in starts:
        for begin in (start, relax(problem, start)[0]):
            answer = search(problem, begin)
            if answer.kept:
                return answer
    return None


def _kept_back(off: np.ndarray, own: np.ndarray, wanted: float) -> np.ndarray:
    """(requirements,) margin to keep back, at the loosest common level that holds them together."""
    low, high = 0.0, 1 - wanted
    for _ in range(30):
        level = 0.5 * (low + high)
        back = np.maximum(-np.quantile(off, level, axis=0, method="lower"), 0.0)
        together = np.mean(np.all(np.maximum(own, back) + off >= -KEPT, axis=1))
        low, high = (level, high) if together >= wanted else (low, level)
    return np.maximum(-np.quantile(off, low, axis=0, method="lower"), 0.0) * (1 + 1e-6)
