"""The posterior of the speed benchmark in numpyro, without pamjax.

The model has parameters with priors, toe threads with Newton's method, and AR(1) noise. NUTS adapts its step
size and its diagonal mass matrix. numpyro is not a dependency: `pip install numpyro`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro  # pyright: ignore[reportMissingImports]
import numpyro.distributions as dist  # pyright: ignore[reportMissingImports]
from numpyro.infer import MCMC, NUTS, init_to_value  # pyright: ignore[reportMissingImports]
from numpyro.infer.util import log_density  # pyright: ignore[reportMissingImports]

from pamjax.infer.posterior.log_density import PosteriorDensity
from tests.benchmarks.predecessors import list_predecessors
from tests.infer.made import TRUE

#: Newton steps of the toe law, as in the NumPy version.
STEPS = 12


class ByNumpyro:
    """The model of one recording with toe threads, and its sampler.

    Args:
        density: source of data and priors; its code is not used.
    """

    def __init__(self, density: PosteriorDensity) -> None:
        (dataset,), (streams,) = density.datasets, density.likelihoods
        n = int(dataset.rows.training_mask.sum())
        self.at = density.space
        self.pressure, self.length = (a[:n] for a in (dataset.rows.pressure, dataset.rows.length))
        self.measured = {"force": dataset.rows.force[:n], "diameter": dataset.rows.diameter[:n]}
        self.there = {c: s.measured[:n] > 0 for c, s in zip(self.measured, streams, strict=True)}
        pairs = {c: list_predecessors(s, n) for c, s in zip(self.measured, streams, strict=True)}
        self.has_predecessor = {c: has_predecessor for c, (has_predecessor, _) in pairs.items()}
        self.before = {c: predecessor for c, (_, predecessor) in pairs.items()}

    def priors(self) -> dict[str, Any]:
        """Return a distribution for every parameter, SI."""
        at = self.at
        columns = (np.asarray(a).tolist() for a in (at.low, at.high, at.mean, at.sd, at.log_scale))
        return {name: _prior(*numbers) for name, *numbers in zip(at.names, *columns, strict=True)}

    def shown(self, now: Mapping[str, Any]) -> dict[str, jax.Array]:
        """Return force, N, and diameter, m, of every row."""
        stiffness = now["thread.modulus"] * now["muscle.threads"] * now["muscle.thread_area"]
        rest, turns = now["muscle.thread_length"], now["muscle.turns"]
        ratio, crimp, width = now["thread.toe_ratio"], now["thread.crimp"], now["thread.width"]
        pull = self.pressure * self.length * rest / (2 * jnp.pi * turns**2) / stiffness
        begin, strain = jnp.hypot(crimp, width), pull / (1 - pull) + crimp
        for _ in range(STEPS):
            root = jnp.hypot(strain - crimp, width)
            load = ratio * strain + (1 - ratio) * 0.5 * (strain + root - begin)
            slope = ratio + (1 - ratio) * 0.5 * (1 + (strain - crimp) / root)
            strain = strain - (load - pull * (1 + strain)) / (slope - pull)
        thread = rest * (1 + strain)
        force = self.pressure * (3 * self.length**2 - thread**2) / (4 * jnp.pi * turns**2)
        return {"force": force, "diameter": jnp.sqrt(thread**2 - self.length**2) / (jnp.pi * turns)}

    def __call__(self) -> None:
        now = TRUE | {name: numpyro.sample(name, prior) for name, prior in self.priors().items()}
        for channel, smooth in self.shown(now).items():
            measured, sd = self.measured[channel], now[f"noise.{channel}"]
            memory = now[f"noise.{channel}_correlation"] * self.has_predecessor[channel]
            mean = smooth + memory * (measured - smooth)[self.before[channel]]
            noise = dist.Normal(mean, sd * jnp.sqrt(1 - memory**2))
            numpyro.sample(channel, noise.mask(self.there[channel]), obs=measured)

    def off(self, density: PosteriorDensity, u: np.ndarray) -> float:
        """Return the largest difference from pamjax's log-density at points u, (n, p), up to a constant."""
        gaps = []
        for point in map(jnp.asarray, u):
            slope = jax.jvp(self.at.to_values, (point,), (jnp.ones_like(point),))[1]
            mine = log_density(self, (), {}, self.at.to_named_values(point))[0] + jnp.sum(jnp.log(slope))
            gaps.append(float(mine - density(point)))
        return float(np.ptp(gaps))

    def walk(self, start: np.ndarray, warmup: int, draws: int, seed: int = 1) -> Callable[[], np.ndarray]:
        """Return a compiled sampler for (draws, 1, p) parameter values, SI, after warm-up."""
        kernel = NUTS(self, init_strategy=init_to_value(values=self.at.to_named_values(jnp.asarray(start))))
        walk = MCMC(kernel, num_warmup=warmup, num_samples=draws, progress_bar=False)

        def call() -> np.ndarray:
            walk.run(jax.random.key(seed))
            samples = walk.get_samples()
            return np.stack([np.asarray(samples[name]) for name in self.at.names], axis=1)[:, None]

        return call


def _prior(low: float, high: float, mean: float, sd: float, log: bool) -> Any:
    if np.isfinite(sd):
        return dist.TruncatedNormal(mean, sd, low=low, high=high)
    return dist.LogUniform(low, high) if log else dist.Uniform(low, high)
