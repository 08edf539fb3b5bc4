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
from pamjax.infer.posterior.log_density import log_densities
from pamjax.infer.posterior.sampler import Walk

#: Wide tails of the drawn-anew moves: degrees of freedom, and sds of the Gaussian.
TAILS, WIDER = 5.0, 1.1
#: Share of the moves that draw anew.
ANEW = 0.5


@dataclass(frozen=True)
class Ensemble(Walk):
    """Walkers whose state is positions, their log-density and random numbers."""

    long: ClassVar[bool] = True

    @property
    def walkers(self) -> int:
        return max(32, 4 * (self.density.at.size // 2 + 1))

    def begin(self, seed: int) -> Arrays:
        """Walkers drawn from the ball."""
        random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence([seed, 5])))
        x = random.standard_normal((self.walkers, self.density.at.size))
        for _ in range(50):
            logp = self._log_density(x)
            lost = ~(logp > np.max(logp) - 50 - 5 * x.shape[1])
            if not lost.any():
                break
            x[lost] *= 0.7
        return {"x": x, "logp": self._log_density(x), **_packed(random.get_state())}

    def advance(self, state: Arrays) -> tuple[Arrays, Arrays]:
        """`chunk` steps on: draws (n, chains, p), "logp" and "accepted" (n, chains); and the new state."""
        walkers, size = state["x"].shape
        moves: Any = [(_Anew(), ANEW), (emcee.moves.DEMove(), 1 - ANEW)]
        sampler = emcee.EnsembleSampler(walkers, size, self._log_density, moves=moves, vectorize=True)
        start = emcee.State(state["x"], log_prob=state["logp"], random_state=_unpacked(state))
        end: Any = sampler.run_mcmc(start, self.chunk, skip_initial_state_check=True)
        x, logp = np.asarray(sampler.get_chain()), np.asarray(sampler.get_log_prob())
        moved = np.any(np.diff(np.concatenate([state["x"][None], x]), axis=0) != 0, axis=2)
        draws = {"x": x, "logp": logp, "accepted": moved}
        return draws, {"x": end.coords, "logp": end.log_prob, **_packed(end.random_state)}

    def _log_density(self, x: np.ndarray) -> np.ndarray:
        # One compiled shape for all: half an ensemble, which is what a move looks at.
        half = self.walkers // 2
        parts = [self.ball(jnp.asarray(x[k : k + half])) for k in range(0, len(x), half)]
        return np.concatenate([np.asarray(log_densities(self.density, part)) for part in parts])


class _Anew(emcee.moves.RedBlueMove):
    """Draw walkers from the ball with wide tails."""

    def get_proposal(self, s: np.ndarray, c: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        scale = np.sqrt(TAILS / random.chisquare(TAILS, size=len(s)))[:, None]
        new = WIDER * scale * random.standard_normal(s.shape)
        return new, _log_tails(s) - _log_tails(new)


def _log_tails(x: np.ndarray) -> np.ndarray:
    return -0.5 * (TAILS + x.shape[1]) * np.log1p(np.sum(x**2, axis=1) / (TAILS * WIDER**2))


def _packed(state: Any) -> dict[str, np.ndarray]:
    _, keys, *rest = state
    return {"random_keys": np.asarray(keys), "random_rest": np.array(rest, dtype=float)}


def _unpacked(state: dict[str, np.ndarray]) -> tuple:
    position, has_gauss, cached = state["random_rest"]
    return ("MT19937", state["random_keys"], int(position), int(has_gauss), float(cached))
