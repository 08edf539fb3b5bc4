"""Variance of a prediction at the turns of a recording, where the speed of the muscle is not known.

At a turn the speed is that before it, that after it, or one in between (`records/turns.py`). With the first
two, a model predicts f₋ and f₊. The standard deviation of its prediction is half of their difference,

    s² = (f₋ − f₊)² / 4.

It is zero for a model without a rate of change. Source: derived here.
"""

from __future__ import annotations

import dataclasses
from weakref import WeakKeyDictionary

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.model.history import RATE_HALF_WIDTH
from pamjax.model.mechanism import AbstractSensor
from pamjax.model.registry import MECHANISMS

#: The problem with the rates before and after each turn; empty without turns. Each caches its evaluations.
_one_sided_problems: WeakKeyDictionary[LibraryProblem, list[LibraryProblem]] = WeakKeyDictionary()

_RATE_DEPENDENT = {kind.id for kind in MECHANISMS if kind.uses_rate}

#: Sensors that mix samples. Between samples they interpolate with the rate, which is no speed of the muscle.
_MIXING_SENSORS = {kind.id for kind in MECHANISMS if issubclass(kind, AbstractSensor) and kind.mixes_samples}


def estimate_turn_variance(problem: LibraryProblem, values: np.ndarray) -> np.ndarray | None:
    """Return the variance of both predicted channels at turns, (2, n) SI squared; None for none.

    Args:
        problem: the recording and the library.
        values: (p,) parameter values, SI.
    """
    if not _RATE_DEPENDENT & problem.find_active_mechanisms(values):
        return None
    if problem not in _one_sided_problems:
        _one_sided_problems[problem] = _build_one_sided_problems(problem)
    if not _one_sided_problems[problem]:
        return None
    has_mixing_sensor = np.array([name.partition(".")[0] in _MIXING_SENSORS for name in problem.names])
    values = np.where(has_mixing_sensor, problem.neutral, values)
    before, after = (each.predict(values) for each in _one_sided_problems[problem])
    return np.where(problem.is_turn, (before - after) ** 2 / 4, 0.0)


def clear_one_sided_problems(problem: LibraryProblem) -> None:
    """Free the memory of the problems with other rates; a later variance builds them again."""
    _one_sided_problems.pop(problem, None)


def _build_one_sided_problems(problem: LibraryProblem) -> list[LibraryProblem]:
    recording, history = problem.case.recording, problem.dataset.history
    turns = np.flatnonzero(problem.is_turn)
    if recording.time is None or not turns.size:
        return []
    step = np.diff(recording.time)
    problems = []
    # The rate at a turn is that of the step before it, or of the step after it.
    for offset in (-1, 0):
        weights = np.array(history.rate_weights)
        weights[turns] = 0.0
        weights[turns, RATE_HALF_WIDTH + offset] = -1 / step[turns + offset]
        weights[turns, RATE_HALF_WIDTH + offset + 1] = 1 / step[turns + offset]
        one_sided = eqx.tree_at(lambda h: h.rate_weights, history, jnp.asarray(weights))
        dataset = dataclasses.replace(problem.dataset, history=one_sided)
        problems.append(dataclasses.replace(problem, dataset=dataset))
    return problems
