"""How far a number moves among models that a recording tells apart no better than by chance.

A standard deviation at a minimum knows of that minimum alone. Relaxing rubber of two branches fits a
recording nearly alike in several ways (a tenth in 3 s, or a half in 40 s), and where one name can stand for
another the numbers of all others depend on which of them is there. Nor does it know that noise of pressure
and length, passed on by a memory, pulls the numbers. So the model is refitted from the other forms in which
the same numbers of a name move, the best of these fits is kept, and of every model m that is about as good,
weighed by p_m, the numbers get the covariance

    C = C_0 + Σ p_m (v_m − v_0) (v_m − v_0)ᵀ + δ δᵀ,        p_m = e^(−Δχ²_m / 2 s) / Σ,

v_0 the numbers that are told, s the mean square that the model leaves and δ that pull (`unbiased`). A tie has
the chance that it has beside the name whose place it takes, and says nothing of that name's own numbers.

What it leaves out: moments of a slip, which are many and which the search has tried.
Source: moments of a mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.library.candidates import Form, forms
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.input_noise import passed
from pamjax.diagnosis.refit.candidate_fit import Model, freed, moving, places, without
from pamjax.diagnosis.refit.errors_in_variables import pulled
from pamjax.diagnosis.refit.least_squares import MOST as TO_THE_END
from pamjax.diagnosis.refit.least_squares import refit
from pamjax.diagnosis.select.selection import Name

#: Most other forms of a name to begin from.
MOST = 9
#: Evaluations of a refit from another form.
ENOUGH = 10
#: χ² by which a fit may be worse and still count as about as good.
NEAR = 20.0
#: χ² by which another minimum must be lower to be gone to.
LOWER = 0.5
#: What a model's own standard deviations say of a distance, χ², is off by so much by chance.
CHANCE = 4.0


def spread(found: Problem, model: Model, names: Sequence[Name]) -> Model:
    """The model at the best of its minima, with what the others and its ties disagree about.

    Args:
        found: the recording before the library.
        model: with names, refitted.
        names: what each of them is worth beside its rivals.
    """
    ends = abreast(partial(_refitted, found, model), _starts(found, model))
    near = [end for end in ends if end.at.cost < model.at.cost + NEAR]
    minima = sorted(abreast(partial(_fair, found), near), key=lambda end: end.fair)
    if minima and minima[0].fair < model.fair - LOWER:
        minima.append(model)
        model = _freed(found, _refitted(found, model, minima[0].at.values, TO_THE_END))
    moves = _among(model, minima) + [move for name in names for move in _of_ties(found, model, name)]
    moved = list(model.at.moved)
    pull = pulled(found, model.white, model.at) if model.white.trust == 1 else np.zeros(len(moved))
    between = sum((p * np.outer(by[moved], by[moved]) for p, by in moves), np.zeros((len(moved),) * 2))
    return replace(model, between=between, pull=pull)


def _starts(found: Problem, model: Model) -> list[np.ndarray]:
    """Values from which to begin: each name in each of its other forms."""
    known, starts = forms(found), []
    for form in model.chosen:
        others = [one for one in known if one.id == form.id and set(one.moves) == set(form.moves)]
        for other in others if 1 < len(others) <= MOST else []:
            start = model.at.values.copy()
            for name, value in other.shape.items():
                k = found.place(name)
                start[k] = np.clip(value, found.low[k], found.high[k])
            starts.append(start)
    return starts


def _refitted(found: Problem, model: Model, start: np.ndarray, most: int = ENOUGH) -> Model:
    return replace(model, at=refit(found, model.white, model.at.moved, start, most))


def _fair(found: Problem, model: Model) -> Model:
    """With what noise alone leaves there; a model that is weighed by its own misfit does not know of it."""
    own = passed(found, model.white, model.at.values) if model.white.trust == 1 else 0.0
    return replace(model, passed=own)


def _freed(found: Problem, model: Model) -> Model:
    """Without the pull of that noise."""
    return freed(found, model.chosen, model.white, model.at) if model.white.trust == 1 else model


def _among(model: Model, minima: Sequence[Model]) -> list[tuple[float, np.ndarray]]:
    """Chance of each other minimum, and by how much it moves every number."""
    other = [model]
    for end in minima:
        if all(_elsewhere(one, end) for one in other):
            other.append(end)
    worse = np.array([max(end.fair - model.fair, 0.0) for end in other])
    chances = np.exp(-0.5 * worse / model.wider)
    chances /= chances.sum()
    return [(float(p), end.at.values - model.at.values) for p, end in zip(chances, other, strict=True)][1:]


def _elsewhere(one: Model, end: Model) -> bool:
    """Whether a fit is farther from a minimum than the minimum's own standard deviations know."""
    by = (end.at.values - one.at.values)[list(one.at.moved)] / one.at.scale
    own = float(np.sum((one.at.jacobian @ by) ** 2) + np.sum((by / one.at.prior) ** 2))
    return own / one.wider > max(end.fair - one.fair, 0.0) / one.wider + CHANCE


def _of_ties(found: Problem, model: Model, name: Name) -> list[tuple[float, np.ndarray]]:
    """Chance of each of a name's ties, and by how much it moves the numbers of the others."""
    own = next((form for form in model.chosen if form.id == name.id), None)
    if own is None:
        return []

    def moved_by(tie: tuple[float, Form, np.ndarray]) -> tuple[float, np.ndarray]:
        chance, form, values = tie
        start = without(found, model.at.values, own)
        start[places(found, [form])] = values[places(found, [form])]
        others = [one for one in model.chosen if one is not own]
        moved = moving(found, [*others, form])
        by = refit(found, model.white, moved, start, ENOUGH).values - model.at.values
        by[places(found, [own])] = 0.0
        return chance, by

    return abreast(moved_by, name.instead)
