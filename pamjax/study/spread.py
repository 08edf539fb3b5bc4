"""How far a number moves among models that a recording tells apart no better than by chance.

A standard deviation at a minimum knows of that minimum alone. Relaxing rubber of two branches fits a
recording nearly alike in several ways (a tenth in 3 s, or a half in 40 s), and where one name can stand for
another the numbers of all others depend on which of them is there. So the model is refitted from every
other form of its names, the best of these fits is kept, and of every model m that is about as good, weighed
by p_m, the numbers get the covariance

    C = C_0 + Σ p_m (v_m − v_0) (v_m − v_0)ᵀ,        p_m = e^(−Δχ²_m / 2) / Σ,

v_0 the numbers that are told. Source: moments of a mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pamjax.study.abreast import abreast
from pamjax.study.forms import forms
from pamjax.study.naming import ROUGH, Model, Name, freed
from pamjax.study.problem import Problem
from pamjax.study.refit import Refit, refit

#: Most other forms of a name to begin from: those of a moment, which are many, the search has tried.
MOST = 9
#: Fits whose numbers are all within so many standard deviations of each other are one.
SAME = 0.5
#: χ² by which another minimum must be lower to be gone to.
LOWER = 0.5


def spread(found: Problem, model: Model, names: Sequence[Name]) -> Model:
    """The model at the best of its minima, with what the others and its ties disagree about.

    Args:
        found: the recording before the library.
        model: with names, refitted.
        names: what each of them is worth beside its rivals.
    """
    ends = abreast(lambda start: _refitted(found, model, start, 2 * ROUGH), _starts(found, model))
    best = min(ends, key=lambda at: at.cost, default=model.at)
    if best.cost < model.at.cost - LOWER:
        best = _refitted(found, model, best.values)
        ends.append(model.at)
        model = replace(freed(found, model.chosen, model.white, best), passed=model.passed)
    return replace(model, between=_between(model, _minima(model, ends), names))


def _starts(found: Problem, model: Model) -> list[np.ndarray]:
    """Values from which to begin: each name in each of its other forms."""
    known, starts = forms(found), []
    for form in model.chosen:
        others = [one for one in known if one.id == form.id and set(one.moves) == set(form.moves)]
        for other in others if len(others) <= MOST else []:
            start = model.at.values.copy()
            for name, value in other.shape.items():
                k = found.place(name)
                start[k] = np.clip(value, found.low[k], found.high[k])
            starts.append(start)
    return starts


def _refitted(found: Problem, model: Model, start: np.ndarray, *most: int) -> Refit:
    return refit(found, model.white, model.at.moved, start, *most)


def _minima(model: Model, ends: Sequence[Refit]) -> list[Refit]:
    """Fits that ended elsewhere than the model, and than each other."""
    moved, found = list(model.at.moved), [model.at]
    sd = np.sqrt(np.maximum(np.diag(model.at.covariance), 1e-300))
    for at in sorted(ends, key=lambda at: at.cost):
        if all(np.max(np.abs(at.values - other.values)[moved] / sd) > SAME for other in found):
            found.append(at)
    return found[1:]


def _between(model: Model, minima: Sequence[Refit], names: Sequence[Name]) -> np.ndarray:
    """Covariance of the numbers that moved, SI, among minima and among ties."""
    moved = list(model.at.moved)
    wider = max(model.at.misfit / max(model.white.size, 1), 1.0)
    costs = np.array([at.cost for at in minima])
    weights = np.exp(-0.5 * np.maximum(costs - model.at.cost, 0.0) / wider)
    chances = weights / (1 + weights.sum())
    moves = [(p, at.values - model.at.values) for p, at in zip(chances, minima, strict=True)]
    moves += [move for name in names for move in name.instead]
    out = np.zeros((len(moved), len(moved)))
    for p, by in moves:
        out += p * np.outer(by[moved], by[moved])
    return out
