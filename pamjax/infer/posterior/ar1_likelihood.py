"""Noise of a channel in a posterior, with parameters: the sensor's standard deviation and correlation.

It is the noise of `infer/noise/ar1_filter.py`, which `fit` and `diagnose` use. Sample i has the residual e_i.
With the sensor's sd σ and the sd c_i of the noise of pressure and length, propagated through the model,

    s_i = e_i / sqrt(σ² + c_i²),      cov(s_i, s_i+k) = A ρ^k,      A = σ² / (σ² + mean c²)

for k ≥ 1 in every continuous run of samples. White noise has ρ = 0.

Neglects: noise with several correlation times, such as white sensor noise with a slow misfit.
`estimate_innovation_autocorrelation` estimates the remaining autocorrelation, which widens the posterior (see
`log_density.py`).

Source: autoregressive model of order one, Box & Jenkins, Time Series Analysis (1970), ch. 3.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from pamjax.channels import DISPLAY_UNIT, SI_UNIT
from pamjax.infer.fitting.reweight import compute_noise_residuals, estimate_noise_of_dataset
from pamjax.infer.noise.autocorrelation import estimate_autocorrelation_time
from pamjax.infer.noise.sensor_noise import compute_effective_sd
from pamjax.infer.problem.dataset import CHANNELS, Dataset
from pamjax.infer.problem.informative_samples import estimate_starting_sd
from pamjax.infer.problem.parameter_space import FreeParameter
from pamjax.infer.problem.prior_limits import MIN_MISFIT_MEAN_SQUARE
from pamjax.infer.problem.whitening import compute_filter, filter_samples, pack_samples
from pamjax.parameter import Meaning
from pamjax.records.case import Case

#: Minimum number of consecutive pairs of samples for an estimate of the correlation.
_MIN_LINKED_SAMPLES = 30
#: Bounds of a sensor's sd, relative to the stated sd.
_STATED_SD_FACTORS = (0.5, 200.0)
#: Bounds of a sensor's sd without a stated sd, relative to a hundredth of the channel's range.
_UNSTATED_SD_FACTORS = (0.01, 100.0)
#: Bounds of a sensor's correlation of neighbouring samples; zero (white noise) is inside.
_CORRELATION_LIMITS = (-0.5, 0.9995)


def find_noise_units(name: str) -> tuple[str, str]:
    """Return the SI unit and the display unit of a noise parameter."""
    channel = name.rpartition(".")[2]
    return (SI_UNIT[channel], DISPLAY_UNIT[channel]) if channel in SI_UNIT else ("1", "1")


class Ar1Likelihood(eqx.Module):
    """Noise model of one channel of a dataset, with samples in the order of time.

    Attributes:
        channel: 0 for force, 1 for diameter.
        sd_index: index of the channel's sd in the parameters.
        correlation_index: index of the correlation of its neighbouring samples, or -1 for none.
        measured: (n,) one for an informative sample, else zero.
        order: (n,) rows of the informative samples in the order of time, then padding.
        position: (n,) position of each of them in its run; −1 for padding.
        propagated_sd: (n,) sd from the noise of pressure and length, propagated through the model, SI.
    """

    channel: int = eqx.field(static=True)
    sd_index: int = eqx.field(static=True)
    correlation_index: int = eqx.field(static=True)
    measured: Float[Array, " n"]
    order: Int[Array, " n"]
    position: Int[Array, " n"]
    propagated_sd: Float[Array, " n"]

    def standardise_innovations(
        self, misfit: Float[Array, " n"], values: Float[Array, " p"]
    ) -> tuple[Array, Array]:
        """Return the innovations in their own sd, and the logarithm of that sd, SI; (n,) each.

        Args:
            misfit: measured − model, SI; zero for a sample that is not informative.
            values: all parameters of the posterior, SI.
        """
        variance = values[self.sd_index] ** 2 + self.propagated_sd**2
        s, log_sd = misfit / jnp.sqrt(variance) * self.measured, 0.5 * jnp.log(variance)
        if self.correlation_index < 0:
            return s, log_sd
        rho = values[self.correlation_index]
        sample = jnp.where(self.position >= 0, s[self.order], 0.0)
        feedback, innovation_sd = compute_filter(self._compute_fraction(values), rho, self.position)
        white = filter_samples(sample, self.position, rho, feedback, innovation_sd)
        # Padding has the row 0, to which it adds zero.
        by_row = jnp.zeros_like(s).at[self.order]
        return by_row.add(white), log_sd + by_row.add(
            jnp.where(self.position >= 0, jnp.log(innovation_sd), 0.0)
        )

    def _compute_fraction(self, values: Float[Array, " p"]) -> Array:
        """Return A, the sensor's fraction of the variance."""
        sensor_variance = values[self.sd_index] ** 2
        propagated = jnp.sum(self.measured * self.propagated_sd**2) / jnp.sum(self.measured)
        return sensor_variance / (sensor_variance + propagated)

    def compute_log_density(
        self, misfit: Float[Array, " n"], values: Float[Array, " p"]
    ) -> Float[Array, " n"]:
        """Return the log-density of every sample given the earlier ones, in SI; zero if not informative."""
        innovation, log_sd = self.standardise_innovations(misfit, values)
        return (-0.5 * innovation**2 - log_sd - 0.5 * jnp.log(2 * jnp.pi)) * self.measured

    def compute_information(self, values: Float[Array, " p"]) -> Float[Array, "2 2"]:
        """Return the expected information on (ln sd, correlation); (1, 1) is one without a correlation.

        It is exact without propagated noise, and approximate with it.
        """
        own_share = values[self.sd_index] ** 2 / (values[self.sd_index] ** 2 + self.propagated_sd**2)
        n = jnp.sum(self.measured * own_share**2)
        if self.correlation_index < 0:
            return jnp.array([[2 * n, 0.0], [0.0, 1.0]])
        # The innovation variance σ²(1 − ρ²) and ρ are orthogonal; a sample gives 1/2 and 1/(1 − ρ²).
        correlation = values[self.correlation_index]
        innovation_variance = 1 - correlation**2
        own_share = jnp.where(self.position > 0, own_share[self.order], 0.0)
        pair_count = jnp.sum(own_share**2)
        cross_information = -2 * correlation / innovation_variance * jnp.sum(own_share)
        correlation_information = pair_count * (
            2 * correlation**2 / innovation_variance**2 + 1 / innovation_variance
        )
        return jnp.array([[2 * n, cross_information], [cross_information, correlation_information]])


def build_noise_parameters(
    case: Case, dataset: Dataset, values: Float[Array, " p"], prefix: str, first_index: int
) -> tuple[list[FreeParameter], list[Ar1Likelihood]]:
    """Return the noise parameters of a case with their starting values, and its noise models.

    The starting values are those of the noise model of the fit, or with a misfit those of the residuals.

    Args:
        case: the recording.
        dataset: its dataset; only samples with a weight are used.
        values: (p,) the muscle's parameters, SI.
        prefix: prefix of every name, such as "case/".
        first_index: index of the first noise parameter.
    """
    sensors, n = case.muscle_toml.sensors, case.recording.n
    misfit = compute_noise_residuals(dataset, values)
    model = None if dataset.whitening is None else estimate_noise_of_dataset(case, dataset, values)[0]
    propagated_sd = compute_effective_sd(dataset, values, sensors, (0.0, 0.0))
    parameters, likelihoods = [], []
    for k, (channel, stated_sd) in enumerate(zip(CHANNELS, (sensors.force, sensors.diameter), strict=True)):
        measured = np.isfinite(misfit[k]) & (np.asarray(dataset.rows.training_mask) > 0)
        if not measured.any():
            continue
        order, position = _order_samples(measured, case.recording.is_run_start)
        neighbours = None if model is None else model.by_channel[k]
        sensor_sd = _estimate_sensor_sd(misfit[k][measured], propagated_sd[k][measured])
        if neighbours is not None:
            neighbour_sd = math.sqrt(
                neighbours.ar1_fraction * float(np.mean(neighbours.sd[measured[:n]] ** 2))
            )
            # With a misfit, the posterior's noise includes it: its start is that of the residuals.
            has_misfit = sensor_sd**2 > MIN_MISFIT_MEAN_SQUARE * neighbour_sd**2
            sensor_sd, neighbours = (sensor_sd, None) if has_misfit else (neighbour_sd, neighbours)
        reference = stated_sd or estimate_starting_sd(case)[k]
        parameters.append(
            _build_sd_parameter(
                f"{prefix}noise.{channel}", channel, sensor_sd, reference, stated_sd is not None
            )
        )
        is_correlated = case.recording.has_time and np.sum(position > 0) >= _MIN_LINKED_SAMPLES
        if is_correlated:
            s = misfit[k] / np.sqrt(sensor_sd**2 + propagated_sd[k] ** 2)
            parameters.append(
                _build_correlation_parameter(
                    f"{prefix}noise.{channel}_correlation",
                    _estimate_lag_one(s[order], position) if neighbours is None else neighbours.correlation,
                )
            )
        sd_index = first_index + len(parameters) - (2 if is_correlated else 1)
        arrays = (jnp.asarray(a) for a in (measured.astype(float), order, position, propagated_sd[k]))
        likelihoods.append(Ar1Likelihood(k, sd_index, sd_index + 1 if is_correlated else -1, *arrays))
    return parameters, likelihoods


def estimate_innovation_autocorrelation(
    innovation: np.ndarray, likelihood: Ar1Likelihood, case: Case
) -> float:
    """Return the autocorrelation time of innovations, samples: 1 if the noise is AR(1)."""
    measured = np.asarray(likelihood.measured)[: case.recording.n] > 0
    row = np.where(measured, innovation[: case.recording.n], np.nan)
    return estimate_autocorrelation_time(row, case.recording.is_run_start)


def _order_samples(measured: np.ndarray, is_run_start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the measured rows in the order of time, and their positions in their runs; (n,) each, padded."""
    rows = np.flatnonzero(measured[: is_run_start.size])
    run_number = np.cumsum(is_run_start)[rows]
    begins = np.diff(run_number, prepend=-1) != 0
    return pack_samples(rows, begins, measured.size)


def _estimate_sensor_sd(misfit: np.ndarray, propagated_sd: np.ndarray) -> float:
    """Return the sensor's sd: the rms residual less the propagated noise, at least a tenth of the former."""
    square = float(np.mean(misfit**2))
    return float(np.sqrt(max(square - float(np.mean(propagated_sd**2)), 0.01 * square, 1e-30)))


def _build_sd_parameter(
    name: str, channel: str, sensor_sd: float, reference: float, is_stated: bool
) -> FreeParameter:
    low, high = (factor * reference for factor in (_STATED_SD_FACTORS if is_stated else _UNSTATED_SD_FACTORS))
    unit, show = SI_UNIT[channel], DISPLAY_UNIT[channel]
    source = "half to 200 times the stated sd" if is_stated else "1e-4 to 1 of the channel's range"
    meaning = Meaning(unit, show, low, high, "log", f"sd of the noise of {channel}", source)
    return FreeParameter(name, meaning, float(np.clip(sensor_sd, 1.05 * low, 0.95 * high)))


def _estimate_lag_one(s: np.ndarray, position: np.ndarray) -> float:
    """Return the correlation of neighbouring residuals, in the order of time."""
    later = np.flatnonzero(position > 0)
    return float(np.sum(s[later] * s[later - 1]) / max(np.sum(s[later] ** 2), 1e-300))


def _build_correlation_parameter(name: str, lag_one: float) -> FreeParameter:
    low, high = _CORRELATION_LIMITS
    description = "correlation of the noise of neighbouring samples"
    meaning = Meaning("1", "1", low, high, "linear", description, "from alternating to almost constant noise")
    return FreeParameter(name, meaning, float(np.clip(lag_one, -0.4, 0.995)))
