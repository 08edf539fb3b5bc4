"""What noise of pressure and length does to a misfit once a mechanism with a memory has passed it on.

Weights are made for a muscle that passes such noise on sample by sample. A delay between samples
averages neighbours, and a rate is their difference: the noise of what they show is less, or more, and
with it the χ² of a misfit that is nothing but noise,

    E χ²(m) − E χ²(0) = E |W [f_m(x + u) − f_m(x)]|² − E |W (∂f_0/∂x) u|²,

f_m the model, f_0 its bare muscle, W the weights, u the sensors' noise in what was set, x. Two models
are told apart by what is left when each is freed of its own. Untold, a delay by half a sample explains
thousands of rows better than the truth.

The mean over u is taken with signs, ±sd, the same for every model. Four draws carry the rows of a
Hadamard matrix, so that no product of neighbours, nor of pressure and length, is left in it.

A model that would make very much of noise is not forgiven more than a tenth of the samples: noise on a path
that has it already then says little of noise on the true one, and a model whose answer hangs on every sample
would be forgiven anything.
Source: derived here; signs as M. F. Hutchinson, Commun. Stat. Simul. 18, 1059 (1989); Hadamard's rows as
C. Bekas, E. Kokiopoulou, Y. Saad, Appl. Numer. Math. 57, 1214 (2007).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.linalg import hadamard

from pamjax.diagnosis.library.candidates import NEEDS_TIME
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.infer.noise.sensor_noise import sensitivities

#: Draws, a power of two, and their seed: every model sees the same.
DRAWS, SEED = 4, 7
#: Most that is taken off a model's χ², as a share of its samples.
CREDIT = 0.1


def passed(found: Problem, white: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> float:
    """χ² that a model is expected to leave beyond its bare muscle, by noise of what was set alone.

    Args:
        found: the recording before the library.
        white: the weights, a `Whitening`.
        values: (p,) all numbers, SI.

    Returns:
        zero where nothing remembers, or no such noise is stated; negative for a model that averages; at most
        `CREDIT` of the samples.
    """
    shown = passed_on(found, values)
    if shown is None:
        return 0.0
    by_pressure, by_length = (
        np.asarray(s)[:, : found.n] for s in sensitivities(found.member, jnp.asarray(values))
    )
    total, size = 0.0, 0
    for here, (pressure, length) in zip(shown, draws(found), strict=True):
        there, bare = white(here), white(np.nan_to_num(by_pressure * pressure + by_length * length))
        total, size = total + float(there @ there - bare @ bare), there.size
    return min(total / DRAWS, CREDIT * size)


def passed_on(found: Problem, values: np.ndarray) -> np.ndarray | None:
    """What each draw of noise does to what is shown, (draws, 2, n), SI; None where `passed` is zero."""
    again = shaken(found, values)
    if not again:
        return None
    still = found.shows(values)
    return np.nan_to_num(np.stack([one.shows(values) - still for one in again]))


def shaken(found: Problem, values: np.ndarray) -> list[Problem]:
    """The problem with each draw of noise in what was set; none where `passed` is zero."""
    if not _remembers(found, values) or not any(_stated(found)):
        return []
    return [_shaken(found, *draw) for draw in draws(found)]


def passed_slope(found: Problem, white: Callable[[np.ndarray], np.ndarray], values, places) -> np.ndarray:
    """Derivative of `passed` by some numbers, (k,), SI, but for the bare muscle's share."""
    still, slopes = found.slopes(values, places)
    total = np.zeros(len(places))
    for draw in draws(found):
        shown, steeper = _shaken(found, *draw).slopes(values, places)
        here, there = white(np.nan_to_num(shown - still)), white(np.nan_to_num(steeper - slopes))
        total += 2 * there @ here
    return total / DRAWS


def draws(found: Problem) -> list[tuple[np.ndarray, np.ndarray]]:
    """What is added to pressure and to length, (n,) each, draw by draw, SI."""
    pressure, length = _stated(found)
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (2, found.n))
    turn = np.arange(found.n) % (DRAWS // 2)
    return [
        (pressure * signs[0] * row[turn], length * signs[1] * row[DRAWS // 2 + turn])
        for row in hadamard(DRAWS)
    ]


def _stated(found: Problem) -> tuple[float, float]:
    """Noise of pressure and of length from sample to sample, SI."""
    sensors = found.case.entry.sensors
    return sensors.pressure or 0.0, 0.0 if sensors.length_per_setting else sensors.length or 0.0


def _remembers(found: Problem, values: np.ndarray) -> bool:
    """Whether a mechanism that looks at other samples is switched on."""
    return bool(NEEDS_TIME & found.on(values)) and found.case.recording.has_time


def _shaken(found: Problem, pressure: np.ndarray, length: np.ndarray) -> Problem:
    """The problem with something added to what was set."""

    def shake(one):
        n, rows = found.n, one.rows
        rows = dataclasses.replace(
            rows, pressure=rows.pressure.at[:n].add(pressure), length=rows.length.at[:n].add(length)
        )
        return dataclasses.replace(one, rows=rows)

    return dataclasses.replace(found, member=shake(found.member), lighter=shake(found.lighter))
