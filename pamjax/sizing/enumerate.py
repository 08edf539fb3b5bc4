"""Search over all choices of the catalogue: screening in one batched program, then local optimisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from scipy.stats import qmc

from pamjax.progress import Progress, ignore_progress
from pamjax.sizing.candidate import evaluate_many, locate_output
from pamjax.sizing.optimise import SearchResult, minimise_violation, search_optimum
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, SizingProblem

#: Number of candidates that screen each choice; a power of two.
_SCREENING_POINTS = 128
#: Largest number of first starts of a choice; the first feasible optimum ends them.
_FIRST_STARTS = 3
#: Largest violation from which an optimisation of the objective is started.
_MAX_NEAR_VIOLATION = 1e-3
#: Largest number of optimised choices, by rank of the screening; the design reports the number of others.
_MAX_SEARCHED_CHOICES = 300
#: Number of best choices that are optimised from many starts.
_FINAL_CHOICES = 3
#: If no choice is feasible: number of nearest choices that are searched again, and starts of each.
_INFEASIBLE_CHOICES, _INFEASIBLE_STARTS = 8, 16
#: Weight of the violation relative to ln(objective) in the ranking of choices.
_VIOLATION_WEIGHT = 10.0


@dataclass(frozen=True, eq=False)
class ChoiceResult:
    """The result of the search of one choice.

    Attributes:
        problem: optimisation problem of the choice.
        optimum: best feasible optimum; None if none was found.
        start: (free,) scaled coordinates of the best candidate: the optimum, or the smallest violation.
        violation: smallest largest violation over the searches.
        agreeing_count, start_count: number of searches that ended at the optimum, and number of starts.
    """

    problem: SizingProblem
    optimum: SearchResult | None
    start: np.ndarray
    violation: float
    agreeing_count: int = 0
    start_count: int = 1


def screen_choices(
    problems: Sequence[SizingProblem], seed: int, point_count: int = _SCREENING_POINTS
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the starts of each choice, (point_count, free), the best first, and the merit of its best start.

    The merit is ln(objective) plus a penalty for the largest violation; one batched evaluation computes all.
    """
    points = qmc.Sobol(5, rng=np.random.default_rng(seed)).random(point_count)
    c = np.concatenate([p.low + points * (p.start_high - p.low) for p in problems])
    build = jax.tree.map(lambda *x: np.repeat(np.array(x, float), point_count), *[p.build for p in problems])
    first_problem = problems[0]
    y = evaluate_many(c, build, first_problem.numbers, first_problem.task.points, first_problem.ids).reshape(
        len(problems), point_count, -1
    )
    starts, merits = [], np.zeros(len(problems))
    for row, (p, outputs, coordinates) in enumerate(
        zip(problems, y, c.reshape(len(problems), point_count, 5), strict=True)
    ):
        violation = np.maximum(-np.min(p.compute_margins(outputs), axis=1), 0.0)
        merit = (
            np.log(np.maximum(outputs[:, locate_output(OBJECTIVE_OUTPUTS[p.objective])], 1e-12))
            + _VIOLATION_WEIGHT * violation
        )
        merit = np.where(
            outputs[:, locate_output("unsolved")] > 0, np.inf, np.where(np.isfinite(merit), merit, np.inf)
        )
        starts.append(np.array([p.to_scaled(coordinates[k]) for k in np.argsort(merit, kind="stable")]))
        merits[row] = merit.min()
    return starts, merits


def search_choices(
    problems: Sequence[SizingProblem],
    *,
    starts: int,
    seed: int,
    method: str = "slsqp",
    progress: Progress = ignore_progress,
) -> tuple[list[ChoiceResult], int]:
    """Return the optimised choices, and the number of choices that were only screened.

    Args:
        problems: one for each choice.
        starts: number of starts of each of the best choices.
        seed: seed of the screening.
        method: one of `optimise.METHODS`, for the final searches.
        progress: called with the current step and the completed fraction.

    Returns:
        the results, the best first, and the number of choices that were screened but not optimised.
    """
    starts_by_choice, _ = screen_choices(problems, seed)
    order = sorted(
        range(len(problems)), key=lambda k: _compute_penalised_objective(problems[k], starts_by_choice[k][0])
    )
    results = []
    for rank, k in enumerate(order[:_MAX_SEARCHED_CHOICES]):
        progress(
            f"choice {rank + 1} of {min(len(order), _MAX_SEARCHED_CHOICES)}",
            rank / min(len(order), _MAX_SEARCHED_CHOICES),
        )
        results.append(search_choice(problems[k], starts_by_choice[k][:_FIRST_STARTS], stop_after=1))
    results.sort(key=rank_result)
    starts_by_problem = {
        id(problem): choice_starts for problem, choice_starts in zip(problems, starts_by_choice, strict=True)
    }
    if results[0].optimum is None:
        # Most searches for the smallest violation end at a local minimum: more starts are needed.
        nearest = results[:_INFEASIBLE_CHOICES]
        results[:_INFEASIBLE_CHOICES] = [
            search_choice(
                result.problem, starts_by_problem[id(result.problem)][:_INFEASIBLE_STARTS], stop_after=1
            )
            for result in nearest
        ]
        results.sort(key=rank_result)
    for position, result in enumerate(results[:_FINAL_CHOICES]):
        if result.optimum is not None:
            extra_starts = np.concatenate(
                [result.optimum.z[None], starts_by_problem[id(result.problem)][1:starts]]
            )
            refined_result = search_choice(result.problem, extra_starts, method)
            results[position] = refined_result if refined_result.optimum is not None else result
    results.sort(key=rank_result)
    return results, max(0, len(order) - _MAX_SEARCHED_CHOICES)


def _compute_penalised_objective(problem: SizingProblem, z: np.ndarray) -> float:
    value, _, margins, _ = problem.evaluate(z)
    return value + _VIOLATION_WEIGHT * max(0.0, -float(np.min(margins)))


def rank_result(result: ChoiceResult) -> tuple[int, float]:
    """Return the sort key of a result: feasible ones by objective, then the others by violation."""
    return (0, result.optimum.log_objective) if result.optimum is not None else (1, result.violation)


def search_choice(
    problem: SizingProblem, starts: np.ndarray, method: str = "slsqp", stop_after: int = 1000
) -> ChoiceResult:
    """Return the best of several searches of one choice; without a feasible one, the smallest violation.

    Args:
        stop_after: number of feasible optima after which the search ends.
    """
    best: SearchResult | None = None
    objectives: list[float] = []
    least_violation, best_start = np.inf, starts[0]
    for start in starts:
        if float(np.min(problem.evaluate(start)[2])) < 0:
            # From an infeasible start, minimising the objective would run off to the smallest muscle.
            start, violation, _ = minimise_violation(problem, start)
            if violation < least_violation:
                least_violation, best_start = violation, start
            if violation > _MAX_NEAR_VIOLATION:
                continue
        optimum = search_optimum(problem, start, method)
        if optimum.is_feasible:
            objectives.append(optimum.log_objective)
            least_violation = 0.0
            if best is None or optimum.log_objective < best.log_objective:
                best, best_start = optimum, optimum.z
            if len(objectives) >= stop_after:
                break
    agreeing_count = (
        sum(abs(value - best.log_objective) < 1e-4 for value in objectives) if best is not None else 0
    )
    return ChoiceResult(problem, best, best_start, float(least_violation), agreeing_count, len(starts))
