"""Shared braid of the tests of single functions: its threads form a triangle with sides 3, 4 and 5.

A thread of 0.25 m with 1.25 turns has sin θ = L / B at length L, and an exact cosine:

    L        0.24   0.20   0.15   0.07   m
    sin θ    0.96   0.80   0.60   0.28
    cos θ    0.28   0.60   0.80   0.96

The circumferential lengths 2πRN are then 0.07, 0.15, 0.20 and 0.24 m.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.model.history import build_time_history
from pamjax.model.mechanism import Past
from pamjax.model.state import Cylinder, State

THREAD, TURNS = 0.25, 1.25

#: Call a function in compiled form: without compilation, a recurrence takes ten times as long.
compiled = eqx.filter_jit(lambda function, *at: function(*at))


def state(length, thread=THREAD):
    """Return the cylinder at one or several lengths (m), of threads of one length (m)."""
    length = jnp.asarray(length, float)
    return Cylinder()(length, jnp.full_like(length, thread), jnp.full_like(length, TURNS))


def tube(length, radius):
    """Return a state with a length and a radius (m), sufficient for a wall."""
    unused = jnp.asarray(jnp.nan)
    return State(jnp.asarray(length), unused, unused, jnp.asarray(radius), unused, unused)


def past(length, pressure, load=0.0, force=0.0):
    """Return the history of a muscle with lengths (m), pressures (Pa), loads and forces (N)."""
    at = state(np.atleast_1d(length))
    return Past(
        at, *(jnp.broadcast_to(jnp.asarray(x, float), at.length.shape) for x in (pressure, load, force))
    )


def one_run(time):
    """Return the history of one continuous run at these times (s)."""
    time = np.asarray(time, float)
    return build_time_history(time, np.arange(time.size) == 0)


def static_map(rows):
    """Return the history of independent samples."""
    return build_time_history(None, np.arange(rows) == 0)
