"""Chance constraints: a design whose requirements all hold with a required probability.

Materials and friction are drawn from the posterior of a calibration, else uniformly over the range of the
table's sources. Errors of manufacture, of the set length and of the pressure (`tolerances.py`) are drawn too,
and the model error of the force. The draws are of three seeds: those of the search, those that select the
design, and those of the reported probability. The reported probability is thus computed once, from draws that
no choice used.

Each requirement j has a back-off b_j: its margin without errors must be at least b_j. b_j is a quantile of
the margin's decrease over the draws. The quantile's level is the same for all requirements: the largest at
which all hold together with the required probability. The candidate is optimised with b, and b is computed
again, until the probability is reached.

If no candidate reaches the probability, the best one has the largest share s of the back-off: its margins are
at least s b_j, and s = 1 would be sufficient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import MuscleBuild, evaluate_many, locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.optimise import MARGIN_TOLERANCE, SearchResult, minimise_violation, search_optimum
from pamjax.sizing.problem import SizingProblem
from pamjax.sizing.specification.materials import PropertyRange
from pamjax.sizing.specification.schema import Tolerance
from pamjax.sizing.tolerances import BuildErrors, choose_errors

#: Numbers of draws for the search, and for the selection and the reported probability; powers of two.
SEARCH_DRAWS, REPORT_DRAWS = 1024, 4096
#: Largest number of updates of the back-off.
_MAX_ROUNDS = 12
#: Number of rounds after which the target of the search is raised if the probability is not reached.
_TRACKING_ROUNDS = 3


#: Drawn quantities, each one dimension of the Sobol sequence.
_DRAWN = (
    "posterior", "modulus", "shear", "strength", "rest_length", "thread_length", "turns", "wall", "force",
    "position", "pressure",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class BuildDraws:
    """Draws of the uncertain quantities of one choice: `build` and `numbers` with arrays (k,) for scalars."""

    build: MuscleBuild
    numbers: dict[str, np.ndarray]
    count: int


def draw_builds(
    problem: SizingProblem, transfer: CalibrationTransfer, errors: BuildErrors, count: int, seed: int
) -> BuildDraws:
    """Return draws of the uncertain quantities of one choice: a scrambled Sobol sequence, see `_DRAWN`.

    Its probabilities have a smaller sampling error than those of random draws.
    """
    choice, build = problem.choice, problem.build
    shares = qmc.Sobol(len(_DRAWN), rng=np.random.default_rng([seed, 21])).random_base2(
        max(1, math.ceil(math.log2(count)))
    )
    share: dict[str, np.ndarray] = dict(zip(_DRAWN, np.clip(shares[:count], 1e-9, 1 - 1e-9).T, strict=True))
    size = len(next(iter(transfer.draws.values()))) if transfer.draws else 1
    # The same posterior draws for all parameters, to keep their correlation.
    rows = (share["posterior"] * size).astype(int)

    def draw_property(name: str, known_range: PropertyRange) -> np.ndarray:
        return known_range.low + share[name] * (known_range.high - known_range.low)

    def draw_error(name: str, sd: float) -> np.ndarray:
        return sd * ndtri(share[name])

    modulus = draw_property("modulus", choice.thread.modulus)
    shear = draw_property("shear", choice.bladder.modulus)
    if transfer.thread_modulus is not None and transfer.thread == choice.thread.name:
        modulus = build.modulus * _draw_ratio(transfer, "thread", rows)
    if transfer.shear is not None and transfer.bladder == choice.bladder.name:
        shear = build.shear * _draw_ratio(transfer, "shear", rows)
    drawn_build = build._replace(
        modulus=modulus,
        shear=shear,
        strength=draw_property("strength", choice.thread.strength),
        length_error=draw_error("rest_length", errors.rest_length),
        thread_error=draw_error("thread_length", errors.thread_length),
        turns_error=draw_error("turns", errors.turns),
        wall_error=draw_error("wall", errors.wall),
        force_error=draw_error("force", transfer.discrepancy),
        position_error=draw_error("position", errors.position),
        pressure_error=draw_error("pressure", errors.pressure),
    )
    numbers = {
        name: transfer.draws[name][rows] if name in transfer.draws else np.full(count, value)
        for name, value in problem.numbers.items()
    }
    return BuildDraws(drawn_build, numbers, count)


def draw_reported_builds(
    problem: SizingProblem, transfer: CalibrationTransfer, errors: BuildErrors, seed: int
) -> BuildDraws:
    """Return the draws of the reported probability, independent of those of the search and the selection.

    Args:
        seed: seed of the search; the selection uses the next one.
    """
    return draw_builds(problem, transfer, errors, REPORT_DRAWS, seed + 2)


def compute_standard_error(probability: float) -> float:
    """Return the standard error of a probability from `REPORT_DRAWS` random draws.

    >>> round(compute_standard_error(0.9), 4)
    0.0047
    """
    return math.sqrt(probability * (1 - probability) / REPORT_DRAWS)


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


def estimate_force_sds(problem: SizingProblem, z: np.ndarray, draws: BuildDraws) -> np.ndarray:
    """Return the standard deviation of the force over the draws at each operating point, N, (points,)."""
    c = np.tile(problem.to_coordinates(z), (draws.count, 1))
    y = evaluate_many(c, draws.build, draws.numbers, problem.task.points, problem.ids)
    columns = [locate_output("force", k) for k in range(problem.task.point_count)]
    return np.nanstd(np.where(np.isfinite(y), y, np.nan)[:, columns], axis=0, ddof=1)


def choose_problem_errors(result: ChoiceResult, tolerance: Tolerance) -> BuildErrors:
    """Return the standard deviations of the errors of a choice, at its best candidate."""
    problem, z = result.problem, result.start
    y = problem.compute_outputs(z)
    dimensions = problem.name_coordinates(z) | {
        name: float(y[locate_output(name)]) for name in ("thread_length", "turns")
    }
    return choose_errors(tolerance, problem.choice, dimensions)


def meet_probability(result: ChoiceResult, draws: BuildDraws, target: float) -> tuple[ChoiceResult, float]:
    """Return the best candidate of a choice whose requirements hold together with a target probability.

    Returns:
        the result and its probability over the draws. If the target is not reached, it is the candidate with
        the largest probability that was found.
    """
    optimum, best = result.optimum, (result, 0.0)
    if optimum is None:
        return best
    problem, keys = result.problem, [requirement.key for requirement in result.problem.task.requirements]
    first_z = z = optimum.z
    back_off, search_target = np.zeros(len(keys)), target
    for round_number in range(_MAX_ROUNDS):
        drawn_margins = compute_margins(problem, z, draws)
        joint_probability = float(np.mean(np.all(drawn_margins >= -MARGIN_TOLERANCE, axis=1)))
        if joint_probability > best[1] or not back_off.any():
            candidate = ChoiceResult(problem, optimum, z, 0.0, result.agreeing_count, result.start_count)
            best = candidate, joint_probability
        if joint_probability >= target:
            break
        if round_number >= _TRACKING_ROUNDS:
            # The decrease of margins depends on the candidate: raise the target by a few draws.
            search_target = min(search_target + 4 / draws.count, 1 - 1 / draws.count)
        y = problem.compute_outputs(z)
        own_margins = np.array(
            [float(np.min(requirement.compute_margins(y))) for requirement in problem.task.requirements]
        )
        back_off = _compute_back_off(drawn_margins - own_margins, own_margins, search_target)
        strict = result.problem.copy_with(back_off=dict(zip(keys, back_off, strict=True)))
        strict_optimum = _search_feasible(strict, (z, first_z, result.start))
        if strict_optimum is None:
            relaxed = _share_back_off(strict, z)
            if relaxed is None or round_number > _TRACKING_ROUNDS:
                break
            strict, strict_optimum = relaxed
        problem, optimum, z = strict, strict_optimum, strict_optimum.z
    return best


def _share_back_off(problem: SizingProblem, start: np.ndarray) -> tuple[SizingProblem, SearchResult] | None:
    """Return the problem with the largest feasible share of its back-off, and its optimum."""
    z, missing_share, _ = minimise_violation(problem, start, problem.row_back_off)
    kept_share = max(0.0, 1 - missing_share * (1 + 1e-3) - 1e-6)
    shared = problem.copy_with(back_off={key: kept_share * b for key, b in problem.back_off.items()})
    optimum = search_optimum(shared, z)
    if not optimum.is_feasible:
        return None
    return shared, optimum


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
