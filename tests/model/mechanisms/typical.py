"""Shared parts of the mechanism tests: the Kevlar muscle, strokes, and typical parameters."""

import jax.numpy as jnp
import numpy as np

from pamjax.model.bench import Bench
from pamjax.model.history import build_time_history
from pamjax.model.registry import MECHANISMS
from pamjax.parameter import list_meanings, list_values

#: Chambers & Wereley 2022: thread length and rest length (m), turns, pressure of Table 1 (Pa), n A (m²).
THREAD, LENGTH, TURNS, PRESSURE, AREA = 0.251206, 0.235744, 1.09, 689.476e3, 144 * 0.0858e-6


def bench(*mechanisms, thread_length=THREAD):
    return Bench(thread_length, TURNS, mechanisms)


def strokes(rows=300, top=0.15):
    """Return two strokes at each of three pressures, with a hold in the second, 0.5 to 1 mm/s: two runs."""
    t = np.cumsum(1.0 + 0.3 * np.sin(np.arange(rows))) * 240 / rows
    phase = np.arange(rows) / rows * 6
    x = np.abs(phase % 1 - 0.5)
    shape = np.where(phase % 2 < 1, 1 - 2 * x, np.clip(1.5 - 3 * x, 0, 0.8))
    starts = np.zeros(rows, bool)
    starts[[0, rows // 2]] = True
    t[rows // 2 :] += 60.0
    pressure = np.interp(phase, [0, 1.9, 2.1, 3.9, 4.1, 6], np.array([2, 2, 4, 4, 7, 7]) * 1e5)
    length = LENGTH * (1 - top * shape) * (1 + 1e-4 * np.sin(0.37 * np.arange(rows)))
    return jnp.asarray(pressure), jnp.asarray(length), build_time_history(t, starts)


def full(*besides):
    """Return a bench with every mechanism at its neutral value."""
    return bench(*(kind() for kind in MECHANISMS), *besides)


def own(model, kind):
    """Return the parameters of one mechanism: path, meaning, value."""
    now = list_values(model)
    return [(p, m, float(now[p])) for p, m in list_meanings(model).items() if p.startswith(f"{kind.id}.")]


def usual(model, kind, share=0.02):
    """Return typical parameters of one mechanism by path: amplitudes at a small fraction of their range."""
    values = {}
    for path, meaning, now in own(model, kind):
        if meaning.neutral is not None:
            values[path] = meaning.neutral + share * (meaning.high - meaning.neutral)
        else:
            inwards = np.sign(0.5 * (meaning.low + meaning.high) - now)
            at_limit = not meaning.low < now < meaning.high
            values[path] = now + at_limit * 0.1 * inwards * (meaning.high - meaning.low)
    return values


def anywhere(model, kind, rng):
    """Return random parameters of one mechanism by path, within their limits."""
    values = {}
    for path, meaning, _ in own(model, kind):
        low, high = meaning.low, meaning.high
        u = rng.uniform()
        values[path] = low * (high / low) ** u if meaning.scale == "log" else low + u * (high - low)
    return values
