"""Base class of samplers, and the loop that runs one until it converges."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from pamjax.infer.posterior.checkpoint import Arrays, Checkpoint
from pamjax.infer.posterior.convergence import (
    MIN_CHAIN_AUTOCORRELATION_TIMES,
    ConvergenceDiagnostics,
    compute_convergence,
    discard_burn_in,
)
from pamjax.infer.posterior.laplace import GaussianApproximation
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.progress import Progress

#: Draws of one chunk; a chunk is saved as one file.
_DRAWS_PER_CHUNK = 50
#: Growth of the chain between two checks of convergence.
_CHECK_GROWTH_FACTOR = 1.2


@dataclass(frozen=True)
class Sampler(ABC):
    """A sampler in the coordinates of a Gaussian approximation; its state is a dict of arrays.

    Attributes:
        density: the posterior density.
        gaussian: the Gaussian approximation that defines the coordinates.
        chunk: draws of one `advance`.
        needs_long_chain: whether a chain must have a minimum length in autocorrelation times.
    """

    density: PosteriorDensity
    gaussian: GaussianApproximation
    chunk: int = _DRAWS_PER_CHUNK
    needs_long_chain: ClassVar[bool]

    @abstractmethod
    def draw_start(self, seed: int) -> Arrays:
        """Return the initial state."""

    @abstractmethod
    def advance(self, state: Arrays) -> tuple[Arrays, Arrays]:
        """Return `chunk` draws, "x" (n, chains, p), "logp" and others (n, chains), and the new state."""


def run_sampler(
    sampler: Sampler,
    checkpoint: Checkpoint,
    state: Arrays,
    targets: tuple[float, float, int],
    progress: Progress,
) -> tuple[list[Arrays], ConvergenceDiagnostics]:
    """Return all chunks of draws, after continuing a saved chain until it converges or is too long.

    Args:
        sampler: the sampler.
        checkpoint: the folder of the chain.
        state: initial state, if no draws are saved.
        targets: smallest effective sample size, largest split-R̂, and maximum draws of a chain.
        progress: called with the current step and the completed fraction.

    Returns:
        the chunks of draws, and their convergence diagnostics.
    """
    ess, rhat, max_draws = targets
    draws, saved_state = checkpoint.read_draws()
    state = saved_state or state
    while True:
        if len(draws) in _schedule_checks(max_draws) or len(draws) * sampler.chunk >= max_draws:
            # Convergence is checked in the unbounded coordinates u.
            convergence = compute_convergence(
                np.asarray(sampler.gaussian(jnp.asarray(discard_burn_in(concatenate_chunks(draws, "x")))))
            )
            if (
                convergence.is_converged(ess, rhat, sampler.needs_long_chain)
                or len(draws) * sampler.chunk >= max_draws
            ):
                return draws, convergence
            fraction = min(
                convergence.ess.min() / ess,
                convergence.chain_length
                / (MIN_CHAIN_AUTOCORRELATION_TIMES * convergence.autocorrelation_time.max())
                if sampler.needs_long_chain
                else 1.0,
            )
            progress(
                f"effective sample size {convergence.ess.min():.0f} of {ess:.0f}",
                0.3 + 0.7 * min(fraction, 1.0),
            )
        chunk, state = sampler.advance(state)
        checkpoint.save_chunk(len(draws), chunk, state)
        draws.append(chunk)


@functools.cache
def _schedule_checks(max_draws: int) -> frozenset[int]:
    """Return the chunk counts at which convergence is checked; a resumed run has the same schedule."""
    checks = [2]
    while checks[-1] < max_draws:
        checks.append(max(checks[-1] + 1, int(_CHECK_GROWTH_FACTOR * checks[-1])))
    return frozenset(checks)


def concatenate_chunks(draws: list[Arrays], name: str) -> np.ndarray:
    """Return one array of all chunks, (n, ...)."""
    return np.concatenate([chunk[name] for chunk in draws])
