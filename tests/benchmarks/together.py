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


class JointEvaluator:
    """Evaluates the log-densities of all chains together, once every chain has requested one.

    Args:
        density: log-density of any recording; the others differ in measurements and misfit weights.
        chain_count: number of chains.
        points: number of points of one request.
    """

    def __init__(self, density: PosteriorDensity, chain_count: int, points: int) -> None:
        self.density = density
        self.measurements = [stack_measurements(density)] * chain_count
        self.u = np.zeros((chain_count, points, density.space.size))
        self.log_densities = np.zeros((chain_count, points))
        self.active_chains = self.request_count = self.batch_number = 0
        self.condition = threading.Condition()

    @contextmanager
    def register(self, k: int, density: PosteriorDensity) -> Iterator[None]:
        """Register the log-density of the recording of chain k."""
        with self.condition:
            self.measurements[k] = stack_measurements(density)
            self.active_chains += 1
        try:
            yield
        finally:
            with self.condition:
                self.active_chains -= 1
                self._evaluate_if_complete()

    def evaluate(self, k: int, u: np.ndarray) -> np.ndarray:
        """Return the log-density at points, (points, p), of chain k."""
        with self.condition:
            self.u[k] = u
            self.request_count += 1
            own_batch = self.batch_number
            self._evaluate_if_complete()
            self.condition.wait_for(lambda: self.batch_number != own_batch)
            return self.log_densities[k].copy()

    def _evaluate_if_complete(self) -> None:
        if self.request_count and self.request_count >= self.active_chains:
            try:
                measurements = jax.tree.map(lambda *a: jnp.stack(a), *self.measurements)
                self.log_densities = np.asarray(
                    _evaluate_all(self.density, measurements, jnp.asarray(self.u))
                )
            finally:
                self.request_count, self.batch_number = 0, self.batch_number + 1
                self.condition.notify_all()


def stack_measurements(density: PosteriorDensity):
    """Return the measurements, (2, n), and misfit weights, which differ between the recordings."""
    (dataset,), (powers,) = density.datasets, density.powers
    return jnp.stack([dataset.rows.force, dataset.rows.diameter]), jnp.stack(powers)


@eqx.filter_jit
def _evaluate_all(density: PosteriorDensity, measurements, u: Float[Array, "k w p"]) -> Float[Array, "k w"]:
    def evaluate(measurements, u):
        (force, diameter), powers = measurements
        log_density = eqx.tree_at(
            lambda d: (d.datasets[0].rows.force, d.datasets[0].rows.diameter, d.powers),
            density,
            (force, diameter, (tuple(powers),)),
        )
        return jax.vmap(log_density)(u)

    return jax.vmap(evaluate)(measurements, u)


@dataclass(frozen=True)
class JointSampler(EnsembleSampler):
    """The ensemble sampler of `pamjax sample`, with a joint evaluation of all chains."""

    evaluator: JointEvaluator = dataclasses.field(kw_only=True)
    chain_index: int = dataclasses.field(kw_only=True)
    long: ClassVar[bool] = False

    def _log_density(self, x: np.ndarray) -> np.ndarray:
        u = np.asarray(self.gaussian.centre) + x @ np.asarray(self.gaussian.covariance_root).T
        half = self.walkers // 2
        return np.concatenate(
            [self.evaluator.evaluate(self.chain_index, u[k : k + half]) for k in range(0, len(x), half)]
        )
