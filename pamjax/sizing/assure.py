"""Choices that reach the required probability: the nominal objective bounds the search from below.

A margin for uncertainty cannot improve the objective. Choices are therefore optimised for the probability in
the order of their nominal objective, until the next one cannot improve on the best.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pamjax.progress import Progress, ignore_progress
from pamjax.sizing import chance_constraints as chance
from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.specification.spec import Spec

#: Largest number of choices that are optimised for the probability; of these that fail before one succeeds.
MAX_ASSURED_CHOICES, MAX_FAILURES = 30, 16
#: Excess of the search's probability over the target, standard errors, tried in this order: a candidate that
#: is optimised on the draws of the search is a little less probable on other draws.
_SEARCH_EXCESSES = (2.0, 3.0, 5.0)
#: Excess at which no further one is tried, standard errors: the reported probability has draws of its own.
_SUFFICIENT_EXCESS = 1.0
#: Largest excess, as a share of the distance from the target to one.
_MAX_EXCESS_SHARE = 0.5
#: Probability, as a share of the target, below which a choice is given up.
_HOPELESS_SHARE = 0.95


@dataclass(frozen=True, eq=False)
class Finalist:
    """A choice of the last search, and the probability that it meets all requirements; NaN if unknown."""

    result: ChoiceResult
    probability: float = math.nan

    def reaches(self, target: float) -> bool:
        """Return whether the choice reaches a probability."""
        return not target or self.probability >= target

    @property
    def log_objective(self) -> float:
        return self.result.optimum.log_objective if self.result.optimum is not None else math.inf


def assure_probability(
    pool: Sequence[ChoiceResult],
    transfer: CalibrationTransfer,
    spec: Spec,
    seed: int,
    progress: Progress = ignore_progress,
) -> list[Finalist]:
    """Return the optimised choices: those that reach the probability by objective, then the most probable.

    The probabilities are estimated from draws that no search used. They select the best choice, so its
    reported probability needs draws of its own (`chance_constraints.draw_reported_builds`).

    Args:
        pool: feasible choices, the best first.
    """
    target = spec.entries.probability
    finalists: list[Finalist] = []
    for rank, result in enumerate(pool[:MAX_ASSURED_CHOICES]):
        progress(f"probability of choice {rank + 1}", rank / min(len(pool), MAX_ASSURED_CHOICES))
        best = min((f.log_objective for f in finalists if f.reaches(target)), default=math.inf)
        if result.optimum is None or result.optimum.log_objective > best:
            break
        if math.isinf(best) and rank >= MAX_FAILURES:
            break
        finalists.append(_assure_choice(result, transfer, spec, seed))
    return sorted(
        finalists,
        key=lambda f: (0, f.log_objective) if f.reaches(target) else (1, -f.probability),
    )


def _assure_choice(result: ChoiceResult, transfer: CalibrationTransfer, spec: Spec, seed: int) -> Finalist:
    target, tolerance = spec.entries.probability, spec.entries.tolerance
    best, start = Finalist(result, 0.0), result
    for excess in _SEARCH_EXCESSES:
        # The errors are shares of the dimensions, which change with each pass.
        errors = chance.choose_problem_errors(start, tolerance)
        draws = chance.draw_builds(result.problem, transfer, errors, chance.SEARCH_DRAWS, seed)
        start, _ = chance.meet_probability(result, draws, _raise_target(target, excess))
        probability = _estimate_selection_probability(start, transfer, spec, seed)
        best = max(best, Finalist(start, probability), key=lambda finalist: finalist.probability)
        if probability >= _raise_target(target, _SUFFICIENT_EXCESS) or probability < _HOPELESS_SHARE * target:
            break
    return best


def _raise_target(target: float, excess: float) -> float:
    """Return the target plus an excess in standard errors, at most `_MAX_EXCESS_SHARE` of the way to one."""
    return target + min(excess * chance.compute_standard_error(target), _MAX_EXCESS_SHARE * (1 - target))


def _estimate_selection_probability(
    result: ChoiceResult, transfer: CalibrationTransfer, spec: Spec, seed: int
) -> float:
    """Return the probability that all requirements hold, from draws that select a choice."""
    assert result.optimum is not None
    errors = chance.choose_problem_errors(result, spec.entries.tolerance)
    draws = chance.draw_builds(result.problem, transfer, errors, chance.REPORT_DRAWS, seed + 1)
    return chance.estimate_probability(result.problem, result.optimum.z, draws)
