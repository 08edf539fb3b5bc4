"""Discrete search after the continuous one: tubes that are sold, for the best choices of thread and rubber.

Each choice is combined with each tube of its rubber. All are screened in one batched program. The
best choices of each tube are optimised, then more choices of the best tubes. The remaining coordinates are
rest length, braid angle and pressure. Diameter and pressure do not increase with the rest length, so a muscle
that minimises one of them uses the whole length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pamjax.progress import Progress, ignore_progress
from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.enumerate import ChoiceResult, rank_result, screen_choices, search_choice
from pamjax.sizing.problem import Choice, SizingProblem, build_problem
from pamjax.sizing.requirements import SizingTask
from pamjax.sizing.specification.parts import Tube, list_tubes
from pamjax.sizing.specification.spec import Spec

#: Largest number of choices that are combined with tubes, and number of screened candidates of each pair.
_MAX_BASES, _STOCK_SCREENING_POINTS = 150, 64
#: Number of best choices of each tube that are optimised first; number of best tubes and of further choices.
_FIRST_CHOICES, _BEST_TUBES, _FURTHER_CHOICES = 2, 5, 8
#: Screened merit, relative to the best one, above which a tube is not optimised.
_MAX_MERIT_EXCESS = 8.0
#: Objectives that a longer muscle does not increase.
_LENGTHLESS_OBJECTIVES = ("diameter", "pressure")
#: Relative difference up to which a tube has the outer diameter that the spec states.
_SIZE_TOLERANCE = 0.02


def list_fitting_tubes(spec: Spec, choice: Choice) -> list[Tube]:
    """Return the tubes of the rubber of a choice within the limits of the spec."""
    limits, outer_diameter = spec.entries.limits, choice.outer_diameter

    def fits(tube: Tube) -> bool:
        ranges = ((limits.diameter, tube.outer_diameter), (limits.wall, tube.wall))
        in_range = all(r is None or r[0] * 0.999 <= value <= r[1] * 1.001 for r, value in ranges)
        is_stated = outer_diameter is None or abs(tube.outer_diameter / outer_diameter - 1) <= _SIZE_TOLERANCE
        return in_range and is_stated

    return [tube for tube in list_tubes() if tube.rubber == choice.bladder.name and fits(tube)]


def search_stock(
    results: Sequence[ChoiceResult],
    spec: Spec,
    task: SizingTask,
    transfer: CalibrationTransfer,
    seed: int,
    progress: Progress = ignore_progress,
) -> list[ChoiceResult]:
    """Return the feasible muscles with tubes that are sold, the best first.

    Args:
        results: feasible choices of the continuous search, the best first.
        spec, task, transfer: of this search.
        seed: seed of the screening.
        progress: called with the current step and the completed fraction.

    Returns:
        the results. A rubber without tubes in the table keeps its free diameter and wall.
    """
    kept_results: list[ChoiceResult] = []
    problems: list[SizingProblem] = []
    for result in results[:_MAX_BASES]:
        choice = result.problem.choice
        if not any(tube.rubber == choice.bladder.name for tube in list_tubes()):
            kept_results.append(result)
        problems += [
            _use_whole_length(build_problem(spec, task, replace(choice, tube=tube), transfer), spec)
            for tube in list_fitting_tubes(spec, choice)
        ]
    if not problems:
        return kept_results
    starts_by_problem, merits = screen_choices(problems, seed, _STOCK_SCREENING_POINTS)
    ranks_by_tube: dict[Tube | None, list[int]] = {}
    for k in np.argsort(merits, kind="stable"):
        if merits[k] <= merits.min() + _MAX_MERIT_EXCESS:
            ranks_by_tube.setdefault(problems[k].choice.tube, []).append(int(k))

    def search(ranks: Sequence[int], step: str) -> list[ChoiceResult]:
        feasible = []
        for rank, k in enumerate(ranks):
            progress(f"{step} {rank + 1} of {len(ranks)}", rank / len(ranks))
            result = search_choice(problems[k], starts_by_problem[k][:2], stop_after=1)
            if result.optimum is not None:
                feasible.append(result)
        return feasible

    first = [k for ranks in ranks_by_tube.values() for k in ranks[:_FIRST_CHOICES]]
    kept_results += search(first, "tube")
    kept_results.sort(key=rank_result)
    best_tubes = list(dict.fromkeys(result.problem.choice.tube for result in kept_results))[:_BEST_TUBES]
    further = [
        k
        for tube in best_tubes
        for k in ranks_by_tube.get(tube, [])[_FIRST_CHOICES : _FIRST_CHOICES + _FURTHER_CHOICES]
    ]
    return sorted(kept_results + search(further, "yarn"), key=rank_result)


def _use_whole_length(problem: SizingProblem, spec: Spec) -> SizingProblem:
    """Return the problem with the rest length that is available, if a shorter one has no merit."""
    length = problem.task.find_requirement("length")
    if length is None or spec.entries.limits.rest_length or problem.objective not in _LENGTHLESS_OBJECTIVES:
        return problem
    low, high, start_high = (x.copy() for x in (problem.low, problem.high, problem.start_high))
    low[0] = high[0] = start_high[0] = math.log(length.bounds[0])
    return problem.copy_with(low=low, high=high, start_high=start_high)
