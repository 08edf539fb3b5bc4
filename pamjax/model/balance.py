"""Thread strain at equilibrium, with its derivative and a status.

There are three solutions. They agree where their assumptions hold:

* `stretch_linear`: linear threads and the model's force, in closed form;
* `stretch_measured`: linear threads and a *measured* force, the paper's cubic;
* `solve_strain`: any thread law and any stored energy, by Newton's method with an implicit derivative.

Derivation. Hoop balance without a bladder (the paper's Eqs. 2 and 3) gives n T = P L B / (2πN²).
With n T = S ε and B = B0 (1 + ε):

    B = B0 / (1 − x),   x = P L B0 / (2πN² S)                                    (closed form)

With the axial balance and a measured F instead, n T = B (F + PπR²) / L, so that

    B = B0 (1 + n T / S)  =>  B = B0 / (1 − B0 (F + PπR²) / (L S))               (Eq. 10)

with a *minus* in the denominator: a pull lengthens the thread. With R² = (B² − L²)/(2πN)²,

    0 = B³ K P/(4πN²) + B [ K (F − L² P/(4πN²)) − 1 ] + B0,   K = B0 / (L S)     (Eq. 11)

where the −1 is *outside* the bracket that K multiplies. Inside the bracket, a pure
number would be added to a force. Both equations differ from the printed ones. The errata page has the
derivation.

At x → 1 the pull of pressure increases with thread length as fast as the load of the thread. The threads then
stretch without limit. Such states have no equilibrium: their `Status` is UNSTABLE, and their strain is that
at `BURST_LOAD_SHARE`, never NaN.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model.braid import Real
from pamjax.model.status import StatusCode

#: Share of the bursting load up to which a stretch is returned. At 0.98 the
#: threads stretch to 50 times their length.
BURST_LOAD_SHARE = 0.98

#: Slope, N per strain, below which a thread law does not rise: a division by it overflows. The tail of a
#: normal distribution is smaller. A CPU rounds it to zero, a GPU does not.
_MIN_SLOPE = 1e-300


class Status(StatusCode):
    """Status of the solution of one state."""

    OK = 0, "solved"
    UNSTABLE = 1, "no equilibrium: the threads stretch without limit at this pressure"
    STRAIGHT = 2, "no radius: the muscle is longer than its threads"
    NOT_CONVERGED = 3, "not converged: the error of the thread balance exceeds its tolerance"


def stretch_linear(pull: Real, stiffness: Real) -> tuple[Array, Array]:
    """Return the strain of linear threads in the modelled muscle: ε = x / (1 − x), x = pull / stiffness.

    Args:
        pull: pull of pressure on all unstretched threads, P L B0 / (2πN²), N (`braid.hoop_pull`).
        stiffness: n E A, N.

    Returns:
        strain and `Status`. Threads do not push: at a negative pull the strain is zero.
    """
    x = jnp.asarray(pull / stiffness)
    # Not `maximum`, which halves the derivative at zero pressure, where many recordings begin.
    stable_ratio = jnp.minimum(jnp.where(x >= 0, x, 0.0), BURST_LOAD_SHARE)
    return stable_ratio / (1 - stable_ratio), jnp.where(
        x > BURST_LOAD_SHARE, int(Status.UNSTABLE), int(Status.OK)
    )


def stretch_measured(
    force: Real, pressure: Real, length: Real, thread_length: Real, turns: Real, stiffness: Real
) -> tuple[Array, Array]:
    """Return the strain of linear threads at a measured force: the smallest positive root of Eq. 11.

    With b = B/B0, m = L S and d = m − B0 (F − P L²/(4πN²)) the cubic is that of c = b d / m,

        v c³ − c + 1 = 0,   v = B0³ P m² / (4πN² d³),

    which has a positive root for v ≤ 4/27 only, where it meets a second root. The smallest root is that
    of the muscle while x (1 + B²/L²) < 1. This condition is the slope of Eq. 11 at the closed form.

    Args:
        force: measured tension, N.
        pressure: gauge pressure, Pa.
        length: length between the fittings, m.
        thread_length: length of one unloaded thread, m.
        turns: turns of one thread, 1.
        stiffness: n E A, N.

    Returns:
        strain and `Status`.
    """
    per_area = pressure / (4 * jnp.pi * turns**2)
    m = length * stiffness
    d = m - thread_length * (force - per_area * length**2)
    a = per_area * thread_length**3 * m**2
    has_root = (m > 0) & (d > 0) & (27 * a <= 4 * d**3) & (-a < d**3)
    m, d = jnp.where(has_root, m, 1.0), jnp.where(has_root, d, 1.0)
    b = _cubic_root(jnp.where(has_root, a, 0.0) / d**3) * m / d
    return b - 1, jnp.where(has_root, int(Status.OK), int(Status.UNSTABLE))


@jax.custom_jvp
def _cubic_root(v: Array) -> Array:
    """Return the smallest positive root of v c³ − c + 1 = 0, for −1 < v ≤ 4/27: at most 3/2."""
    # The starting value has the square-root singularity of the exact root at v = 4/27. From another start,
    # Newton's method converges slowly there.
    root = 3.0 / (2.0 + jnp.sqrt(jnp.maximum(1.0 - 6.75 * v, 0.0)))
    for _ in range(4):
        slope = jnp.minimum(3 * v * root**2 - 1, -1e-8)
        root = root - (v * root**3 - root + 1) / slope
    return root


@_cubic_root.defjvp
def _cubic_root_jvp(primals, tangents):
    (v,), (v_dot,) = primals, tangents
    root = _cubic_root(v)
    return root, v_dot * root**3 / jnp.maximum(1 - 3 * v * root**2, 1e-8)


def solve_strain(residual: Callable[[Array], Array], start: Array, steps: int = 8) -> Array:
    """Return the root of a rising, convex scalar function after a fixed number of Newton steps.

    A fixed number of steps needs no branch, so that many states run as one loop. The derivative is
    that of the implicit function, in forward and reverse mode and of any order. The steps themselves are
    not differentiated.

    Args:
        residual: load of the threads minus all other pulls on them, N, at a strain.
        start: a strain near the root, or anywhere above it (`AbstractThread.initial_strain`).
        steps: Newton steps.
    """

    def divide(value, slope):
        # Where the function does not rise, step and derivative are zero.
        return value / jnp.where(slope > _MIN_SLOPE, slope, jnp.inf)

    def solve(function, x):
        for _ in range(steps):
            x = x - divide(*jax.jvp(function, (x,), (jnp.ones_like(x),)))
        return x

    def tangent_solve(linear, y):
        return divide(y, linear(jnp.ones_like(y)))

    # Newer JAX also differentiates the start, by zero, and the slope of a start can be infinite.
    return jax.lax.custom_root(residual, jax.lax.stop_gradient(start), solve, tangent_solve)
