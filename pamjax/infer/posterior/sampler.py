"""A walk on a posterior: what every sampler is, and walking on until the chain is good enough."""

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

#: Draws between two looks at the chain; saved together.
DRAWS_PER_CHUNK = 50
#: The chain is looked at when it has grown by this factor.
CHECK_GROWTH_FACTOR = 1.2


@dataclass(frozen=True)
class Sampler(ABC):
    """A sampler in the coordinates of a ball; its state is arrays that can be saved and resumed.

    Attributes:
        density: where it walks.
        gaussian: the coordinates.
        chunk: draws of one `advance`.
        needs_long_chain: whether emcee's advice on autocorrelation times is to be heeded.
    """

    density: PosteriorDensity
    gaussian: GaussianApproximation
    chunk: int = DRAWS_PER_CHUNK
    needs_long_chain: ClassVar[bool]

    @abstractmethod
    def draw_start(self, seed: int) -> Arrays:
        """The first state."""

    @abstractmethod
    def advance(self, state: Arrays) -> tuple[Arrays, Arrays]:
        """`chunk` draws on: "x" (n, chains, p), "logp" and others (n, chains); and the new state."""


def run_sampler(
    sampler: Sampler,
    checkpoint: Checkpoint,
    state: Arrays,
    targets: tuple[float, float, int],
    progress: Progress,
) -> tuple[list[Arrays], ConvergenceDiagnostics]:
    """Walk on from what is saved until the chain is good enough, or as long as allowed.

    Args:
        targets: effective samples and split-R̂ of every number, and draws of a chain at most.
    """
    ess, rhat, longest = targets
    draws, last = checkpoint.read_draws()
    state = last or state
    while True:
        if len(draws) in _schedule_checks(longest) or len(draws) * sampler.chunk >= longest:
            # Looked at in the plain coordinates of the numbers.
            convergence = compute_convergence(
                np.asarray(sampler.gaussian(jnp.asarray(discard_burn_in(concatenate_chunks(draws, "x")))))
            )
            if (
                convergence.is_converged(ess, rhat, sampler.needs_long_chain)
                or len(draws) * sampler.chunk >= longest
            ):
                return draws, convergence
            share = min(
                convergence.ess.min() / ess,
                convergence.chain_length
                / (MIN_CHAIN_AUTOCORRELATION_TIMES * convergence.autocorrelation_time.max())
                if sampler.needs_long_chain
                else 1.0,
            )
            progress(f"ESS {convergence.ess.min():.0f} of {ess:.0f}", 0.3 + 0.7 * min(share, 1.0))
        new, state = sampler.advance(state)
        checkpoint.save_chunk(len(draws), new, state)
        draws.append(new)


@functools.cache
def _schedule_checks(longest: int) -> frozenset[int]:
    """After how many chunks the chain is looked at: always the same, so that a resumed run ends alike."""
    checks = [2]
    while checks[-1] < longest:
        checks.append(max(checks[-1] + 1, int(CHECK_GROWTH_FACTOR * checks[-1])))
    return frozenset(checks)


def concatenate_chunks(draws: list[Arrays], name: str) -> np.ndarray:
    """One array of all chunks."""
    return np.concatenate([chunk[name] for chunk in draws])
