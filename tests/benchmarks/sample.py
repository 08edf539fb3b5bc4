"""Effective samples per second: pamjax's two samplers, emcee with a NumPy likelihood, and NUTS of numpyro.

    python -m tests.benchmarks.sample [--json FILE]

The recording has the protocol of the paper and toe threads. Parameters: B0, N, E, three of the toe, and sd
and lag-one correlation of force and diameter. All samplers draw from the same posterior. The times are
processor times after compilation, with warm-up and burn-in. numpyro is not a dependency
(`pip install numpyro`); its model is implemented separately and samples the parameters without
transformation (`by_numpyro.py`).
"""

import os
import time
from collections.abc import Callable

import emcee
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.convergence import compute_convergence, discard_burn_in
from pamjax.infer.posterior.laplace import GaussianApproximation, fit_laplace
from pamjax.infer.posterior.log_density import PosteriorDensity, build_density, compute_log_densities
from pamjax.infer.posterior.sample import sample
from pamjax.records.protocol import PAPER_PROTOCOL
from pamjax.records.reading.muscle_toml import Sensors
from tests.benchmarks.fit import Twin
from tests.benchmarks.keep import arguments, keep
from tests.benchmarks.predecessors import list_predecessors
from tests.infer.made import made

#: Two sensors: the noise agrees with the likelihood.
BENCH = Sensors(force=2.0, diameter=0.05e-3)
#: Walkers and steps of emcee on NumPy; numpyro's warm-up and draws.
WALKERS, STEPS, WARMUP, DRAWS = 32, 3000, 500, 300


class ByNumpy:
    """The log-density in NumPy, without JAX, for one point at a time."""

    def __init__(self, density: PosteriorDensity) -> None:
        (dataset,), self.likelihoods, self.at = density.datasets, density.likelihoods[0], density.space
        self.twin = Twin("toe", dataset, density.space)
        self.n = self.twin.pressure.size
        pairs = [list_predecessors(s, self.n) for s in self.likelihoods]
        self.has_predecessor, self.before = zip(*pairs, strict=True)
        self.there = [np.asarray(s.measured)[: self.n] for s in self.likelihoods]
        self.twin.weights = tuple(self.there)

    def __call__(self, u: np.ndarray) -> float:
        values, n = self.twin.values(u), self.n
        everything = self.twin(u)
        total = self._prior(u, values)
        for k, s in enumerate(self.likelihoods):
            standard = everything[k * n : (k + 1) * n] / values[s.sd_index]
            memory = values[s.correlation_index] * self.has_predecessor[k]
            left = 1 - memory**2
            innovation = (standard - memory * standard[self.before[k]]) / np.sqrt(left)
            log_sd = np.log(values[s.sd_index]) + 0.5 * np.log(left)
            total -= np.sum(self.there[k] * (0.5 * innovation**2 + log_sd + 0.5 * np.log(2 * np.pi)))
        return total if np.isfinite(total) else -np.inf

    def _prior(self, u: np.ndarray, values: np.ndarray) -> float:
        t = self.twin
        z = t.origin + u * t.width
        log_share = -np.logaddexp(0, -z) - np.logaddexp(0, z) + np.log(t.width)
        reach = np.where(t.log, np.log(t.high / np.where(t.log, t.low, 1.0)), t.high - t.low)
        slope = np.log(np.where(t.log, values, 1.0) * reach) + log_share
        known = np.isfinite(t.sd)
        sd = np.where(known, t.sd, 1.0)
        gaussian = -0.5 * ((values - t.mean) / sd) ** 2 - np.log(sd) - 0.5 * np.log(2 * np.pi) + slope
        return float(np.sum(np.where(known, gaussian, log_share)))


def timed(call: Callable[[], np.ndarray]) -> tuple[float, float, float]:
    """Return least effective sample size of draws (n, chains, p), processor time, s, and worst split-R̂."""
    begin = time.process_time()
    draws = call()
    busy = time.process_time() - begin
    convergence = compute_convergence(draws)
    return float(convergence.ess.min()), busy, float(convergence.rhat.max())


def by_numpy(density: PosteriorDensity, ball: GaussianApproximation) -> np.ndarray:
    """Return draws of emcee with its defaults: stretch moves, one point at a time, same initial Gaussian."""
    np.random.seed(0)  # noqa: NPY002 - emcee takes its first state from here
    start = np.asarray(ball(jax.random.normal(jax.random.key(0), (WALKERS, density.space.size))))
    walk = emcee.EnsembleSampler(WALKERS, density.space.size, ByNumpy(density))
    walk.run_mcmc(start, STEPS)
    return discard_burn_in(np.asarray(walk.get_chain()))


def near(ball: GaussianApproximation) -> np.ndarray:
    """Return a few points near the mode of the posterior."""
    return np.asarray(ball(jax.random.normal(jax.random.key(3), (3, ball.centre.size))))


def problem() -> tuple[Fit, PosteriorDensity, GaussianApproximation]:
    result = fit(
        made("toe", plan=PAPER_PROTOCOL, seed=1, bench=BENCH, sensors=BENCH, lag_one=0.5),
        "toe",
        starts=1,
        fold_count=2,
    )
    density, start = build_density(result)
    return result, density, fit_laplace(density, start)


def main() -> None:
    _, file = arguments()
    console = Console()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    console.print(f"{os.cpu_count()} cores, load {load:.1f} before this began")
    result, density, ball = problem()
    point = np.asarray(ball.centre)
    off = ByNumpy(density)(point) - float(compute_log_densities(density, jnp.asarray(point)[None])[0])
    console.print(
        f"{int(density.datasets[0].rows.training_mask.sum())} rows; NumPy's log-density is off by {off:.1e}"
    )
    rivals: dict[str, Callable[[], np.ndarray]] = {
        "pamjax, emcee": lambda: sample(result, seed=2).draws,
        "pamjax, nuts": lambda: sample(result, sampler="nuts", seed=2).draws,
        "emcee on NumPy": lambda: by_numpy(density, ball),
    }
    try:
        from tests.benchmarks.by_numpyro import ByNumpyro

        by_hand = ByNumpyro(density)
        console.print(f"numpyro's log-density is off by {by_hand.off(density, near(ball)):.1e}")
        rivals["numpyro, by hand"] = by_hand.walk(point, WARMUP, DRAWS)
    except ImportError:
        console.print("numpyro is not installed, so it is left out")
    table = Table("sampler", "effective samples", "processor", "a second", "against emcee on NumPy", "R̂")
    rates, figures = {}, {}
    for name, call in rivals.items():
        if name != "emcee on NumPy":
            call()
        ess, busy, rhat = timed(call)
        rates[name] = (ess / busy, ess, busy, rhat)
    for name, (rate, ess, busy, rhat) in rates.items():
        times = f"{rate / rates['emcee on NumPy'][0]:.1f}"
        table.add_row(name, f"{ess:.0f}", f"{busy:.1f} s", f"{rate:.1f}", times, f"{rhat:.3f}")
        figures |= {
            f"{name}, least effective samples": ess,
            f"{name}, processor [s]": busy,
            f"{name}, effective samples a second": rate,
            f"{name}, against emcee on NumPy": rate / rates["emcee on NumPy"][0],
            f"{name}, largest R-hat": rhat,
        }
    console.print(table)
    keep(file, figures)


if __name__ == "__main__":
    main()
