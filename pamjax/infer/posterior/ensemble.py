"""Ensemble sampler (emcee) with proposals from the posterior's Gaussian approximation.

Half of the moves are independent proposals: a Student t distribution at the Gaussian approximation. Half are
differential-evolution moves along the difference of two walkers. The first mix fast in a nearly Gaussian
posterior; the second still move in a curved one. One compiled call evaluates all walkers.

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

#: Independent proposals: degrees of freedom of the t distribution, and its scale in sds of the Gaussian.
_PROPOSAL_DEGREES_OF_FREEDOM, _PROPOSAL_WIDTH = 5.0, 1.1
#: Fraction of independent proposals.
_INDEPENDENT_MOVE_SHARE = 0.5


@dataclass(frozen=True)
class EnsembleSampler(Sampler):
    """Ensemble sampler. Its state has positions, log-densities and the random generator."""

    needs_long_chain: ClassVar[bool] = True

    @property
    def walkers(self) -> int:
        return max(32, 4 * (self.density.space.size // 2 + 1))

    def draw_start(self, seed: int) -> Arrays:
        """Return walkers drawn from the Gaussian approximation."""
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
        """Return `chunk` draws (n, chains, p) with "logp" and "accepted" (n, chains), and the new state."""
        walkers, size = state["x"].shape
        moves: Any = [
            (_IndependentMove(), _INDEPENDENT_MOVE_SHARE),
            (emcee.moves.DEMove(), 1 - _INDEPENDENT_MOVE_SHARE),
        ]
        sampler = emcee.EnsembleSampler(walkers, size, self._compute_log_density, moves=moves, vectorize=True)
        start = emcee.State(state["x"], log_prob=state["logp"], random_state=_unpack_state(state))
        end: Any = sampler.run_mcmc(start, self.chunk, skip_initial_state_check=True)
        x, logp = np.asarray(sampler.get_chain()), np.asarray(sampler.get_log_prob())
        is_accepted = np.any(np.diff(np.concatenate([state["x"][None], x]), axis=0) != 0, axis=2)
        draws = {"x": x, "logp": logp, "accepted": is_accepted}
        return draws, {"x": end.coords, "logp": end.log_prob, **_pack_state(end.random_state)}

    def _compute_log_density(self, x: np.ndarray) -> np.ndarray:
        # A move evaluates half an ensemble: all calls have this shape and need one compilation.
        half = self.walkers // 2
        parts = [self.gaussian(jnp.asarray(x[k : k + half])) for k in range(0, len(x), half)]
        return np.concatenate([np.asarray(compute_log_densities(self.density, part)) for part in parts])


class _IndependentMove(emcee.moves.RedBlueMove):
    """Independent proposals from a t distribution."""

    def get_proposal(self, s: np.ndarray, c: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        scale = np.sqrt(
            _PROPOSAL_DEGREES_OF_FREEDOM / random.chisquare(_PROPOSAL_DEGREES_OF_FREEDOM, size=len(s))
        )[:, None]
        new = _PROPOSAL_WIDTH * scale * random.standard_normal(s.shape)
        return new, _compute_log_proposal(s) - _compute_log_proposal(new)


def _compute_log_proposal(x: np.ndarray) -> np.ndarray:
    return (
        -0.5
        * (_PROPOSAL_DEGREES_OF_FREEDOM + x.shape[1])
        * np.log1p(np.sum(x**2, axis=1) / (_PROPOSAL_DEGREES_OF_FREEDOM * _PROPOSAL_WIDTH**2))
    )


def _pack_state(state: Any) -> dict[str, np.ndarray]:
    _, keys, *scalars = state
    return {"random_keys": np.asarray(keys), "random_rest": np.array(scalars, dtype=float)}


def _unpack_state(state: dict[str, np.ndarray]) -> tuple:
    position, has_gauss, cached = state["random_rest"]
    return ("MT19937", state["random_keys"], int(position), int(has_gauss), float(cached))
