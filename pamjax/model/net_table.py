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

#: Order of what is looked up: a force, its slopes, and the slopes of these.
ORDER = 3


class NetTable(eqx.Module):
    """What a net has more than a cylinder, in scaled numbers.

    Attributes:
        thread: B0, m.
        turns: N.
        made: of what the table is: radius of the fittings in units of B0/ν, and ν.
        middle, half: of the range of x.
        terms: coefficients of derivatives by x (first index, up to an order) of volume, mean and mid radius
            (second), by powers of y − 1 (third) and of x, which is −1 to 1 (last).
        lean: derivatives of the terms by what the table is made of; none where nobody will ask for them.
    """

    thread: Scalar
    turns: Scalar
    made: Float[Array, " 2"]
    middle: Scalar
    half: Scalar
    terms: Float[Array, "o 3 j i"]
    lean: Float[Array, "2 p 3 j i"] | None

    def held(self) -> NetTable:
        """The same for finding a balance: without derivatives by what it was made of."""
        return jax.lax.stop_gradient(
            eqx.tree_at(lambda t: (t.terms, t.lean), self, (self.terms[:ORDER], None))
        )

    def near(self, length: Scalar, thread: Scalar) -> NearNet:
        """The table at the state of a length (m) and a thread length (m), with its derivatives there."""
        x, y = jax.lax.stop_gradient((self.place(length, thread), self.thread / thread - 1))
        lean = None if self.lean is None else jnp.stack([_derivatives(one, x, y) for one in self.lean])
        return NearNet(self, _derivatives(self.terms, x, y), lean)

    def place(self, length: Scalar, thread: Scalar) -> Array:
        """x, −1 to 1: held there by a root that takes over smoothly at either end."""
        x = (_wide(length, thread) - self.middle) / self.half
        past = jnp.maximum(jnp.abs(x) - (1 - 2 * MARGIN), 0.0) / (2 * MARGIN)
        less = past - past / jnp.sqrt(jnp.sqrt(1 + past**4))
        return x - 2 * MARGIN * jnp.sign(x) * less


class NearNet(eqx.Module):
    """What a net has more than a cylinder at one state, and how that changes with it.

    Attributes:
        table: where it comes from.
        terms: derivatives by x (first index) and y (second) of volume, mean and mid radius.
        lean: derivatives of these by what the table is made of.
    """

    table: NetTable
    terms: Float[Array, "o o 3 ..."]
    lean: Float[Array, "2 p p 3 ..."] | None

    def __call__(self, length: Scalar, thread: Scalar) -> Net:
        """More than a cylinder has, at the state's own length (m) and thread length (m)."""
        x, y = self.table.place(length, thread), self.table.thread / thread
        volume, mean, mid = _extra((0, 0), x, y, self.table.made, self.terms, self.lean)
        unit = thread / (2 * jnp.pi * self.table.turns)
        return Net(jnp.pi * unit**2 * thread * volume, unit * mean, unit * mid)


Three = tuple[Array, Array, Array]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _extra(
    order: tuple[int, int], x: Array, y: Array, made: Array, terms: Array, lean: Array | None
) -> Three:
    """A tabulated derivative of volume, mean and mid radius, of an order in x and y, whose own derivatives
    are tabulated too.

    What is looked up is then never differentiated itself. Beyond the last order there is nothing, and in what
    the table is made of there is the first alone.
    """
    return tuple(terms[order])


@_extra.defjvp
def _extra_jvp(order, at, along):
    (x, y, made, terms, lean), (dx, dy, more, *_) = at, along
    i, j = order
    changes = []
    if i + j < len(terms) - 1:
        changes.append((_extra((i + 1, j), x, y, made, terms, lean), dx))
        changes.append((_extra((i, j + 1), x, y, made, terms, lean), dy))
    if lean is not None and i + j < len(lean[0]):
        changes += [(_extra(order, x, y, made, one, None), by) for one, by in zip(lean, more, strict=True)]
    nothing = jnp.zeros_like(terms[0, 0, 0])
    change = tuple(sum((slopes[k] * by for slopes, by in changes), nothing) for k in range(3))
    return _extra(order, x, y, made, terms, lean), change


def _derivatives(terms: Float[Array, "o 3 j i"], x: Scalar, y: Scalar) -> Array:
    """Derivatives by x and y up to the order of the terms, (o, o, 3, ...)."""
    in_x = jnp.tensordot(terms, _monomials(x, terms.shape[-1]), 1)
    power = _monomials(y, SIZE[1])
    # Sums are written out: as a reduction over a middle axis they take twice as long.
    in_y = [
        sum(in_x[:, :, j] * (math.perm(j, k) * power[j - k]) for j in range(k, SIZE[1]))
        for k in range(len(terms))
    ]
    return jnp.stack(in_y, axis=1)


def _monomials(x: Scalar, count: int) -> Array:
    """Powers of x from none on, (count, ...)."""
    powers = [jnp.ones_like(x), x]
    while len(powers) < count:
        powers.append(powers[len(powers) // 2] * powers[(len(powers) + 1) // 2])
    return jnp.stack(powers)


def _wide(length: Scalar, thread: Scalar) -> Array:
    """√(1 − (L/B)²), zero for a straight muscle."""
    squared = (thread - length) * (thread + length) / thread**2
    there = squared > 0
    return jnp.where(there, jnp.sqrt(jnp.where(there, squared, 1.0)), 0.0)


def tabulate(thread: Scalar, turns: Scalar, fitting: Scalar) -> NetTable:
    """The table of a braid with threads B0 (m), its turns, and fittings of a radius (m)."""
    thread, turns, fitting = (jnp.asarray(x, float) for x in (thread, turns, fitting))
    nu = 2 * jnp.pi * turns
    made = jnp.stack([jnp.clip(nu * fitting / thread, 0.02, 0.8), nu])
    low = _lowest(*made)
    held = jax.lax.stop_gradient(made)
    terms, lean = jax.vmap(lambda by: jax.jvp(_terms, (held,), (by,)), out_axes=(None, 0))(jnp.eye(2))
    terms, lean = jax.lax.stop_gradient((terms, lean))
    lean = jnp.stack([_slopes(one, ORDER - 1) for one in lean])
    half = 0.5 * (WIDEST - low)
    return NetTable(thread, turns, made, low + half, half, _slopes(terms, ORDER), lean)


def _lowest(edge: Array, nu: Array) -> Array:
    """x of the longest net there is a table for."""
    sine = jnp.sqrt(1 - (NARROWEST * edge) ** 2)
    low = jnp.sqrt(jnp.maximum(1 - length_at(sine, edge, nu) ** 2, 0.01 * edge**2))
    return jnp.clip(low, 0.5 * edge, edge)


def _terms(made: Float[Array, " 2"]) -> Float[Array, "3 j i"]:
    edge, nu = made
    low = _lowest(edge, nu)
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
    return jnp.einsum("ip,pqk,jq->kji", in_x, found, in_y)


def _slopes(terms: Float[Array, "3 j i"], order: int) -> Float[Array, "o 3 j i"]:
    """The coefficients with those of the derivatives by x up to an order."""
    found = [terms]
    for _ in range(order):
        slope = found[-1][..., 1:] * np.arange(1, SIZE[0])
        found.append(jnp.concatenate([slope, jnp.zeros_like(slope[..., :1])], axis=-1))
    return jnp.stack(found)


def _of_powers(size: int, least: float = 0.0, most: float = 2.0) -> np.ndarray:
    """From Chebyshev coefficients between two ends to those of the powers of the distance from one."""
    unit = np.polynomial.Polynomial([2 * (1 - least) / (most - least) - 1, 2 / (most - least)])
    columns = [np.polynomial.Chebyshev.basis(k)(unit).coef for k in range(size)]
    return np.stack([np.pad(c, (0, size - c.size)) for c in columns], axis=1)


def _nodes(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev's points, and the matrix from values there to coefficients."""
    points = np.cos(np.pi * (np.arange(size) + 0.5) / size)
    return points, np.linalg.inv(np.polynomial.chebyshev.chebvander(points, size - 1))
