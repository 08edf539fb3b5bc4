"""Whitening of a dataset's residuals within a compiled program.

The recursion of `infer/noise/ar1_filter.py`, for sample t of a run with standardised residual s_t,

    e_t = s_t − ρ s_t−1 + θ_t e_t−1,     white residual = e_t / √(p_t + W),

is a linear recurrence, which a parallel scan computes. A run begins with e_1 = s_1.
"""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int


class Whitening(eqx.Module):
    """Whitening filter of both channels; padded to the rows of the dataset.

    Attributes:
        order: (2, n) rows of the samples of a channel in the order of time, then padding.
        position: (2, n) position of each of them in its run; −1 for padding.
        correlation: (2,) ρ.
        feedback: (2, n) θ at each position of a run.
        innovation_sd: (2, n) √(p + W) at each position of a run.
        variance_inflation: factor on variances, for systematic misfit.
    """

    order: Int[Array, "2 n"]
    position: Int[Array, "2 n"]
    correlation: Float[Array, " 2"]
    feedback: Float[Array, "2 n"]
    innovation_sd: Float[Array, "2 n"]
    variance_inflation: Array

    def whiten(self, standardised: Float[Array, " n"], channel: int) -> Float[Array, " n"]:
        """Return the white residuals of a channel in the order of time, then zeros for padding."""
        position = self.position[channel]
        s = jnp.where(position >= 0, standardised[self.order[channel]], 0.0)
        feedback, sd = self.feedback[channel][position], self.innovation_sd[channel][position]
        return filter_samples(s, position, self.correlation[channel], feedback, sd)

    def restrict_to_rows(self, is_kept: np.ndarray) -> Whitening:
        """Return the filter for some rows, (n,) mask; an excluded sample ends a run."""
        pairs = [_restrict_channel(*pair, is_kept) for pair in zip(self.order, self.position, strict=True)]
        order, position = (jnp.asarray(np.stack(arrays)) for arrays in zip(*pairs, strict=True))
        return replace(self, order=order, position=position)


def filter_samples(
    s: Float[Array, " n"],
    position: Int[Array, " n"],
    correlation: ArrayLike,
    feedback: Float[Array, " n"],
    innovation_sd: Float[Array, " n"],
) -> Float[Array, " n"]:
    """Return the white residuals of standardised samples in the order of time; zero for padding.

    Args:
        s: standardised samples; zero for padding.
        position: position of each sample in its run; −1 for padding.
        correlation: ρ.
        feedback: θ of each sample.
        innovation_sd: √(p + W) of each sample.
    """
    is_later = position > 0
    driving = s - jnp.where(is_later, correlation * jnp.roll(s, 1), 0.0)

    def combine(first, second):
        return second[0] * first[0], second[0] * first[1] + second[1]

    _, innovation = jax.lax.associative_scan(combine, (jnp.where(is_later, feedback, 0.0), driving))
    return innovation / jnp.where(position >= 0, innovation_sd, 1.0)


def compute_filter(
    ar1_fraction: ArrayLike, correlation: ArrayLike, position: Int[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return θ and √(p + W) of samples, with derivatives by the fraction A and the correlation ρ.

    The recursion p' = ρ² p W / (p + W) + q, with q = A (1 − ρ²), has the fixed points p₊ and p₋.
    It multiplies (p − p₊) / (p − p₋) by a constant.

    Args:
        ar1_fraction: A, the autocorrelated fraction of the variance; above 0.
        correlation: ρ, between −1 and 1.
        position: (n,) position of each sample in its run; −1 for padding.
    """
    a, rho = jnp.asarray(ar1_fraction), jnp.asarray(correlation)
    w, q = 1 - a, a * (1 - rho**2)
    b = w * (1 - rho**2) - q
    root = jnp.sqrt(b**2 + 4 * q * w)
    high, low = (-b + root) / 2, (-b - root) / 2
    factor = (rho**2 * w + q - high) / (rho**2 * w + q - low)

    def compute_variance(step):
        # A power of zero has no derivative at zero; the first sample does not depend on the factor.
        decay = jnp.where(step > 0, factor ** jnp.maximum(step, 1), 1.0) * (a - high) / (a - low)
        return (high - decay * low) / (1 - decay) + w

    before = compute_variance(jnp.maximum(position - 1, 0))
    return rho * w / before, jnp.sqrt(compute_variance(jnp.maximum(position, 0)))


def _restrict_channel(order, position, is_kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order, position = np.asarray(order), np.asarray(position)
    keep = (position >= 0) & is_kept[order]
    # A sample begins a run if it did before, or if its predecessor is excluded.
    begins = keep & ((position == 0) | ~np.concatenate([[False], keep[:-1]]))
    return pack_samples(order[keep], begins[keep], order.size)


def pack_samples(rows: np.ndarray, begins: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and positions in their runs, padded to `size`.

    >>> pack_samples(np.array([3, 4, 7]), np.array([True, False, True]), 4)[1].tolist()
    [0, 1, 0, -1]
    """
    index = np.arange(rows.size)
    first = np.maximum.accumulate(np.where(begins, index, 0)) if rows.size else index
    order, position = np.zeros(size, dtype=int), np.full(size, -1)
    order[: rows.size], position[: rows.size] = rows, index - first
    return order, position
