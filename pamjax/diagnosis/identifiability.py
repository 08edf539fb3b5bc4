"""What a recording cannot tell of its baseline and its library, and what it drives too far, in words.

The baseline's refit already holds all that is needed: how each whitened sample answers to each number
(its Jacobian J) and what was believed of the number. A combination of numbers of which JᵀJ knows less
than the belief does would move without anyone noticing, and so could hide missing physics, or feign it.
"""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit
from pamjax.infer.fitting.identifiability import (
    RELATIVE_SD_WITHOUT_PRIOR,
    find_undetermined_combinations,
    format_combination,
    format_list,
)


def format_notes(problem: LibraryProblem, baseline: CandidateFit, fit: CandidateFit) -> list[str]:
    """All sentences, what was driven too far first.

    Args:
        problem: the recording before the library.
        baseline: the baseline, refitted.
        fit: it with what was named; the baseline itself where nothing was.
    """
    return [
        *format_strained_parameters(problem, fit),
        *format_untestable_mechanisms(problem),
        *format_unidentified_combinations(problem, baseline),
    ]


def format_strained_parameters(problem: LibraryProblem, fit: CandidateFit) -> list[str]:
    """A sentence on the baseline's own numbers that ended as far off as they may, if some did.

    Args:
        problem: the recording before the library.
        fit: what is left of them is not laid to what it names.
    """
    at_limit = [fit.estimate.free[k] for k in find_parameters_at_limit(problem, fit.estimate)]
    names = [
        f"`{problem.names[k]}`"
        for k in at_limit
        if problem.is_baseline[k] and np.isfinite(problem.prior_sd[k])
    ]
    if not names:
        return []
    it, its = ("it", "its") if len(names) == 1 else ("them", "their")
    return [
        f"{format_list(names)} ended as far from what is stated as is believed possible: something that"
        f" is missing"
        f" pulls at {it}, or {its} sd is too small."
    ]


def format_untestable_mechanisms(problem: LibraryProblem) -> list[str]:
    """A sentence on the mechanisms that a static table cannot show, if the recording is one."""
    if problem.case.recording.has_time:
        return []
    return [
        "Without a column `time` rows count as equilibria: friction, damping, relaxation, lag and drift were"
        " not asked for. If the rows were taken one after another, give the time."
    ]


def format_unidentified_combinations(problem: LibraryProblem, baseline: CandidateFit) -> list[str]:
    """Sentences, one for each combination of the baseline's numbers that its refit leaves open.

    Args:
        problem: the recording before the library.
        baseline: the baseline, refitted; samples count as its noise lets them.
    """
    estimate = baseline.estimate
    free = list(estimate.free)
    if not free:
        return []
    scale = np.where(
        np.isfinite(problem.prior_sd[free]),
        problem.prior_sd[free],
        RELATIVE_SD_WITHOUT_PRIOR * np.abs(problem.start[free]),
    )
    # From the refit's coordinates (a logarithm for some) to SI.
    by_value = estimate.jacobian / np.where(estimate.scale != 0, estimate.scale, 1.0)
    information = by_value.T @ by_value
    return [
        format_combination(moves)
        for moves in find_undetermined_combinations([problem.names[k] for k in free], information, scale)
    ]
