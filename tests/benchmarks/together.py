"""Many parallel chains: one thread for each, with all log-densities in one compiled call.

For a short recording, most of the time of a call for sixteen points is overhead.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.infer.posterior.ensemble import EnsembleSampler
from pamjax.infer.posterior.log_density import PosteriorDensity


class Desk:
    """Evaluates the log-densities of all chains together, once every chain has requested one.

    Args:
        density: log-density of any recording; the others differ in measurements and misfit weights.
        seats: number of chains.
        points: number of points of one request.
    """

    def __init__(self, density: PosteriorDensity, seats: int, points: int) -> None:
        self.density = density
        self.told = [measured(density)] * seats
        self.u = np.zeros((seats, points, density.space.size))
        self.found = np.zeros((seats, points))
        self.sitting = self.asked = self.round = 0
        self.turn = threading.Condition()

    @contextmanager
    def seat(self, k: int, density: PosteriorDensity) -> Iterator[None]:
        """Register the log-density of a recording at seat k."""
        with self.turn:
            self.told[k] = measured(density)
            self.sitting += 1
        try:
            yield
        finally:
            with self.turn:
                self.sitting -= 1
                self._answer_if_all()

    def ask(self, k: int, u: np.ndarray) -> np.ndarray:
        """Return the log-density at points, (points, p), for the chain at seat k."""
        with self.turn:
            self.u[k] = u
            self.asked += 1
            mine = self.round
            self._answer_if_all()
            self.turn.wait_for(lambda: self.round != mine)
            return self.found[k].copy()

    def _answer_if_all(self) -> None:
        if self.asked and self.asked >= self.sitting:
            try:
                told = jax.tree.map(lambda *a: jnp.stack(a), *self.told)
                self.found = np.asarray(_all(self.density, told, jnp.asarray(self.u)))
            finally:
                self.asked, self.round = 0, self.round + 1
                self.turn.notify_all()


def measured(density: PosteriorDensity):
    """Return the measurements, (2, n), and misfit weights, which differ between the recordings."""
    (one,), (powers,) = density.datasets, density.powers
    return jnp.stack([one.rows.force, one.rows.diameter]), jnp.stack(powers)


@eqx.filter_jit
def _all(density: PosteriorDensity, told, u: Float[Array, "k w p"]) -> Float[Array, "k w"]:
    def one(told, u):
        (force, diameter), powers = told
        here = eqx.tree_at(
            lambda d: (d.datasets[0].rows.force, d.datasets[0].rows.diameter, d.powers),
            density,
            (force, diameter, (tuple(powers),)),
        )
        return jax.vmap(here)(u)

    return jax.vmap(one)(told, u)


@dataclass(frozen=True)
class Seated(EnsembleSampler):
    """The ensemble sampler of `pamjax sample`, evaluated at a desk."""

    desk: Desk = dataclasses.field(kw_only=True)
    place: int = dataclasses.field(kw_only=True)
    long: ClassVar[bool] = False

    def _log_density(self, x: np.ndarray) -> np.ndarray:
        u = np.asarray(self.gaussian.centre) + x @ np.asarray(self.gaussian.covariance_root).T
        half = self.walkers // 2
        return np.concatenate([self.desk.ask(self.place, u[k : k + half]) for k in range(0, len(x), half)])
