"""Shared parts of the rubber tests: the article's muscle with a latex tube, strokes, and closed paths."""

import numpy as np
from hypothesis import strategies as st

from pamjax.model.bench import Bench, record_bench
from pamjax.model.history import build_time_history
from pamjax.model.state import Cylinder

# The article's muscle, in a bladder of 22.2 mm and 1/16 inch.
REST, THREAD, TURNS, STIFFNESS = 0.235744, 0.251206, 1.09, 144 * 0.0858e-6 * 80e9
SIZE = {"inner_diameter": 19.025e-3, "thickness": 1.5875e-3, "length": REST}
LATEX = 0.4e6


def bench(*mechanisms):
    return Bench(THREAD, TURNS, mechanisms)


def cylinder(length, thread=THREAD):
    return Cylinder()(length, thread, TURNS)


def clock(n, step=1.0):
    return build_time_history(np.arange(n) * step, np.arange(n) == 0)


def shown(mechanisms, pressure, length, past=None):
    length = np.asarray(length, float)
    pressure = np.broadcast_to(np.asarray(pressure, float), length.shape)
    return record_bench(bench(*mechanisms), pressure, length, past or clock(length.size))


def added(mechanism, pressure, length, past=None):
    """Return the force that a mechanism adds to the bare braid, N."""
    with_it, bare = shown([mechanism], pressure, length, past), shown([], pressure, length)
    return np.asarray(with_it.force - bare.force)


def strokes(contraction, cycles=3, rate=1e-3, step=2.0):
    """Return time (s) and length (m) of strokes from rest to a contraction and back."""
    half = REST * contraction / rate
    time = np.arange(0, 2 * half * cycles, step)
    phase = time % (2 * half)
    return time, REST - rate * np.minimum(phase, 2 * half - phase)


#: Corners of a path: axial and hoop stretches, and the duration, s.
WALKS = st.lists(
    st.tuples(st.floats(0.6, 1.1), st.floats(0.8, 2.4), st.floats(0.1, 300)), min_size=2, max_size=8
)


def returning(walk, fine=400):
    """Return time (s) and stretches along a closed path."""
    corners = np.array([(1.0, 1.15), *((z, c) for z, c, _ in walk), (1.0, 1.15)])
    times = np.cumsum([0.0, *(t for *_, t in walk), 1.0])
    time = np.linspace(0, times[-1], fine)
    path = np.stack([np.interp(time, times, corners[:, k]) for k in (0, 1)], axis=1)
    return time, path
