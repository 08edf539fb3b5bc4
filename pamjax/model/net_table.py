"""The net of `net.py` as a table for one braid and one radius of its fittings.

A recording asks for thousands of states, and a balance for each some ten times, with derivatives. What the
net has more than a cylinder is smooth in two numbers, the radius a cylinder would have and the stretch,

    x = √(1 − (L/B)²),   y = B0/B,

so that a polynomial stands for it: made once for each set of numbers, and differentiable in all of them.
Force comes from the slope of the volume's own polynomial, so that both belong together to the last digit.

What it leaves out: muscles stretched or contracted beyond the polynomial, and threads that are a third longer
than at rest. There the muscle goes over into a cylinder with a constant piece of volume missing.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from pamjax.model.net import Net, length_at, net
from pamjax.parameter import Scalar

#: Coefficients in x and y: forces of the paper's muscle are then right within 0.1 N at 689 kPa.
SIZE = (20, 5)

#: Widest cylinder, as x: a little beyond free contraction (0.816).
WIDEST = 0.86

#: Middle of the longest net, as a share of the fitting's radius. At some 0.6 the expansion of `net.py` ends.
NARROWEST = 0.72

#: Least and largest y.
LEAST, MOST = 0.75, 1.02

#: Share of the range, at either end, over which the polynomial is left.
MARGIN = 0.04

#: From the coefficients of a series to those of its slope, in x and y.
_SLOPE = tuple(np.pad(np.polynomial.chebyshev.chebder(np.eye(size)), ((0, 1), (0, 0))) for size in SIZE)


class NetTable(eqx.Module):
    """What a net has more than a cylinder, in scaled numbers.

    Attributes:
        thread: B0, m.
        turns: N.
        low: least x.
        volume, mean_radius, mid_radius: Chebyshev coefficients in x and y.
    """

    thread: Scalar
    turns: Scalar
    low: Scalar
    volume: Float[Array, "i j"]
    mean_radius: Float[Array, "i j"]
    mid_radius: Float[Array, "i j"]

    def __call__(self, length: Scalar, thread: Scalar) -> Net:
        """More than a cylinder has, at a length (m) and a thread length (m)."""
        squared = (thread - length) * (thread + length) / thread**2
        there = squared > 0
        x = jnp.where(there, jnp.sqrt(jnp.where(there, squared, 1.0)), 0.0)
        at = _inside(_to_unit(x, self.low, WIDEST)), _inside(_to_unit(self.thread / thread, LEAST, MOST))
        unit = thread / (2 * jnp.pi * self.turns)
        scales = (jnp.pi * unit**2 * thread, unit, unit)
        tables = (self.volume, self.mean_radius, self.mid_radius)
        return Net(*(scale * _series(table, *at) for scale, table in zip(scales, tables, strict=True)))


def tabulate(thread: Scalar, turns: Scalar, fitting: Scalar) -> NetTable:
    """The table of a braid with threads B0 (m), its turns, and fittings of a radius (m)."""
    thread, turns, fitting = (jnp.asarray(x, float) for x in (thread, turns, fitting))
    nu = 2 * jnp.pi * turns
    edge = jnp.clip(nu * fitting / thread, 0.02, 0.8)
    sine = jnp.sqrt(1 - (NARROWEST * edge) ** 2)
    low = jnp.sqrt(jnp.maximum(1 - length_at(sine, edge, nu) ** 2, 0.01 * edge**2))
    low = jnp.clip(low, 0.5 * edge, edge)
    (at_x, to_x), (at_y, to_y) = (_nodes(size) for size in SIZE)
    x = low + 0.5 * (WIDEST - low) * (at_x + 1)
    y = LEAST + 0.5 * (MOST - LEAST) * (at_y + 1)

    def more(x, y):
        """In units in which the thread is ν long, so that radii are ρ."""
        sine = jnp.sqrt(1 - x**2)
        found = net(nu * sine, nu, turns, edge * y)
        return jnp.stack(
            [found.volume / (jnp.pi * nu) - x**2 * sine, found.mean_radius - x, found.mid_radius - x]
        )

    found = jax.vmap(lambda x: jax.vmap(lambda y: more(x, y))(y))(x)
    return NetTable(thread, turns, low, *(jnp.asarray(to_x) @ found[..., k] @ to_y.T for k in range(3)))


@jax.custom_jvp
def _series(table: Float[Array, "i j"], x: Scalar, y: Scalar) -> Array:
    """Σ table_ij T_i(x) T_j(y)."""
    in_x, in_y = jax.lax.optimization_barrier((_chebyshev(x, SIZE[0]), _chebyshev(y, SIZE[1])))
    return in_x @ table @ in_y


def _series_jvp(primals, tangents):
    """The slope of a series is a series: so no derivative is ever taken through the recurrence."""
    table, x, y = primals
    slopes = lambda: _series(_SLOPE[0] @ table, x, y), lambda: _series(table @ _SLOPE[1].T, x, y)
    of_table, of_x, of_y = (None if isinstance(t, SymbolicZero) else t for t in tangents)
    parts = [slope() * t for slope, t in zip(slopes, (of_x, of_y), strict=True) if t is not None]
    if of_table is not None:
        parts.append(_series(of_table, x, y))
    return _series(table, x, y), sum(parts, jnp.zeros(()))


_series.defjvp(_series_jvp, symbolic_zeros=True)


def _nodes(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev's points, and the matrix from values there to coefficients."""
    points = np.cos(np.pi * (np.arange(size) + 0.5) / size)
    return points, np.linalg.inv(np.polynomial.chebyshev.chebvander(points, size - 1))


def _to_unit(x: Scalar, low: Scalar | float, high: float) -> Array:
    return 2 * (x - low) / (high - low) - 1


def _inside(x: Array) -> Array:
    """x, held between −1 and 1 by an exponential that takes over smoothly at either end."""
    past = jnp.maximum(jnp.abs(x) - (1 - 2 * MARGIN), 0.0)
    return x - jnp.sign(x) * (past + 2 * MARGIN * jnp.expm1(-past / (2 * MARGIN)))


def _chebyshev(x: Array, size: int) -> Array:
    found = [jnp.ones_like(x), x]
    for _ in range(size - 2):
        found.append(2 * x * found[-1] - found[-2])
    return jnp.stack(found)
