"""Noise of a channel as numbers of a posterior: its standard deviation and its lag-one correlation.

Sample i of a channel misses the model by e_i. With the channel's own sd σ and the noise c_i of pressure
and length carried through the model,

    s_i = e_i / sqrt(σ² + c_i²),      s_i | s_{i−1} ~ Normal(ρ s_{i−1}, 1 − ρ²)

along every continuous run of samples: noise with an exponential memory, of which white noise is ρ = 0.

What it leaves out: noise with two memories, such as a white sensor on top of a slow misfit. What of that
is left in the innovations is found by `estimate_innovation_autocorrelation` and widens the posterior (see
`log_density.py`).

Source: autoregression of order one, Box & Jenkins, Time Series Analysis (1970), ch. 3.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.channels import DISPLAY_UNIT, SI_UNIT
from pamjax.infer.fitting.reweight import compute_si_residuals
from pamjax.infer.noise.sensor_noise import compute_effective_sd, estimate_autocorrelation_time
from pamjax.infer.problem.dataset import CHANNELS, Dataset, estimate_starting_sd
from pamjax.infer.problem.parameter_space import FreeParameter
from pamjax.parameter import Meaning
from pamjax.records.case import Case

#: With fewer samples than this a channel's memory cannot be seen; as in `noise.inflation`.
MIN_LINKED_SAMPLES = 30
#: A sensor's sd is believed to lie within these factors of what was stated: a little better, or much worse.
STATED_SD_FACTORS = (0.5, 200.0)
#: ... and, where none was stated, of a hundredth of the channel's range.
UNSTATED_SD_FACTORS = (0.01, 100.0)
#: Limits of a lag-one correlation; white noise is no limit of it.
CORRELATION_LIMITS = (-0.5, 0.9995)


def find_noise_units(name: str) -> tuple[str, str]:
    """SI unit of a number of the noise, and the unit in which a person reads it."""
    channel = name.rpartition(".")[2]
    return (SI_UNIT[channel], DISPLAY_UNIT[channel]) if channel in SI_UNIT else ("1", "1")


class Ar1Likelihood(eqx.Module):
    """One channel of one member, its samples in the order of time.

    Attributes:
        channel: 0 for force, 1 for diameter.
        sd_index: where the channel's sd stands among the numbers.
        correlation_index: where its lag-one correlation stands, or -1 for none.
        measured: (n,) one where a sample counts.
        has_predecessor: (n,) one where a sample has a measured one before it in its run.
        predecessor: (n,) row of that sample; None where it is always the row before.
        propagated_sd: (n,) noise of pressure and length carried through the model, SI.
    """

    channel: int = eqx.field(static=True)
    sd_index: int = eqx.field(static=True)
    correlation_index: int = eqx.field(static=True)
    measured: Float[Array, " n"]
    has_predecessor: Float[Array, " n"]
    predecessor: Array | None
    propagated_sd: Float[Array, " n"]

    def standardise_innovations(
        self, misfit: Float[Array, " n"], values: Float[Array, " p"]
    ) -> tuple[Array, Array]:
        """Innovations in their own sd, and the logarithm of that sd, SI; (n,) each.

        Args:
            misfit: measured − model, SI; zero where a sample does not count.
            values: every number of the posterior, SI.
        """
        variance = values[self.sd_index] ** 2 + self.propagated_sd**2
        s = misfit / jnp.sqrt(variance)
        if self.correlation_index < 0:
            return s * self.measured, 0.5 * jnp.log(variance)
        correlation = values[self.correlation_index] * self.has_predecessor
        last = jnp.roll(s, 1) if self.predecessor is None else s[self.predecessor]
        innovation_variance = 1 - correlation**2
        return (s - correlation * last) / jnp.sqrt(innovation_variance) * self.measured, 0.5 * jnp.log(
            variance * innovation_variance
        )

    def compute_log_density(
        self, misfit: Float[Array, " n"], values: Float[Array, " p"]
    ) -> Float[Array, " n"]:
        """Log-density of every sample given those before it, in SI; zero where it does not count."""
        innovation, log_sd = self.standardise_innovations(misfit, values)
        return (-0.5 * innovation**2 - log_sd - 0.5 * jnp.log(2 * jnp.pi)) * self.measured

    def compute_information(self, values: Float[Array, " p"]) -> Float[Array, "2 2"]:
        """Expected information on (ln sd, correlation); the second is idle without a correlation."""
        own_share = values[self.sd_index] ** 2 / (values[self.sd_index] ** 2 + self.propagated_sd**2)
        n, linked = jnp.sum(self.measured * own_share**2), jnp.sum(self.has_predecessor)
        if self.correlation_index < 0:
            return jnp.array([[2 * n, 0.0], [0.0, 1.0]])
        # The variance of an innovation, σ²(1 − ρ²), and ρ are orthogonal: 1/2 and 1/(1 − ρ²) a sample.
        correlation = values[self.correlation_index]
        innovation_variance = 1 - correlation**2
        across = -2 * correlation / innovation_variance * jnp.sum(self.has_predecessor * own_share)
        alone = linked * (2 * correlation**2 / innovation_variance**2 + 1 / innovation_variance)
        return jnp.array([[2 * n, across], [across, alone]])


def build_noise_parameters(
    case: Case, dataset: Dataset, values: Float[Array, " p"], prefix: str, first_index: int
) -> tuple[list[FreeParameter], list[Ar1Likelihood]]:
    """The numbers of a case's noise, started at what a residual shows, and its channels.

    Args:
        case: the recording.
        dataset: its member; only samples with a weight count.
        values: (p,) values of the muscle's numbers, SI.
        prefix: before every name, as "case/".
        first_index: how many numbers stand before these.
    """
    sensors, n = case.entry.sensors, case.recording.n
    misfit = compute_si_residuals(dataset, values)
    propagated_sd = compute_effective_sd(dataset, values, sensors, (0.0, 0.0))
    parameters, likelihoods = [], []
    for k, (channel, stated_sd) in enumerate(zip(CHANNELS, (sensors.force, sensors.diameter), strict=True)):
        measured = np.isfinite(misfit[k]) & (np.asarray(dataset.rows.training_mask) > 0)
        if not measured.any():
            continue
        predecessor, has_predecessor = _find_predecessors(measured[:n], case.recording.starts)
        own_sd = _estimate_own_sd(misfit[k][measured], propagated_sd[k][measured])
        reference = stated_sd or estimate_starting_sd(case)[k]
        parameters.append(
            _build_sd_parameter(f"{prefix}noise.{channel}", channel, own_sd, reference, stated_sd is not None)
        )
        is_correlated = case.recording.has_time and has_predecessor.sum() >= MIN_LINKED_SAMPLES
        if is_correlated:
            s = np.where(measured, misfit[k], 0.0)[:n] / np.sqrt(own_sd**2 + propagated_sd[k][:n] ** 2)
            parameters.append(
                _build_correlation_parameter(
                    f"{prefix}noise.{channel}_correlation", s, predecessor, has_predecessor
                )
            )
        sd_index = first_index + len(parameters) - (2 if is_correlated else 1)
        likelihoods.append(
            _build_ar1_likelihood(
                k, sd_index, is_correlated, measured, predecessor, has_predecessor, propagated_sd[k]
            )
        )
    return parameters, likelihoods


def estimate_innovation_autocorrelation(
    innovation: np.ndarray, likelihood: Ar1Likelihood, case: Case
) -> float:
    """How many innovations are worth one independent one: 1 where the noise has one memory."""
    measured = np.asarray(likelihood.measured)[: case.recording.n] > 0
    row = np.where(measured, innovation[: case.recording.n], np.nan)
    return estimate_autocorrelation_time(row, case.recording.starts)


def _find_predecessors(measured: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row of the measured sample before each one, and whether it is one of the same run; (n,) each."""
    n = measured.size
    row = np.where(measured, np.arange(n), -1)
    last = np.concatenate([[-1], np.maximum.accumulate(row)[:-1]])
    run = np.cumsum(starts)
    has_predecessor = measured & (last >= 0) & (run[last] == run)
    return np.where(has_predecessor, last, np.maximum(np.arange(n) - 1, 0)), has_predecessor


def _estimate_own_sd(misfit: np.ndarray, propagated_sd: np.ndarray) -> float:
    """The channel's own sd: what of the misfit the carried noise does not explain, at least a tenth."""
    square = float(np.mean(misfit**2))
    return float(np.sqrt(max(square - float(np.mean(propagated_sd**2)), 0.01 * square, 1e-30)))


def _build_sd_parameter(
    name: str, channel: str, own_sd: float, reference: float, stated: bool
) -> FreeParameter:
    low, high = (factor * reference for factor in (STATED_SD_FACTORS if stated else UNSTATED_SD_FACTORS))
    unit, show = SI_UNIT[channel], DISPLAY_UNIT[channel]
    source = "half to 200 times the stated sensor" if stated else "1e-4 to 1 of the channel's range"
    about = Meaning(unit, show, low, high, "log", f"sd of a sample of {channel}", source)
    return FreeParameter(name, about, float(np.clip(own_sd, 1.05 * low, 0.95 * high)))


def _build_correlation_parameter(
    name: str, s: np.ndarray, predecessor: np.ndarray, has_predecessor: np.ndarray
) -> FreeParameter:
    low, high = CORRELATION_LIMITS
    pairs = float(
        np.sum(s[has_predecessor] * s[predecessor[has_predecessor]])
        / max(np.sum(s[has_predecessor] ** 2), 1e-300)
    )
    about = "correlation of a sample's noise with that of the one before"
    meaning = Meaning("1", "1", low, high, "linear", about, "from alternating to almost constant")
    return FreeParameter(name, meaning, float(np.clip(pairs, -0.4, 0.995)))


def _build_ar1_likelihood(
    channel, sd_index, is_correlated, measured, predecessor, has_predecessor, propagated_sd
) -> Ar1Likelihood:
    def pad(array):
        return jnp.asarray(np.concatenate([array, np.zeros(measured.size - array.size)]))

    rows = np.concatenate([predecessor, np.zeros(measured.size - predecessor.size, dtype=int)])
    adjacent = bool(np.all(predecessor[has_predecessor] == np.flatnonzero(has_predecessor) - 1))
    return Ar1Likelihood(
        channel=channel,
        sd_index=sd_index,
        correlation_index=sd_index + 1 if is_correlated else -1,
        measured=jnp.asarray(measured.astype(float)),
        has_predecessor=pad(has_predecessor.astype(float)),
        predecessor=None if adjacent else jnp.asarray(rows),
        propagated_sd=jnp.asarray(propagated_sd),
    )
