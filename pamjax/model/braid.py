"""Geometry and ideal force of the braid: a helical thread as a right triangle of length, turns and thread.

All functions accept scalars or arrays and broadcast. Angles are measured from the
circumference, so sin θ = L / B.

    L   length between the fittings        m
    B   length of one (stretched) thread   m
    N   turns of one thread                1
    R   mid-thread radius                  m
    P   gauge pressure                     Pa

Neglects: the taper of the ends; the thickness of thread and wall.

Source: Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 1, 8, 9 and 12; Gaylord, US patent 2,844,126.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

#: A number or an array.
Real = Array | np.ndarray | float


def thread_from_diameter(length: Real, diameter: Real, turns: Real) -> Array:
    """Return the thread length of a cylinder, B² = L² + (πND)², in m (Eq. 1)."""
    return jnp.hypot(length, jnp.pi * turns * diameter)


def radius_squared(length: Real, thread: Real, turns: Real) -> Array:
    """Return R² = (B² − L²) / (2πN)², in m²; negative where the thread is shorter than the muscle."""
    return jnp.square(0.5 / (jnp.pi * turns)) * (thread - length) * (thread + length)


def diameter(length: Real, thread: Real, turns: Real) -> Array:
    """Return D = sqrt(B² − L²) / (πN), in m; NaN where the thread is shorter than the muscle (Eq. 8)."""
    return 2 * jnp.sqrt(radius_squared(length, thread, turns))


def angle(length: Real, thread: Real) -> Array:
    """Return the braid angle from the circumference, θ = asin(L/B), in rad (Eq. 9)."""
    return jnp.arcsin(length / thread)


def volume(length: Real, thread: Real, turns: Real) -> Array:
    """Return the volume of the cylinder, V = L (B² − L²) / (4πN²), in m³."""
    return 0.25 / (jnp.pi * jnp.square(turns)) * length * (thread - length) * (thread + length)


def gaylord_force(pressure: Real, length: Real, thread: Real, turns: Real) -> Array:
    """Return the force of the ideal braid, F = P (3L² − B²) / (4πN²), in N; positive pulls.

    It equals PπR²(2 tan²θ − 1) (Eq. 12) and −P ∂V/∂L at a fixed thread length.
    """
    return 0.25 / (jnp.pi * jnp.square(turns)) * pressure * (3 * length**2 - thread**2)


def hoop_pull(pressure: Real, length: Real, thread: Real, turns: Real) -> Array:
    """Return the pull of pressure on all threads together, n T = P ∂V/∂B = P L B / (2πN²), in N.

    Derived from Eqs. 2 and 3 without the bladder: the hoop balance P R L = n N T cos θ
    with cos θ = 2πRN/B.
    """
    return 0.5 / (jnp.pi * jnp.square(turns)) * pressure * length * thread


def from_angle(rest_length: Real, diameter: Real, angle: Real) -> tuple[Array, Array]:
    """Return thread length (m) and turns of a braid with this angle (rad) and diameter (m) at rest.

    B = L / sin θ and N = B cos θ / (πD). The functions `angle` and `diameter` are the inverse.
    """
    thread = jnp.asarray(rest_length / jnp.sin(angle))
    return thread, thread * jnp.cos(angle) / (jnp.pi * diameter)
