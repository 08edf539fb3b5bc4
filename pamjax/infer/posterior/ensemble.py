"""An ensemble of walkers (emcee) that know where the posterior's Gaussian lies.

Half of the moves draw a walker anew from that Gaussian with wide tails, half step along the difference of
two others. Where the posterior is nearly Gaussian the first forgets within a few steps; where it is
bent, the second still walks. All walkers' densities are one compiled call.

Sources: emcee, Foreman-Mackey, Hogg, Lang & Goodman, PASP 125, 306 (2013); differences, ter Braak, Stat.
Comput. 16, 239 (2006).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import emcee
import jax.numpy as jnp
import numpy as np

from pamjax.infer.posterior.checkpoint import Arrays
from pamjax.infer.posterior.log_density import compute_log_densities
from pamjax.infer.posterior.sampler import Sampler

#: Wide tails of the drawn-anew moves: degrees of freedom, and sds of the Gaussian.
PROPOSAL_DEGREES_OF_FREEDOM, PROPOSAL_WIDTH = 5.0, 1.1
#: Share of the moves that draw anew.
INDEPENDENT_MOVE_SHARE = 0.5


@dataclass(frozen=True)
class EnsembleSampler(Sampler):
    """Walkers whose state is positions, their log-density and random numbers."""

    needs_long_chain: ClassVar[bool] = True

    @property
    def walkers(self) -> int:
        return max(32, 4 * (self.density.space.size // 2 + 1))

    def draw_start(self, seed: int) -> Arrays:
        """Walkers drawn from the ball."""
        random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence([seed, 5])))
        x = random.standard_normal((self.walkers, self.density.space.size))
        for _ in range(50):
            log_density = self._compute_log_density(x)
            is_outlying = ~(log_density > np.max(log_density) - 50 - 5 * x.shape[1])
            if not is_outlying.any():
                break
            x[is_outlying] *= 0.7
        return {"x": x, "logp": self._compute_log_density(x), **_pack_state(random.get_state())}

    def advance(self, state: Arrays) -> tuple[Arrays, Arrays]:
        """`chunk` steps on: draws (n, chains, p), "logp" and "accepted" (n, chains); and the new state."""
        walkers, size = state["x"].shape
        moves: Any = [
            (_IndependentMove(), INDEPENDENT_MOVE_SHARE),
            (emcee.moves.DEMove(), 1 - INDEPENDENT_MOVE_SHARE),
        ]
        sampler = emcee.EnsembleSampler(walkers, size, self._compute_log_density, moves=moves, vectorize=True)
        start = emcee.State(state["x"], log_prob=state["logp"], random_state=_unpack_state(state))
        end: Any = sampler.run_mcmc(start, self.chunk, skip_initial_state_check=True)
        x, logp = np.asarray(sampler.get_chain()), np.asarray(sampler.get_log_prob())
        moved = np.any(np.diff(np.concatenate([state["x"][None], x]), axis=0) != 0, axis=2)
        draws = {"x": x, "logp": logp, "accepted": moved}
        return draws, {"x": end.coords, "logp": end.log_prob, **_pack_state(end.random_state)}

    def _compute_log_density(self, x: np.ndarray) -> np.ndarray:
        # One compiled shape for all: half an ensemble, which is what a move looks at.
        half = self.walkers // 2
        parts = [self.gaussian(jnp.asarray(x[k : k + half])) for k in range(0, len(x), half)]
        return np.concatenate([np.asarray(compute_log_densities(self.density, part)) for part in parts])


class _IndependentMove(emcee.moves.RedBlueMove):
    """Draw walkers from the ball with wide tails."""

    def get_proposal(self, s: np.ndarray, c: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        scale = np.sqrt(
            PROPOSAL_DEGREES_OF_FREEDOM / random.chisquare(PROPOSAL_DEGREES_OF_FREEDOM, size=len(s))
        )[:, None]
        new = PROPOSAL_WIDTH * scale * random.standard_normal(s.shape)
        return new, _compute_log_proposal(s) - _compute_log_proposal(new)


def _compute_log_proposal(x: np.ndarray) -> np.ndarray:
    return (
        -0.5
        * (PROPOSAL_DEGREES_OF_FREEDOM + x.shape[1])
        * np.log1p(np.sum(x**2, axis=1) / (PROPOSAL_DEGREES_OF_FREEDOM * PROPOSAL_WIDTH**2))
    )


def _pack_state(state: Any) -> dict[str, np.ndarray]:
    _, keys, *rest = state
    return {"random_keys": np.asarray(keys), "random_rest": np.array(rest, dtype=float)}


def _unpack_state(state: dict[str, np.ndarray]) -> tuple:
    position, has_gauss, cached = state["random_rest"]
    return ("MT19937", state["random_keys"], int(position), int(has_gauss), float(cached))
