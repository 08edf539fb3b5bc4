"""A walk on a posterior: what every sampler is, and walking on until the chain is good enough."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from pamjax.infer.posterior.checkpoint import Arrays, Checkpoint
from pamjax.infer.posterior.convergence import TRUSTED, Health, health, kept
from pamjax.infer.posterior.laplace import Ball
from pamjax.infer.posterior.log_density import Density
from pamjax.progress import Progress

#: Draws between two looks at the chain; saved together.
CHUNK = 50
#: The chain is looked at when it has grown by this factor.
GROWN = 1.2


@dataclass(frozen=True)
class Walk(ABC):
    """A sampler in the coordinates of a ball; its state is arrays that can be saved and resumed.

    Attributes:
        density: where it walks.
        ball: the coordinates.
        chunk: draws of one `advance`.
        long: whether emcee's advice on autocorrelation times is to be heeded.
    """

    density: Density
    ball: Ball
    chunk: int = CHUNK
    long: ClassVar[bool]

    @abstractmethod
    def begin(self, seed: int) -> Arrays:
        """The first state."""

    @abstractmethod
    def advance(self, state: Arrays) -> tuple[Arrays, Arrays]:
        """`chunk` draws on: "x" (n, chains, p), "logp" and others (n, chains); and the new state."""


def walk_on(
    walk: Walk, store: Checkpoint, state: Arrays, wanted: tuple[float, float, int], progress: Progress
) -> tuple[list[Arrays], Health]:
    """Walk on from what is saved until the chain is good enough, or as long as allowed.

    Args:
        wanted: effective samples and split-R̂ of every number, and draws of a chain at most.
    """
    ess, rhat, longest = wanted
    draws, last = store.draws()
    state = last or state
    while True:
        if len(draws) in _looks(longest) or len(draws) * walk.chunk >= longest:
            # Looked at in the plain coordinates of the numbers.
            found = health(np.asarray(walk.ball(jnp.asarray(kept(together(draws, "x"))))))
            if found.good(ess, rhat, walk.long) or len(draws) * walk.chunk >= longest:
                return draws, found
            share = min(
                found.ess.min() / ess, found.draws / (TRUSTED * found.time.max()) if walk.long else 1.0
            )
            progress(f"ESS {found.ess.min():.0f} of {ess:.0f}", 0.3 + 0.7 * min(share, 1.0))
        new, state = walk.advance(state)
        store.save(len(draws), new, state)
        draws.append(new)


@functools.cache
def _looks(longest: int) -> frozenset[int]:
    """After how many chunks the chain is looked at: always the same, so that a resumed run ends alike."""
    looks = [2]
    while looks[-1] < longest:
        looks.append(max(looks[-1] + 1, int(GROWN * looks[-1])))
    return frozenset(looks)


def together(draws: list[Arrays], name: str) -> np.ndarray:
    """One array of all chunks."""
    return np.concatenate([chunk[name] for chunk in draws])
