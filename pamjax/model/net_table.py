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
from functools import partial

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

#: Order of the polynomial around a state: a force, its slopes, and the slopes of these.
ORDER = 3


class NetTable(eqx.Module):
    """What a net has more than a cylinder, in scaled numbers.

    Attributes:
        thread: B0, m, times the share by which the fittings grew since the table was made: y is this over B.
        turns: N.
        low: x where the first piece begins.
        step: width of a piece, in x.
        terms: of each piece (last index), for volume, mean and mid radius (second): coefficients of the
            powers of x from its begin to its end, 0 to 1, and of those of y − 1.
        lean: derivative of the terms by ν; none where no derivative will be asked for.
    """

    thread: Scalar
    turns: Scalar
    low: Scalar
    step: Scalar
    terms: Float[Array, "6 3 j m"]
    lean: Float[Array, "6 3 j m"] | None

    def held(self) -> NetTable:
        """The same without derivatives by what it was made of."""
        still = NetTable(self.thread, self.turns, self.low, self.step, self.terms, None)
        return jax.lax.stop_gradient(still)

    def near(self, length: Scalar, thread: Scalar) -> NearNet:
        """The table at the state of a length (m) and a thread length (m), with its derivatives there."""
        x, y = jax.lax.stop_gradient((_wide(length, thread), self.thread / thread - 1))
        along = (x - self.low) / self.step
        piece = jnp.clip(along.astype(int), 0, PIECES - 1)
        terms = _around(self.terms[..., piece], along - piece, y, ORDER)
        lean = None if self.lean is None else _around(self.lean[..., piece], along - piece, y, ORDER - 1)
        return NearNet(self.thread, self.turns, self.step, terms, lean)


class NearNet(eqx.Module):
    """What a net has more than a cylinder at one state, and how that changes with it.

    Attributes:
        thread: B0 as the table has it, m.
        turns: N.
        step: unit of x.
        terms: derivatives by x (first index) and y (second) of volume, mean and mid radius.
        lean: derivatives of these by ν.
    """

    thread: Scalar
    turns: Scalar
    step: Scalar
    terms: Float[Array, "d d 3 ..."]
    lean: Float[Array, "e e 3 ..."] | None

    def __call__(self, length: Scalar, thread: Scalar) -> Net:
        """More than a cylinder has, at the state's own length (m) and thread length (m)."""
        x, y, nu = _wide(length, thread) / self.step, self.thread / thread, 2 * jnp.pi * self.turns
        volume, mean, mid = _extra((0, 0), x, y, nu, self.terms, self.lean)
        unit = thread / nu
        return Net(jnp.pi * unit**2 * thread * volume, unit * mean, unit * mid)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _extra(order: tuple[int, int], x: Array, y: Array, nu: Array, terms: Array, lean: Array | None) -> Array:
    """A tabulated derivative, (3, ...), of an order in x and y, whose own derivatives are tabulated too.

    What is looked up is then never differentiated itself, and one table serves the derivatives in all
    numbers: those in thread and fitting are the slope in y. Beyond the last order there is nothing, and in
    ν there is the first alone.
    """
    return terms[order]


@_extra.defjvp
def _extra_jvp(order, at, along):
    (x, y, nu, terms, lean), (dx, dy, dnu, *_) = at, along
    i, j = order
    change = jnp.zeros_like(terms[order])
    if i + j < terms.shape[0] - 1:
        change += _extra((i + 1, j), x, y, nu, terms, lean) * dx + _extra((i, j + 1), x, y, nu, terms, lean) * dy
    if lean is not None and i + j < lean.shape[0]:
        change += _extra(order, x, y, nu, lean, None) * dnu
    return terms[order], change


def _around(terms: Float[Array, "6 3 j ..."], x: Scalar, y: Scalar, order: int) -> Array:
    """A piece's derivatives by x and y up to an order, (order + 1, order + 1, 3, ...)."""
    in_x = jnp.moveaxis(_derivatives(terms, x, order), 2, 0)
    return jnp.swapaxes(_derivatives(in_x, y, order), 0, 1)


def _derivatives(coefficients: Float[Array, "p ..."], x: Scalar, order: int) -> Array:
    """Value and derivatives of a polynomial, by Horner's scheme: (order + 1, ...)."""

    def add(found, coefficient):
        return found * x + jnp.concatenate([coefficient[None], found[:-1]]), None

    # A loop, since its results are written down: unrolled, they would be worked out anew for every use.
    nothing = jnp.zeros((order + 1, *coefficients.shape[1:]))
    found, _ = jax.lax.scan(add, nothing, coefficients, reverse=True)
    return jnp.stack([math.factorial(k) * found[k] for k in range(order + 1)])


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
    held, at = jax.lax.stop_gradient((edge, nu))
    low = jax.lax.stop_gradient(_lowest(held, at))
    terms, lean = jax.jvp(lambda nu: _terms(low, held, nu), (at,), (jnp.ones_like(at),))
    terms, lean = jax.lax.stop_gradient((terms, lean))
    half = 0.5 * (WIDEST - low)
    return NetTable(thread * (edge / held), turns, low - half * BEYOND, half * 2 * (1 + BEYOND) / PIECES, terms, lean)


def _lowest(edge: Array, nu: Array) -> Array:
    """x of the longest net there is a table for."""
    sine = jnp.sqrt(1 - (NARROWEST * edge) ** 2)
    low = jnp.sqrt(jnp.maximum(1 - length_at(sine, edge, nu) ** 2, 0.01 * edge**2))
    return jnp.clip(low, 0.5 * edge, edge)


def _terms(low: Array, edge: Array, nu: Array) -> Float[Array, "6 3 j m"]:
    (at_x, to_x), (at_y, to_y) = (_nodes(size) for size in SIZE)
    x = low + 0.5 * (WIDEST - low) * (at_x + 1)
    y = LEAST + 0.5 * (MOST - LEAST) * (at_y + 1)

    def more(x, y):
        """In units in which the thread is ν long, so that radii are ρ."""
        sine = jnp.sqrt(1 - x**2)
        found = net(nu * sine, nu, nu / (2 * jnp.pi), edge * y)
        return jnp.stack(
            [found.volume / (jnp.pi * nu) - x**2 * sine, found.mean_radius - x, found.mid_radius - x]
        )

    found = jax.vmap(lambda x: jax.vmap(lambda y: more(x, y))(y))(x)
    in_x, in_y = _of_powers(SIZE[0]) @ to_x, _of_powers(SIZE[1], LEAST, MOST) @ to_y
    powers = jnp.stack([in_x @ found[..., k] @ in_y.T for k in range(3)], axis=1)
    unit = np.linspace(-1 - BEYOND, 1 + BEYOND, PIECES + 1)
    return jnp.einsum("pqi,ikj->qkjp", jnp.asarray(_quintics(unit)), powers)


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
