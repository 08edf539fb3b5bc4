"""What the draws of a posterior would show: rows with their noise, and the log-likelihood of every block."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr, ndtri

from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.posterior.ar1_likelihood import Stream
from pamjax.infer.posterior.log_density import Density
from pamjax.infer.problem.dataset import CHANNELS

#: Draws that go through the model together.
BATCH = 16
#: Rows of no block, as passages between two settings, count as one.
BETWEEN = "between blocks"


def predictions(density: Density, values: np.ndarray, k: int) -> dict[str, np.ndarray]:
    """Force and diameter of member k at draws, without noise, (draws, rows) each, SI.

    Args:
        values: (draws, p) numbers, SI.
    """
    parts = [_read(density, k, jnp.asarray(batch)) for batch in _batches(values)]
    together = np.concatenate([np.asarray(p) for p in parts])[: len(values)]
    return dict(zip(CHANNELS, np.moveaxis(together, 1, 0), strict=True))


def with_noise(
    one: CaseFit, stream: Stream, prediction: np.ndarray, values: np.ndarray, seed: int
) -> np.ndarray:
    """Predictions as a bench would have recorded them, (draws, rows), SI; NaN where nothing was measured."""
    n = one.case.recording.n
    there, linked = (np.asarray(a)[:n] > 0 for a in (stream.there, stream.linked))
    before = np.maximum(np.arange(n) - 1, 0) if stream.before is None else np.asarray(stream.before)[:n]
    new = np.random.default_rng([seed, 7, stream.channel]).standard_normal((n, len(values)))
    memory = values[:, stream.correlation] if stream.correlation >= 0 else np.zeros(len(values))
    noise = np.zeros((n, len(values)))
    for i in range(n):
        noise[i] = memory * noise[before[i]] + np.sqrt(1 - memory**2) * new[i] if linked[i] else new[i]
    sd = np.sqrt(values[:, stream.sd, None] ** 2 + np.asarray(stream.carried)[:n] ** 2)
    return np.where(there, prediction[:, :n] + noise.T * sd, np.nan)


def by_block(
    density: Density, u: np.ndarray, cases: tuple[CaseFit, ...]
) -> list[tuple[list[str], np.ndarray]]:
    """For each case the names of its blocks and the log-likelihood of each at draws, (draws, blocks).

    A sample counts given the one before it, so that the blocks of a draw add up to its log-likelihood.

    Args:
        u: (draws, p) plain coordinates of the numbers.
    """
    labels = []
    for one, streams in zip(cases, density.streams, strict=True):
        there = np.any([np.asarray(s.there)[: one.case.recording.n] > 0 for s in streams], axis=0)
        block = np.where(np.array(one.block) == "", BETWEEN, np.array(one.block))
        names = list(dict.fromkeys(block[there].tolist()))
        label = np.full(streams[0].there.size, len(names))
        label[: len(block)] = [names.index(b) if b in names else len(names) for b in block]
        labels.append((names, jnp.asarray(label)))
    parts = [_sums(density, jnp.asarray(batch), [at for _, at in labels]) for batch in _batches(u)]
    return [
        (names, np.concatenate([np.asarray(p[k]) for p in parts])[: len(u), : len(names)])
        for k, (names, _) in enumerate(labels)
    ]


def prior_draws(density: Density, count: int, seed: int) -> np.ndarray:
    """(count, p) draws of what was believed, SI: Gaussians cut off at the limits, or anywhere between."""
    at = density.at
    random = np.random.default_rng([seed, 11])
    share = random.uniform(size=(count, at.size))
    low, high, mean, sd = (np.asarray(a) for a in (at.low, at.high, at.mean, at.sd))
    known = np.isfinite(sd)
    safe = np.where(known, sd, 1.0)
    below, above = (ndtr((end - mean) / safe) for end in (low, high))
    gaussian = mean + safe * ndtri(below + share * (above - below))
    anywhere = np.where(
        at.log, np.abs(low) ** (1 - share) * np.abs(high) ** share, low + share * (high - low)
    )
    return np.where(known, np.clip(gaussian, low, high), anywhere)


def _batches(draws: np.ndarray):
    """Draws in batches of one size, the last filled up with its own first."""
    for first in range(0, len(draws), BATCH):
        batch = draws[first : first + BATCH]
        yield np.concatenate([batch, np.repeat(batch[:1], BATCH - len(batch), axis=0)])


@eqx.filter_jit
def _read(density: Density, k: int, values: Float[Array, "w p"]) -> Float[Array, "w 2 n"]:
    def one(v):
        reading = density.members[k].reading(v)
        return jnp.stack([reading.force, reading.diameter])

    return jax.vmap(one)(values)


@eqx.filter_jit
def _sums(density: Density, u: Float[Array, "w p"], labels: list[Array]) -> list[Array]:
    def one(v):
        pairs = zip(density.samples(v), labels, strict=True)
        # One place more than rows takes what belongs to no block.
        return [jax.ops.segment_sum(sum(parts), label, label.size + 1) for parts, label in pairs]

    return jax.vmap(one)(u)
