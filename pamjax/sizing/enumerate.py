"""Every choice of the catalogue: all looked at in one batched program, the promising ones searched."""

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

#: Candidates by which each choice is looked at first; a power of two.
SCREENING_POINTS = 128
#: Starts of a choice, of which the first that keeps everything ends its search.
FIRST_STARTS = 3
#: Largest broken margin from which a search for the best is worth its while.
MAX_NEAR_VIOLATION = 1e-3
#: Choices that are searched, the most promising first; what is left out is said.
MAX_SEARCHED_CHOICES = 300
#: Choices that are searched from many starts.
FINAL_CHOICES = 3
#: Where nothing fits: choices, the nearest first, that are searched again, and starts of each.
INFEASIBLE_CHOICES, INFEASIBLE_STARTS = 8, 16
#: How much a broken margin weighs against the objective when choices are ranked.
VIOLATION_WEIGHT = 10.0


@dataclass(frozen=True, eq=False)
class ChoiceResult:
    """A choice, and the best that was found of it.

    Attributes:
        problem: of the choice.
        optimum: the best that keeps every requirement; None where none was found.
        start: (free,) scaled, the most promising candidate of the first look.
        violation: least largest broken margin that was seen.
        agreeing_count, start_count: how many searches ended at the best, and how many there were.
    """

    problem: SizingProblem
    optimum: SearchResult | None
    start: np.ndarray
    violation: float
    agreeing_count: int = 0
    start_count: int = 1


def screen_choices(problems: Sequence[SizingProblem], seed: int) -> list[np.ndarray]:
    """The most promising starts of each choice, (SCREENING_POINTS, free) best first, by one batched
    program.
    """
    points = qmc.Sobol(5, rng=np.random.default_rng(seed)).random(SCREENING_POINTS)
    c = np.concatenate([p.low + points * (p.start_high - p.low) for p in problems])
    build = jax.tree.map(
        lambda *x: np.repeat(np.array(x, float), SCREENING_POINTS), *[p.build for p in problems]
    )
    first_problem = problems[0]
    y = evaluate_many(c, build, first_problem.numbers, first_problem.task.points, first_problem.ids).reshape(
        len(problems), SCREENING_POINTS, -1
    )
    starts = []
    for p, rows, coordinates in zip(problems, y, c.reshape(len(problems), SCREENING_POINTS, 5), strict=True):
        violation = np.maximum(-np.min(p.compute_margins(rows), axis=1), 0.0)
        merit = (
            np.log(np.maximum(rows[:, locate_output(OBJECTIVE_OUTPUTS[p.objective])], 1e-12))
            + VIOLATION_WEIGHT * violation
        )
        merit = np.where(
            rows[:, locate_output("unsolved")] > 0, np.inf, np.where(np.isfinite(merit), merit, np.inf)
        )
        starts.append(np.array([p.to_scaled(coordinates[k]) for k in np.argsort(merit, kind="stable")]))
    return starts


def search_choices(
    problems: Sequence[SizingProblem],
    *,
    starts: int,
    seed: int,
    method: str = "slsqp",
    progress: Progress = ignore_progress,
) -> tuple[list[ChoiceResult], int]:
    """Search the choices.

    Args:
        problems: one for each choice.
        starts: of each of the best few choices.
        seed: of the first look.
        method: one of `optimise.METHODS`, for the last searches.

    Returns:
        what was tried, the best first, and how many choices were looked at but not searched.
    """
    starts_by_choice = screen_choices(problems, seed)
    order = sorted(
        range(len(problems)), key=lambda k: _compute_penalised_objective(problems[k], starts_by_choice[k][0])
    )
    results = []
    for rank, k in enumerate(order[:MAX_SEARCHED_CHOICES]):
        progress(
            f"choice {rank + 1} of {min(len(order), MAX_SEARCHED_CHOICES)}",
            rank / min(len(order), MAX_SEARCHED_CHOICES),
        )
        results.append(_search_choice(problems[k], starts_by_choice[k][:FIRST_STARTS], stop_after=1))
    results.sort(key=_rank_result)
    starts_by_problem = {
        id(problem): choice_starts for problem, choice_starts in zip(problems, starts_by_choice, strict=True)
    }
    if results[0].optimum is None:
        # The way to what nearly fits is long, and most searches get stuck on it.
        nearest = results[:INFEASIBLE_CHOICES]
        results[:INFEASIBLE_CHOICES] = [
            _search_choice(
                result.problem, starts_by_problem[id(result.problem)][:INFEASIBLE_STARTS], stop_after=1
            )
            for result in nearest
        ]
        results.sort(key=_rank_result)
    for position, result in enumerate(results[:FINAL_CHOICES]):
        if result.optimum is not None:
            extra_starts = np.concatenate(
                [result.optimum.z[None], starts_by_problem[id(result.problem)][1:starts]]
            )
            refined = _search_choice(result.problem, extra_starts, method)
            results[position] = refined if refined.optimum is not None else result
    results.sort(key=_rank_result)
    return results, max(0, len(order) - MAX_SEARCHED_CHOICES)


def _compute_penalised_objective(problem: SizingProblem, z: np.ndarray) -> float:
    value, _, margins, _ = problem.evaluate(z)
    return value + VIOLATION_WEIGHT * max(0.0, -float(np.min(margins)))


def _rank_result(result: ChoiceResult) -> tuple[int, float]:
    return (0, result.optimum.log_objective) if result.optimum is not None else (1, result.violation)


def _search_choice(
    problem: SizingProblem, starts: np.ndarray, method: str = "slsqp", stop_after: int = 1000
) -> ChoiceResult:
    """The best of several searches of one choice; where none keeps everything, what is least broken.

    Args:
        stop_after: answers after which no further start is tried.
    """
    best: SearchResult | None = None
    objectives: list[float] = []
    least_violation, best_start = np.inf, starts[0]
    for start in starts:
        if float(np.min(problem.evaluate(start)[2])) < 0:
            # From where something is broken a search for the best runs off to the smallest muscle there is.
            start, violation, _ = minimise_violation(problem, start)
            if violation < least_violation:
                least_violation, best_start = violation, start
            if violation > MAX_NEAR_VIOLATION:
                continue
        optimum = search_optimum(problem, start, method)
        if optimum.is_feasible:
            objectives.append(optimum.log_objective)
            least_violation = 0.0
            if best is None or optimum.log_objective < best.log_objective:
                best, best_start = optimum, optimum.z
            if len(objectives) >= stop_after:
                break
    agreeing = sum(abs(value - best.log_objective) < 1e-4 for value in objectives) if best is not None else 0
    return ChoiceResult(problem, best, best_start, float(least_violation), agreeing, len(starts))
