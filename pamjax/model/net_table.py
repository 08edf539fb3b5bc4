"""A polynomial of the net of `net.py`, for one braid and one radius of its fittings.

A recording has thousands of states, and a balance evaluates each about ten times, with derivatives. The
difference between net and cylinder is smooth in two numbers, the scaled radius of a cylinder and the stretch,

    x = √(1 − (L/B)²),   y = B0/B,

so that a polynomial approximates it. It is computed once for each set of parameters, with derivatives with
respect to all of them. The force is the derivative of the volume's polynomial, so that both are exactly
consistent.

Neglects: muscles stretched or contracted beyond the range of the polynomial, and threads that are a
third longer than at rest. There the muscle becomes a cylinder minus a constant volume.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.model.barrier import materialize
from pamjax.model.net import Net, scaled_length, solve_net
from pamjax.parameter import Scalar

#: Number of coefficients in x and y. The error of the paper's muscle is then below 0.1 N at 689 kPa.
_COEFFICIENT_COUNTS = (20, 5)

#: Maximum x, a little beyond free contraction (0.816).
_MAX_WIDTH = 0.86

#: Mid radius of the longest net over the fitting's radius. `net.py` is not valid below about 0.6.
_MIN_MIDDLE_RATIO = 0.72

#: Minimum and maximum y.
_MIN_STRETCH_RATIO, _MAX_STRETCH_RATIO = 0.75, 1.02

#: Share of the range, at either end, over which x approaches a constant.
_EDGE_MARGIN = 0.04

#: Order of the tabulated derivatives: force, its first derivatives, and its second ones.
_DERIVATIVE_ORDER = 3


class NetTable(eqx.Module):
    """Polynomials of the difference between net and cylinder, in scaled numbers.

    Attributes:
        thread: unloaded thread length B0, m.
        turns: turns N of one thread.
        net_parameters: radius of the fittings in units of B0/ν, and ν.
        middle: middle of the range of x.
        half_range: half of the range of x.
        coefficients: coefficients of the derivatives by x (first index) of volume, mean radius and mid radius
            (second). The third index is the power of y − 1, the last that of x scaled to −1 to 1.
        parameter_slopes: derivatives of the coefficients by `net_parameters`.
    """

    thread: Scalar
    turns: Scalar
    net_parameters: Float[Array, " 2"]
    middle: Scalar
    half_range: Scalar
    coefficients: Float[Array, "o 3 j i"]
    parameter_slopes: Float[Array, "2 p 3 j i"]

    def __call__(self, length: Scalar, thread: Scalar) -> Net:
        """Return the difference between net and cylinder at a length (m) and a thread length (m)."""
        x, y = self.scaled_width(length, thread), self.thread / thread
        # A Taylor series around the same state: its derivatives are the tabulated ones, and the polynomial
        # of a hundred coefficients is evaluated once for all orders.
        x0, y0 = jax.lax.stop_gradient((x, y))
        derivatives = _evaluate_derivatives(
            self.net_parameters, self.coefficients, self.parameter_slopes, x0, y0 - 1
        )
        volume, mean, mid = _sum_taylor_series(derivatives, x - x0, y - y0)
        unit = thread / (2 * jnp.pi * self.turns)
        return Net(jnp.pi * unit**2 * thread * volume, unit * mean, unit * mid)

    def scaled_width(self, length: Scalar, thread: Scalar) -> Array:
        """Return x scaled to −1 to 1, with a smooth limit at either end."""
        x = (_relative_width(length, thread) - self.middle) / self.half_range
        beyond = jnp.maximum(jnp.abs(x) - (1 - 2 * _EDGE_MARGIN), 0.0) / (2 * _EDGE_MARGIN)
        excess = beyond - beyond / jnp.sqrt(jnp.sqrt(1 + beyond**4))
        return x - 2 * _EDGE_MARGIN * jnp.sign(x) * excess


@jax.custom_jvp
def _evaluate_derivatives(
    net_parameters: Array, coefficients: Array, parameter_slopes: Array, x: Array, y: Array
) -> Float[Array, "o o 3 ..."]:
    """Return the tabulated derivatives by x (first index) and y (second) at one x (scaled) and y (minus 1).

    Of their own derivatives only the first by `net_parameters` exists.
    """
    return _evaluate_polynomials(coefficients, x, y)


@_evaluate_derivatives.defjvp
def _evaluate_derivatives_jvp(primals, tangents) -> tuple[Array, Array]:
    (_, coefficients, parameter_slopes, x, y), (parameter_steps, *_) = primals, tangents
    derivatives = _evaluate_polynomials(coefficients, x, y)
    change = sum(
        _evaluate_polynomials(slopes, x, y) * step
        for slopes, step in zip(parameter_slopes, parameter_steps, strict=True)
    )
    # The highest order has no tabulated slopes.
    missing = [(0, 1), (0, 1), *[(0, 0)] * (derivatives.ndim - 2)]
    return derivatives, jnp.pad(change, missing)


def _evaluate_polynomials(
    coefficients: Float[Array, "o 3 j i"], x: Scalar, y: Scalar
) -> Float[Array, "o o 3 ..."]:
    """Return the derivatives by x (first index) and y (second)."""
    order, _, y_count, x_count = coefficients.shape
    in_x = jnp.tensordot(coefficients, _monomials(x, x_count), 1)
    powers = _monomials(y, y_count)
    # Derivatives of each power of y, (j, o, ...).
    in_y = [
        jnp.stack([math.perm(j, k) * powers[j - k] if k <= j else jnp.zeros_like(y) for k in range(order)])
        for j in range(y_count)
    ]
    # A reduction over a middle axis would take twice as long as this sum.
    terms = (in_x[:, None, :, j] * in_y[j][None, :, None] for j in range(y_count))
    return materialize(sum(terms, jnp.zeros(())))


def _sum_taylor_series(derivatives: Float[Array, "o o 3 ..."], dx: Array, dy: Array) -> Array:
    """Return the Taylor series with these derivatives, (3, ...), by Horner's rule in both variables."""

    def sum_powers(terms: list[Array], step: Array) -> Array:
        total = terms[-1]
        for k in range(len(terms) - 1, 0, -1):
            total = terms[k - 1] + total * (step / k)
        return total

    count = len(derivatives)
    return sum_powers(
        [sum_powers([derivatives[i, j] for i in range(count - j)], dx) for j in range(count)], dy
    )


def _monomials(x: Scalar, count: int) -> Array:
    """Return the powers of x from zero on, (count, ...)."""
    powers = [jnp.ones_like(x), x]
    while len(powers) < count:
        powers.append(powers[len(powers) // 2] * powers[(len(powers) + 1) // 2])
    return jnp.stack(powers)


def _relative_width(length: Scalar, thread: Scalar) -> Array:
    """Return √(1 − (L/B)²), zero for a straight muscle."""
    width_squared = (thread - length) * (thread + length) / thread**2
    is_valid = width_squared > 0
    return jnp.where(is_valid, jnp.sqrt(jnp.where(is_valid, width_squared, 1.0)), 0.0)


def tabulate_net(thread: Scalar, turns: Scalar, fitting: Scalar) -> NetTable:
    """Return the table of a braid with threads B0 (m), its turns, and fittings of a radius (m)."""
    thread, turns, fitting = (jnp.asarray(x, float) for x in (thread, turns, fitting))
    nu = 2 * jnp.pi * turns
    net_parameters = jnp.stack([jnp.clip(nu * fitting / thread, 0.02, 0.8), nu])
    low = _lowest_width(*net_parameters)
    constants = jax.lax.stop_gradient(net_parameters)
    coefficients, parameter_slopes = jax.vmap(
        lambda by: jax.jvp(_fit_coefficients, (constants,), (by,)), out_axes=(None, 0)
    )(jnp.eye(2))
    coefficients, parameter_slopes = jax.lax.stop_gradient((coefficients, parameter_slopes))
    parameter_slopes = jnp.stack(
        [_stack_derivatives(slopes, _DERIVATIVE_ORDER - 1) for slopes in parameter_slopes]
    )
    half_range = 0.5 * (_MAX_WIDTH - low)
    return NetTable(
        thread,
        turns,
        net_parameters,
        low + half_range,
        half_range,
        _stack_derivatives(coefficients, _DERIVATIVE_ORDER),
        parameter_slopes,
    )


def _lowest_width(edge: Array, nu: Array) -> Array:
    """Return x of the longest net in the table."""
    sine = jnp.sqrt(1 - (_MIN_MIDDLE_RATIO * edge) ** 2)
    low = jnp.sqrt(jnp.maximum(1 - scaled_length(sine, edge, nu) ** 2, 0.01 * edge**2))
    return jnp.clip(low, 0.5 * edge, edge)


def _fit_coefficients(net_parameters: Float[Array, " 2"]) -> Float[Array, "3 j i"]:
    edge, nu = net_parameters
    low = _lowest_width(edge, nu)
    (at_x, to_x), (at_y, to_y) = (_chebyshev_nodes(size) for size in _COEFFICIENT_COUNTS)
    x = low + 0.5 * (_MAX_WIDTH - low) * (at_x + 1)
    y = _MIN_STRETCH_RATIO + 0.5 * (_MAX_STRETCH_RATIO - _MIN_STRETCH_RATIO) * (at_y + 1)

    def compute_difference(x, y):
        """Return the difference in units in which the thread length is ν, so that radii are ρ."""
        sine = jnp.sqrt(1 - x**2)
        net = solve_net(nu * sine, nu, nu / (2 * jnp.pi), edge * y)
        return jnp.stack([net.volume / (jnp.pi * nu) - x**2 * sine, net.mean_radius - x, net.mid_radius - x])

    values = jax.vmap(lambda x: jax.vmap(lambda y: compute_difference(x, y))(y))(x)
    in_x, in_y = (
        _chebyshev_to_powers(_COEFFICIENT_COUNTS[0]) @ to_x,
        _chebyshev_to_powers(_COEFFICIENT_COUNTS[1], _MIN_STRETCH_RATIO, _MAX_STRETCH_RATIO) @ to_y,
    )
    return jnp.einsum("ip,pqk,jq->kji", in_x, values, in_y)


def _stack_derivatives(coefficients: Float[Array, "3 j i"], order: int) -> Float[Array, "o 3 j i"]:
    """Return the coefficients and those of the derivatives by x up to an order."""
    derivatives = [coefficients]
    for _ in range(order):
        slope = derivatives[-1][..., 1:] * np.arange(1, _COEFFICIENT_COUNTS[0])
        derivatives.append(jnp.concatenate([slope, jnp.zeros_like(slope[..., :1])], axis=-1))
    return jnp.stack(derivatives)


def _chebyshev_to_powers(size: int, low: float = 0.0, high: float = 2.0) -> np.ndarray:
    """Return the matrix from Chebyshev coefficients between two ends to those of powers of x − 1."""
    unit = np.polynomial.Polynomial([2 * (1 - low) / (high - low) - 1, 2 / (high - low)])
    columns = [np.polynomial.Chebyshev.basis(k)(unit).coef for k in range(size)]
    return np.stack([np.pad(c, (0, size - c.size)) for c in columns], axis=1)


def _chebyshev_nodes(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Chebyshev nodes, and the matrix from values at them to coefficients."""
    points = np.cos(np.pi * (np.arange(size) + 0.5) / size)
    return points, np.linalg.inv(np.polynomial.chebyshev.chebvander(points, size - 1))
