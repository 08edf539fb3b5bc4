"""What a recording cannot tell of its baseline and its library, and what it drives too far, in words.

The baseline's refit already holds all that is needed: how each whitened sample answers to each number
(its Jacobian J) and what was believed of the number. A combination of numbers of which JᵀJ knows less
than the belief does would move without anyone noticing, and so could hide missing physics, or feign it.
"""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model
from pamjax.diagnosis.refit.least_squares import driven
from pamjax.infer.fitting.identifiability import USEFUL, listed, unnoticed, words


def notes(found: Problem, baseline: Model, model: Model) -> list[str]:
    """All sentences, what was driven too far first.

    Args:
        found: the recording before the library.
        baseline: the baseline, refitted.
        model: it with what was named; the baseline itself where nothing was.
    """
    return [*strained(found, model), *unasked(found), *undetermined(found, baseline)]


def strained(found: Problem, model: Model) -> list[str]:
    """A sentence on the baseline's own numbers that ended as far off as they may, if some did.

    Args:
        found: the recording before the library.
        model: what is left of them is not laid to what it names.
    """
    ends = [model.at.moved[k] for k in driven(found, model.at)]
    names = [f"`{found.names[k]}`" for k in ends if found.own[k] and np.isfinite(found.sd[k])]
    if not names:
        return []
    it, its = ("it", "its") if len(names) == 1 else ("them", "their")
    return [
        f"{listed(names)} ended as far from what is stated as is believed possible: something that is missing"
        f" pulls at {it}, or {its} sd is too small."
    ]


def unasked(found: Problem) -> list[str]:
    """A sentence on the mechanisms that a static table cannot show, if the recording is one."""
    if found.case.recording.has_time:
        return []
    return [
        "Without a column `time` rows count as equilibria: friction, damping, relaxation, lag and drift were"
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
