"""Simulation-based calibration: recordings with parameters from the prior, and their posteriors.

If the posterior is right, the rank of the true value among posterior draws is uniform over recordings.

Source: Talts, Betancourt, Simpson, Vehtari & Gelman, arXiv:1804.06788.
"""

import dataclasses
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter

from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.posterior.log_density import build_density
from pamjax.infer.posterior.predictive import sample_prior
from pamjax.records.reading.muscle_toml import Sensors
from tests.infer.made import made

#: Sensor noise only: the noise agrees with the likelihood.
BENCH = Sensors(force=2.0, diameter=0.05e-3)
#: Priors of the noise and of the toe; narrow, so that every recording is informative.
NOISE = {
    "noise.force": {"value": 2.0, "sd": 0.4},
    "noise.diameter": {"value": 0.05e-3, "sd": 0.01e-3},
    "noise.force_correlation": {"value": 0.5, "sd": 0.2},
    "noise.diameter_correlation": {"value": 0.5, "sd": 0.2},
}
TOE = {
    "thread.toe_ratio": {"value": 0.3, "sd": 0.08},
    "thread.crimp": {"value": 0.006, "sd": 0.001},
    "thread.width": {"value": 1e-3, "sd": 0.2e-3},
}


class Bench:
    """Simulated recordings of one protocol, with parameters from the prior."""

    def __init__(self, law: str, count: int, seed: int = 0) -> None:
        case = made(law, bench=BENCH, sensors=BENCH, seed=seed)
        self.fit = fit(case, law, starts=1, fold_count=2, seed=seed)
        self.density, _ = build_density(self.fit, NOISE | (TOE if law == "toe" else {}))
        self.true = sample_prior(self.density, count, seed)
        self.starts = case.recording.is_run_start
        self.seed = seed

    def recording(self, k: int):
        """Return the log-density of recording k (same settings, other measurements), and its optimum."""
        (dataset,), values = self.density.datasets, self.true[k]
        nothing = eqx.tree_at(
            lambda m: (m.rows.force, m.rows.diameter), dataset, (jnp.zeros_like(dataset.rows.force),) * 2
        )
        shown = [-np.asarray(channel) for channel in compute_residuals(nothing, jnp.asarray(values))]
        random = np.random.default_rng([self.seed, 3, k])
        for stream in self.density.likelihoods[0]:
            noise = self._noise(random, shown[stream.channel].size, values[stream.correlation_index])
            shown[stream.channel] += noise * values[stream.sd_index] * np.asarray(stream.measured)
        (member,) = self.fit.datasets
        end = solve_least_squares(
            (_replace_measurements(member, shown),), self.fit.space, jnp.zeros(self.fit.space.size)
        )
        density = dataclasses.replace(self.density, datasets=(_replace_measurements(dataset, shown),))
        at = density.space
        start = dict(zip(at.names, np.asarray(at.to_values(jnp.zeros(at.size))), strict=True))
        start |= dict(zip(self.fit.space.names, np.asarray(self.fit.space.to_values(end.u)), strict=True))
        return density, at.to_point(start)

    def _noise(self, random: np.random.Generator, size: int, memory: float) -> np.ndarray:
        """Return AR(1) noise of unit sd that starts anew in each run."""
        new = random.standard_normal(size)
        edges = [*np.flatnonzero(self.starts), size]
        edges[0] = 0
        runs = []
        for first, last in pairwise(edges):
            step = np.sqrt(1 - memory**2) * new[first:last]
            # The first sample has the stationary distribution, not that of an increment.
            step[0] = new[first]
            runs.append(lfilter([1.0], [1.0, -memory], step))
        return np.concatenate(runs)


def _replace_measurements(dataset, values):
    """Return the dataset with other measurements."""
    return eqx.tree_at(lambda m: (m.rows.force, m.rows.diameter), dataset, tuple(map(jnp.asarray, values)))


@eqx.filter_jit
def compute_residuals(dataset, values):
    return dataset.compute_standardised_residuals(values)


def treat_noise_as_white(density):
    """Return a wrong likelihood, which treats all samples as independent."""
    streams = tuple(dataclasses.replace(s, correlation_index=-1) for s in density.likelihoods[0])
    return dataclasses.replace(density, likelihoods=(streams,))
