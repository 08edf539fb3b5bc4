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

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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


#: Into how many pieces the table is cut for looking up, and how far beyond the polynomial they reach, in
#: halves of its width: there it has been left, and what is missing is constant.
PIECES, BEYOND = 48, 0.35


class NetTable(eqx.Module):
    """What a net has more than a cylinder, in scaled numbers.

    Attributes:
        thread: B0, m.
        turns: N.
        low: x where the first piece begins.
        step: width of a piece, in x.
        terms: of each piece, for volume, mean and mid radius (third index): coefficients of the powers of
            x from its begin to its end, 0 to 1, and of those of y − 1.
    """

    thread: Scalar
    turns: Scalar
    low: Scalar
    step: Scalar
    terms: Float[Array, "m 6 3 j"]

    def near(self, length: Scalar, thread: Scalar) -> NearNet:
        """The piece of the table that a length (m) lies in."""
        along = (_wide(length, thread) - self.low) / self.step
        piece = jnp.clip(jax.lax.stop_gradient(along).astype(int), 0, PIECES - 1)
        begin = self.low + self.step * piece
        return NearNet(self.thread, self.turns, begin, self.step, self.terms[piece])


class NearNet(eqx.Module):
    """What a net has more than a cylinder in one piece of its table: a quintic, so that a balance and its
    derivatives are cheap.

    Attributes:
        thread: B0, m.
        turns: N.
        begin, step: where the piece begins and how wide it is, in x.
        terms: of volume, mean and mid radius (middle index): coefficients of the powers of x from begin
            to end, 0 to 1, and of y − 1.
    """

    thread: Scalar
    turns: Scalar
    begin: Scalar
    step: Scalar
    terms: Float[Array, "6 3 5"]

    def __call__(self, length: Scalar, thread: Scalar) -> Net:
        """More than a cylinder has, at a length (m) and a thread length (m)."""
        x, y = (_wide(length, thread) - self.begin) / self.step, self.thread / thread - 1
        unit = thread / (2 * jnp.pi * self.turns)
        scales = (jnp.pi * unit**2 * thread, unit, unit)
        return Net(*(scale * _quintic(self.terms[:, k], x, y) for k, scale in enumerate(scales)))


def _quintic(c: Float[Array, "6 5"], x: Scalar, y: Scalar) -> Array:
    rows = [_horner([row[j] for j in range(SIZE[1])], y) for row in c]
    return _horner(rows, x)


def _horner(coefficients: list[Array], x: Scalar) -> Array:
    *rest, value = coefficients
    for coefficient in reversed(rest):
        value = coefficient + x * value
    return value


def _wide(length: Scalar, thread: Scalar) -> Array:
    """√(1 − (L/B)²), zero for a straight muscle."""
    squared = (thread - length) * (thread + length) / thread**2
    there = squared > 0
    return jnp.where(there, jnp.sqrt(jnp.where(there, squared, 1.0)), 0.0)


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
    in_x, in_y = _of_powers(SIZE[0]) @ to_x, _of_powers(SIZE[1], LEAST, MOST) @ to_y
    powers = jnp.stack([in_x @ found[..., k] @ in_y.T for k in range(3)], axis=1)
    unit = np.linspace(-1 - BEYOND, 1 + BEYOND, PIECES + 1)
    terms = jnp.einsum("pqi,ikj->pqkj", jnp.asarray(_quintics(unit)), powers)
    to_unit = 2 / (WIDEST - low)
    first, step = low + (unit[0] + 1) / to_unit, (unit[1] - unit[0]) / to_unit
    return NetTable(thread, turns, first, step, terms)


def _quintics(ends: np.ndarray) -> np.ndarray:
    """(pieces, 6, size): from coefficients of the powers of x to those of a quintic in each piece.

    A quintic is fixed by value, slope and curvature at both ends of its piece, so that neighbours agree
    in all three.
    """
    held, slope, bend = _inside(ends)
    value, first, second = np.moveaxis(_powers(held), 1, 0)
    wide = ends[1] - ends[0]
    at = np.stack(
        [
            value,
            wide * first * slope[:, None],
            wide**2 * (second * slope[:, None] ** 2 + first * bend[:, None]),
        ],
        axis=1,
    )
    power = np.arange(6)
    conditions = [[math.factorial(k) * (p == k) for p in power] for k in range(3)]
    conditions += [[math.perm(int(p), k) for p in power] for k in range(3)]
    return np.linalg.inv(np.array(conditions, dtype=float)) @ np.concatenate([at[:-1], at[1:]], axis=1)


def _powers(x: np.ndarray) -> np.ndarray:
    """(n, 3, size): the powers of each x, their slopes and curvatures."""
    k = np.arange(SIZE[0])
    return np.stack(
        [np.array([math.perm(int(i), d) for i in k]) * x[:, None] ** np.maximum(k - d, 0) for d in range(3)],
        axis=1,
    )


def _of_powers(size: int, least: float = 0.0, most: float = 2.0) -> np.ndarray:
    """From Chebyshev coefficients between two ends to those of the powers of the distance from one."""
    unit = np.polynomial.Polynomial([2 * (1 - least) / (most - least) - 1, 2 / (most - least)])
    columns = [np.polynomial.Chebyshev.basis(k)(unit).coef for k in range(size)]
    return np.stack([np.pad(c, (0, size - c.size)) for c in columns], axis=1)


def _nodes(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev's points, and the matrix from values there to coefficients."""
    points = np.cos(np.pi * (np.arange(size) + 0.5) / size)
    return points, np.linalg.inv(np.polynomial.chebyshev.chebvander(points, size - 1))


def _inside(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, held between −1 and 1 by an exponential that takes over smoothly at either end."""
    past = np.maximum(np.abs(x) - (1 - 2 * MARGIN), 0.0)
    less = np.expm1(-past / (2 * MARGIN))
    bend = np.where(past > 0, -np.sign(x) * (1 + less) / (2 * MARGIN), 0.0)
    return x - np.sign(x) * (past + 2 * MARGIN * less), 1 + less, bend
