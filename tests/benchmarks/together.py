"""Many walks at once: each in a thread of its own, the densities of all in one compiled call.

A call for sixteen points of a short recording spends most of its time on getting there.
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
    """Answers all walks together, once every one that sits at it has asked.

    Args:
        density: of any recording; the others differ in what was measured, and in their powers.
        seats: walks at once.
        points: points of one question.
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
        """Sit at place k with a recording's density."""
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
        """The log-density at (points, p) of the one who sits at place k."""
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
    """What tells the density of one recording from another's, (2, n) and powers."""
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
    """The ensemble that `pamjax sample` walks with, at a desk; its draws are thinned anyway."""

    desk: Desk = dataclasses.field(kw_only=True)
    place: int = dataclasses.field(kw_only=True)
    long: ClassVar[bool] = False

    def _log_density(self, x: np.ndarray) -> np.ndarray:
        u = np.asarray(self.gaussian.centre) + x @ np.asarray(self.gaussian.covariance_root).T
        half = self.walkers // 2
        return np.concatenate([self.desk.ask(self.place, u[k : k + half]) for k in range(0, len(x), half)])
