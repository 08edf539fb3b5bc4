"""Chance constraints: a design whose requirements all hold with a required probability.

Drawn: materials and friction from the posterior of a calibration, else uniformly over the range of the
table's sources; manufacturing errors, if the spec states tolerances; and the model error of the force.

Each requirement j has a back-off b_j: its margin without errors must be at least b_j. b_j is a quantile of
the margin's decrease over the draws. The quantile's level is the same for all requirements: the largest at
which all hold together with the required probability. The candidate is optimised with b, and b is computed
again, until the probability is reached. The reported probability is estimated from independent draws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import MuscleBuild, evaluate_many
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.optimise import MARGIN_TOLERANCE, SearchResult, minimise_violation, search_optimum
from pamjax.sizing.problem import SizingProblem
from pamjax.sizing.schema import Tolerance

#: Numbers of draws for the search and for the reported probability. Few draws overfit: designs for 0.9 on
#: three sets of 256 draws reached 0.88, 0.89 and 0.91 on independent draws, and 0.91 to 0.92 with 1,024.
SEARCH_DRAWS, REPORT_DRAWS = 1024, 4096
#: Largest number of updates of the back-off.
MAX_ROUNDS = 12
#: Number of rounds after which the target of the search is raised if the probability is not reached.
TRACKING_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class BuildDraws:
    """Draws of the uncertain quantities of one choice: `build` and `numbers` with arrays (k,) for scalars."""

    build: MuscleBuild
    numbers: dict[str, np.ndarray]
    count: int


def draw_builds(
    problem: SizingProblem, transfer: CalibrationTransfer, tolerance: Tolerance, count: int, seed: int
) -> BuildDraws:
    """Return random draws of the uncertain quantities of one choice."""
    random = np.random.default_rng([seed, 21])
    choice, build = problem.choice, problem.build
    size = len(next(iter(transfer.draws.values()))) if transfer.draws else 1
    # The same posterior draws for all parameters, to keep their correlation.
    rows = random.integers(size, size=count)

    def draw_property(known_range) -> np.ndarray:
        return random.uniform(known_range.low, known_range.high, count)

    modulus, shear = draw_property(choice.thread.modulus), draw_property(choice.bladder.modulus)
    if transfer.thread_modulus is not None and transfer.thread == choice.thread.name:
        modulus = build.modulus * _draw_ratio(transfer, "thread", rows)
    if transfer.shear is not None and transfer.bladder == choice.bladder.name:
        shear = build.shear * _draw_ratio(transfer, "shear", rows)
    strength = draw_property(choice.thread.strength)

    def draw_error(sd: float | None) -> np.ndarray:
        return (sd or 0.0) * random.standard_normal(count)

    drawn_build = build._replace(
        modulus=modulus,
        shear=shear,
        strength=strength,
        length_error=draw_error(tolerance.rest_length),
        thread_error=draw_error(tolerance.thread_length),
        turns_error=draw_error(tolerance.turns),
        wall_error=draw_error(tolerance.wall),
        force_error=draw_error(transfer.discrepancy),
    )
    numbers = {
        name: transfer.draws[name][rows] if name in transfer.draws else np.full(count, value)
        for name, value in problem.numbers.items()
    }
    return BuildDraws(drawn_build, numbers, count)


def _draw_ratio(transfer: CalibrationTransfer, name: str, rows: np.ndarray) -> np.ndarray:
    return transfer.draws[name][rows] if name in transfer.draws else np.ones(rows.size)


def compute_margins(problem: SizingProblem, z: np.ndarray, draws: BuildDraws) -> np.ndarray:
    """Return the smallest margin of each requirement in each draw, (draws, requirements), no back-off."""
    c = np.tile(problem.to_coordinates(z), (draws.count, 1))
    y = evaluate_many(c, draws.build, draws.numbers, problem.task.points, problem.ids)
    y = np.where(np.isfinite(y), y, 1e9)
    return np.stack(
        [requirement.compute_margins(y).min(axis=1) for requirement in problem.task.requirements], axis=1
    )


def estimate_probability(problem: SizingProblem, z: np.ndarray, draws: BuildDraws) -> float:
    """Return the probability that all requirements hold together."""
    return float(np.mean(np.all(compute_margins(problem, z, draws) >= -MARGIN_TOLERANCE, axis=1)))


def estimate_probabilities(problem: SizingProblem, z: np.ndarray, draws: BuildDraws) -> dict[str, float]:
    """Return the probability of each requirement, by key."""
    shares = np.mean(compute_margins(problem, z, draws) >= -MARGIN_TOLERANCE, axis=0)
    return {
        requirement.key: float(p) for requirement, p in zip(problem.task.requirements, shares, strict=True)
    }


def meet_probability(result: ChoiceResult, draws: BuildDraws, target: float) -> ChoiceResult | None:
    """Return the best candidate of a choice whose requirements hold together with a target probability.

    Returns:
        the result, or None if no such candidate was found.
    """
    problem, optimum = result.problem, result.optimum
    if optimum is None or result.optimum is None:
        return None
    keys = [requirement.key for requirement in problem.task.requirements]
    z, back_off, search_target = optimum.z, np.zeros(len(keys)), target
    for round_number in range(MAX_ROUNDS):
        drawn_margins = compute_margins(problem, z, draws)
        joint_probability = float(np.mean(np.all(drawn_margins >= -MARGIN_TOLERANCE, axis=1)))
        if back_off.any():
            if joint_probability >= target:
                break
            if round_number >= TRACKING_ROUNDS:
                # The decrease of margins depends on the candidate: raise the target by one draw.
                search_target = min(search_target + 1 / draws.count, 1 - 1 / draws.count)
        y = problem.compute_outputs(z)
        own_margins = np.array(
            [float(np.min(requirement.compute_margins(y))) for requirement in problem.task.requirements]
        )
        back_off = _compute_back_off(drawn_margins - own_margins, own_margins, search_target)
        problem = result.problem.copy_with(back_off=dict(zip(keys, back_off, strict=True)))
        optimum = _search_feasible(problem, (z, result.optimum.z, result.start))
        if optimum is None:
            return None
        z = optimum.z
    if np.mean(np.all(compute_margins(problem, z, draws) >= -MARGIN_TOLERANCE, axis=1)) < target:
        return None
    return ChoiceResult(problem, optimum, z, 0.0, result.agreeing_count, result.start_count)


def _search_feasible(problem: SizingProblem, starts: tuple[np.ndarray, ...]) -> SearchResult | None:
    """Return the first feasible optimum over several starts, or None."""
    for start in starts:
        for initial in (start, minimise_violation(problem, start)[0]):
            optimum = search_optimum(problem, initial)
            if optimum.is_feasible:
                return optimum
    return None


def _compute_back_off(shifts: np.ndarray, own_margins: np.ndarray, target: float) -> np.ndarray:
    """Return the back-off, (requirements,), at the largest common level that reaches the target."""
    low, high = 0.0, 1 - target
    for _ in range(30):
        level = 0.5 * (low + high)
        back_off = np.maximum(-np.quantile(shifts, level, axis=0, method="lower"), 0.0)
        joint_probability = np.mean(
            np.all(np.maximum(own_margins, back_off) + shifts >= -MARGIN_TOLERANCE, axis=1)
        )
        low, high = (level, high) if joint_probability >= target else (low, level)
    return np.maximum(-np.quantile(shifts, low, axis=0, method="lower"), 0.0) * (1 + 1e-6)
