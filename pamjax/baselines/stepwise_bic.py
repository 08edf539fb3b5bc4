"""What common practice selects from the same library on the same recording, to compare with.

Samples count as independent, mechanisms are added one at a time while Schwarz's criterion

    BIC = n ln(χ² / n) + k ln n

falls, with k numbers fitted. The library, its derivatives, priors and limits are pamjax's own: what differs
is the noise model, that nothing accounts for how many forms were tried, and that nothing is asked of a name
but that BIC falls.

It sees the rows that pamjax's own fit sees. The other common practice, a flexible curve on what the baseline
leaves, is in `discrepancy.py`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.detect.score_test import Signature, signatures
from pamjax.diagnosis.library.candidates import Form, forms
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import Whitening, whitening
from pamjax.diagnosis.refit.candidate_fit import begun
from pamjax.diagnosis.refit.least_squares import Refit, refit
from pamjax.diagnosis.select.search import shortlist

#: Most names; how many mechanisms are refitted at each step, and evaluations of such a refit.
MOST, TRIED, EVALUATIONS = 6, 2, 15


@dataclass(frozen=True, eq=False)
class Selection:
    """What independent noise and BIC select.

    Attributes:
        ids: in the order in which they came.
        force: (n,) what it predicts, N.
    """

    ids: tuple[str, ...]
    force: np.ndarray


def select(found: Problem, used: np.ndarray) -> Selection:
    """Forward selection by BIC under independent noise.

    Args:
        found: the recording before the library.
        used: (n,) the rows that may be looked at.
    """
    candidates = forms(found)
    own = np.flatnonzero(found.own).tolist()
    white = _independent(whitening(found, found.neutral, used))
    at = refit(found, white, own, found.neutral)
    white = _independent(whitening(found, at.values, used))
    at = refit(found, white, own, at.values)
    chosen: list[Form] = []
    while len(chosen) < MOST:
        scored = signatures(found, white, at, candidates)
        promising = shortlist(scored, [form.id for form in chosen], TRIED)
        trials = [(s.form, _with(found, white, at, own, chosen, s)) for s in promising]
        form, best = min(trials, key=lambda pair: pair[1].misfit)
        if bic(best.misfit, white.size, len(best.moved)) >= bic(at.misfit, white.size, len(at.moved)):
            break
        at, chosen = best, [*chosen, form]
    return Selection(tuple(form.id for form in chosen), found.shows(at.values)[0])


def bic(misfit: float, samples: int, numbers: int) -> float:
    """Schwarz's criterion with the noise level profiled out."""
    return samples * float(np.log(misfit / samples)) + numbers * float(np.log(samples))


def _independent(white: Whitening) -> Whitening:
    colours = tuple(c and dataclasses.replace(c, correlation=0.0) for c in white.colours)
    return dataclasses.replace(white, colours=colours)


def _with(found: Problem, white: Whitening, at: Refit, own, chosen, signature: Signature) -> Refit:
    start = begun(found, at.values, signature.form, signature.amplitudes)
    names = [name for one in (*chosen, signature.form) for name in one.moves]
    moved = sorted({*own, *(found.place(name) for name in names)})
    return refit(found, white, moved, start, EVALUATIONS)
