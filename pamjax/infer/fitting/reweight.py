"""Weights of samples, from the noise of the residuals of a solution."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution
from pamjax.infer.noise.sensor_noise import (
    ChannelNoise,
    compute_correlation_time,
    compute_effective_sd,
    estimate_autocorrelation_time,
)
from pamjax.infer.problem.dataset import CHANNELS, Dataset, estimate_starting_sd
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.records.case import Case

#: Residuals are clipped here for a soft loss, robust standard deviations; 1 of 400 normal samples is beyond.
SOFT_LOSS_CLIP_SD = 3.0


def reweight_dataset(
    case: Case,
    dataset: Dataset,
    space: ParameterSpace,
    solution: Solution,
    loss: Loss = "square",
    trust_sensors: bool = False,
) -> tuple[Dataset, dict[str, ChannelNoise]]:
    """Return the dataset with weights from its noise, and the noise by channel.

    A weight is 1 / (sd √(autocorrelation time) max(excess, 1)), where excess = residual rms / noise sd. So a
    misfit counts as noise, and widens the standard deviations of the parameters. With a soft loss, the
    residuals are clipped.

    Args:
        case: the recording and its muscle.toml.
        dataset: its dataset.
        space: the parameters.
        solution: the solution with the residuals.
        loss: the loss of the fit.
        trust_sensors: whether the weights use only the stated sd, with independent samples; for the expected
            identifiability before a fit.
    """
    sensors, n = case.entry.sensors, case.recording.n
    sd = compute_effective_sd(dataset, space.to_values(solution.u), sensors, estimate_starting_sd(case))
    misfit = compute_si_residuals(dataset, space.to_values(solution.u))
    weights, channel_weights, noise = np.zeros_like(misfit), np.ones(2), {}
    fitted_parameters = _count_effective_parameters(solution)
    for k, (channel, stated_sd) in enumerate(zip(CHANNELS, (sensors.force, sensors.diameter), strict=True)):
        measured = np.isfinite(misfit[k])
        if not measured.any():
            continue
        weights[k, measured] = 1 / sd[k, measured]
        standard = (misfit[k] / sd[k])[:n]
        standard = standard if loss == "square" else _clip_outliers(standard)
        effective_parameters = fitted_parameters * measured.sum() / np.isfinite(misfit).sum()
        autocorrelation_time = estimate_autocorrelation_time(
            standard, case.recording.starts, effective_parameters
        )
        excess = math.sqrt(
            np.nansum(standard**2)
            / _compute_degrees_of_freedom(measured.sum(), effective_parameters, autocorrelation_time)
        )
        channel_weights[k] = (
            1.0
            if trust_sensors
            else 1 / (math.sqrt(autocorrelation_time) * max(excess, 1.0 if stated_sd else 1e-12))
        )
        noise[channel] = ChannelNoise(
            sd=float(np.sqrt(np.mean(sd[k, measured] ** 2))) * (1.0 if stated_sd else excess),
            stated=stated_sd is not None,
            excess=excess if stated_sd else 1.0,
            autocorrelation_time=autocorrelation_time,
            correlation_time=compute_correlation_time(autocorrelation_time, case.recording, measured[:n]),
            samples=int(measured.sum()),
        )
    return _set_weights(dataset, weights, channel_weights), noise


@eqx.filter_jit
def _compute_weighted_residuals(dataset: Dataset, values):
    return jnp.stack(dataset.compute_standardised_residuals(values)), jnp.stack(
        [dataset.rows.force_weight, dataset.rows.diameter_weight]
    )


def compute_si_residuals(dataset: Dataset, values: jnp.ndarray) -> np.ndarray:
    """Return measured − model, SI, (2, n); NaN where not measured."""
    misfit, weight = (np.asarray(a) for a in _compute_weighted_residuals(dataset, values))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0, misfit / weight, np.nan)


def _clip_outliers(standard: np.ndarray) -> np.ndarray:
    """Return residuals, clipped at `SOFT_LOSS_CLIP_SD` robust standard deviations."""
    # For a normal distribution, the median absolute deviation is 0.6745 standard deviations.
    clip_level = SOFT_LOSS_CLIP_SD * float(np.nanmedian(np.abs(standard))) / 0.6745
    return np.clip(standard, -clip_level, clip_level)


def _count_effective_parameters(solution: Solution) -> float:
    """Return the effective number of parameters that the data determine, not the priors."""
    total_information = np.asarray(solution.information + solution.prior_information)
    return float(np.trace(np.linalg.pinv(total_information) @ np.asarray(solution.information)))


def _compute_degrees_of_freedom(
    samples: int, effective_parameters: float, autocorrelation_time: float
) -> float:
    """Return the degrees of freedom of a channel's residuals.

    A fitted parameter absorbs one independent sample, which is `autocorrelation_time` correlated samples. At
    least a quarter of the samples remains, so that a short recording does not divide by zero.
    """
    return max(
        samples - effective_parameters * autocorrelation_time, (samples - effective_parameters) / 4, 1.0
    )


def _set_weights(dataset: Dataset, weights: np.ndarray, channel_weights: np.ndarray) -> Dataset:
    new = (jnp.asarray(weights[0]), jnp.asarray(weights[1]), jnp.asarray(channel_weights))
    return eqx.tree_at(
        lambda m: (m.rows.force_weight, m.rows.diameter_weight, m.channel_weights), dataset, new
    )
