"""What a recording cannot tell of its baseline and its library, and what it drives too far, in words.

The baseline's refit already holds all that is needed: how each whitened sample answers to each number
(its Jacobian J) and what was believed of the number. A combination of numbers of which JᵀJ knows less
than the belief does would move without anyone noticing, and so could hide missing physics, or feign it.
"""

from __future__ import annotations

import numpy as np

from pamjax.infer.determine import USEFUL, unnoticed, words
from pamjax.study.problem import Problem
from pamjax.study.refit import driven
from pamjax.study.settled import Model


def notes(found: Problem, baseline: Model) -> list[str]:
    """All sentences, what was driven too far first.

    Args:
        found: the recording before the library.
        baseline: the baseline, refitted.
    """
    return [*strained(found, baseline), *unasked(found), *undetermined(found, baseline)]


def strained(found: Problem, baseline: Model) -> list[str]:
    """Sentences, one for each of the baseline's own numbers that ended as far off as it may.

    Args:
        found: the recording before the library.
        baseline: the baseline, refitted.
    """
    ends = (baseline.at.moved[k] for k in driven(found, baseline.at))
    return [
        f"`{found.names[k]}` was driven as far from what is stated as is believed possible: what is missing"
        " pulls at it, or its sd is too small."
        for k in ends
        if found.own[k] and np.isfinite(found.sd[k])
    ]


def unasked(found: Problem) -> list[str]:
    """A sentence on the mechanisms that a static table cannot show, if the recording is one."""
    if found.case.recording.has_time:
        return []
    return [
        "without a column `time` rows count as equilibria: friction, damping, relaxation, lag and drift were"
        " not asked for. If the rows were taken one after another, give the time."
    ]


def undetermined(found: Problem, baseline: Model) -> list[str]:
    """Sentences, one for each combination of the baseline's numbers that its refit leaves open.

    Args:
        found: the recording before the library.
        baseline: the baseline, refitted; samples count as its noise lets them.
    """
    at = baseline.at
    moved = list(at.moved)
    if not moved:
        return []
    scale = np.where(np.isfinite(found.sd[moved]), found.sd[moved], USEFUL * np.abs(found.start[moved]))
    # From the refit's coordinates (a logarithm for some) to SI.
    by_value = at.jacobian / np.where(at.scale != 0, at.scale, 1.0)
    information = by_value.T @ by_value
    return [words(moves) for moves in unnoticed([found.names[k] for k in moved], information, scale)]
