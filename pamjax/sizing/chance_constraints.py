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

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import MuscleBuild, evaluate_many
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.optimise import MARGIN_TOLERANCE, SearchResult, minimise_violation, search_optimum
from pamjax.sizing.problem import SizingProblem
from pamjax.sizing.schema import Tolerance

#: Draws while searching, and for the probability that is told. A margin found on few draws fits their gaps:
#: of three sets of 256 that held with 0.9, others held with 0.88, 0.89, 0.91; of 1,024 with 0.91 to 0.92.
SEARCH_DRAWS, REPORT_DRAWS = 1024, 4096
#: Times that margins are found again, at most.
MAX_ROUNDS = 12
#: Rounds after which the draws follow the candidate no more.
TRACKING_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class BuildDraws:
    """Draws of what is not known of one choice: `made` and `numbers` with (k,) in place of a number."""

    build: MuscleBuild
    numbers: dict[str, np.ndarray]
    count: int


def draw_builds(
    problem: SizingProblem, transfer: CalibrationTransfer, tolerance: Tolerance, count: int, seed: int
) -> BuildDraws:
    """Draws for a choice."""
    random = np.random.default_rng([seed, 21])
    choice, build = problem.choice, problem.build
    size = len(next(iter(transfer.draws.values()))) if transfer.draws else 1
    # One set of rows for all numbers: they know each other.
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
    """(draws, requirements) smallest room of each requirement at each draw, nothing kept back."""
    c = np.tile(problem.to_coordinates(z), (draws.count, 1))
    y = evaluate_many(c, draws.build, draws.numbers, problem.task.points, problem.ids)
    y = np.where(np.isfinite(y), y, 1e9)
    return np.stack(
        [requirement.compute_margins(y).min(axis=1) for requirement in problem.task.requirements], axis=1
    )


def estimate_probability(problem: SizingProblem, z: np.ndarray, draws: BuildDraws) -> float:
    """That every requirement holds."""
    return float(np.mean(np.all(compute_margins(problem, z, draws) >= -MARGIN_TOLERANCE, axis=1)))


def estimate_probabilities(problem: SizingProblem, z: np.ndarray, draws: BuildDraws) -> dict[str, float]:
    """That each requirement holds, by key."""
    shares = np.mean(compute_margins(problem, z, draws) >= -MARGIN_TOLERANCE, axis=0)
    return {
        requirement.key: float(p) for requirement, p in zip(problem.task.requirements, shares, strict=True)
    }


def meet_probability(result: ChoiceResult, draws: BuildDraws, target: float) -> ChoiceResult | None:
    """The best candidate of a choice whose requirements hold together with a probability.

    Returns:
        None where none was found.
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
                # What the shift of the draws with the candidate takes for good, by a draw's worth.
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
    """The first search that keeps everything."""
    for start in starts:
        for begin in (start, minimise_violation(problem, start)[0]):
            optimum = search_optimum(problem, begin)
            if optimum.is_feasible:
                return optimum
    return None


def _compute_back_off(shifts: np.ndarray, own_margins: np.ndarray, target: float) -> np.ndarray:
    """(requirements,) margin to keep back, at the loosest common level that holds them together."""
    low, high = 0.0, 1 - target
    for _ in range(30):
        level = 0.5 * (low + high)
        back_off = np.maximum(-np.quantile(shifts, level, axis=0, method="lower"), 0.0)
        joint_probability = np.mean(
            np.all(np.maximum(own_margins, back_off) + shifts >= -MARGIN_TOLERANCE, axis=1)
        )
        low, high = (level, high) if joint_probability >= target else (low, level)
    return np.maximum(-np.quantile(shifts, low, axis=0, method="lower"), 0.0) * (1 + 1e-6)
