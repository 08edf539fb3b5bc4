"""Weights of samples, from the noise of the residuals of a solution.

A recording with a time column and enough samples has the noise model of its neighbouring samples, and its
residuals are whitened. The noise of another recording is the stated noise or the rms residual.
"""

from __future__ import annotations

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.infer.fitting.least_squares import Loss, Solution
from pamjax.infer.form_errors.dataset_form import estimate_form, whiten_form_again
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.autocorrelation import compute_variance_inflation, estimate_autocorrelation_time
from pamjax.infer.noise.estimate import compute_noise_variances, estimate_neighbour_sd, estimate_noise_model
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.noise_settings import NOISE_SETTINGS
from pamjax.infer.noise.sensor_noise import ChannelNoise, compute_correlation_time, compute_effective_sd
from pamjax.infer.problem.dataset import Dataset, compute_si_misfit
from pamjax.infer.problem.informative_samples import (
    estimate_starting_sd,
    find_informative_samples,
    get_stated_sds,
)
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.jit import compile_on_call
from pamjax.records.case import Case

#: Residuals are clipped here for a soft loss, robust standard deviations; 1 of 400 normal samples is beyond.
_SOFT_LOSS_CLIP_SD = 3.0


def reweight_dataset(
    case: Case,
    dataset: Dataset,
    space: ParameterSpace,
    solution: Solution,
    loss: Loss = "square",
) -> tuple[Dataset, dict[str, ChannelNoise]]:
    """Return the dataset with weights from its noise, and the noise by channel.

    The weight of a dataset with a whitening filter is 1 / sd, with the noise of neighbouring samples.
    Otherwise, it is 1 / (sd √(autocorrelation time) max(r, 1)), where r is the residual rms over the noise.
    So a misfit counts as noise, and widens the standard deviations of the parameters. With a soft loss, the
    residuals are clipped.

    Args:
        case: the recording and its muscle.toml.
        dataset: its dataset.
        space: the parameters.
        solution: the solution with the residuals.
        loss: the loss of the fit.
    """
    if dataset.whitening is not None:
        return _whiten_dataset(case, dataset, space, solution, loss)
    sensors, n = case.muscle_toml.sensors, case.recording.n
    sd = compute_effective_sd(dataset, space.to_values(solution.u), sensors, estimate_starting_sd(case))
    misfit = compute_noise_residuals(dataset, space.to_values(solution.u))
    weights, channel_weights, noise = np.zeros_like(misfit), np.ones(2), {}
    fitted_parameters = _count_effective_parameters(solution)
    channels = case.recording.model_channels
    for k, (channel, stated_sd) in enumerate(zip(channels, get_stated_sds(case), strict=True)):
        measured = np.isfinite(misfit[k])
        if not measured.any():
            continue
        weights[k, measured] = 1 / sd[k, measured]
        standardised = (misfit[k] / sd[k])[:n]
        standardised = standardised if loss == "square" else _clip_outliers(standardised)
        effective_parameters = fitted_parameters * measured.sum() / np.isfinite(misfit).sum()
        autocorrelation_time = estimate_autocorrelation_time(
            standardised, case.recording.is_run_start, effective_parameters
        )
        rms_over_noise = math.sqrt(
            np.nansum(standardised**2)
            / _compute_degrees_of_freedom(measured.sum(), effective_parameters, autocorrelation_time)
        )
        smallest_excess = 1.0 if stated_sd else 1e-12
        channel_weights[k] = 1 / (math.sqrt(autocorrelation_time) * max(rms_over_noise, smallest_excess))
        noise[channel] = ChannelNoise(
            sd=float(np.sqrt(np.mean(sd[k, measured] ** 2))) * (1.0 if stated_sd else rms_over_noise),
            is_stated=stated_sd is not None,
            rms_over_noise=rms_over_noise if stated_sd else 1.0,
            autocorrelation_time=autocorrelation_time,
            correlation_time=compute_correlation_time(autocorrelation_time, case.recording, measured[:n]),
            samples=int(measured.sum()),
        )
    return _set_weights(dataset, weights, channel_weights), noise


def has_enough_neighbours(case: Case) -> bool:
    """Return whether every measured channel has enough neighbouring samples to estimate its noise."""
    recording = case.recording
    if not recording.has_time:
        return False
    run_number = np.cumsum(recording.is_run_start)
    rows_of_channels = [np.flatnonzero(find_informative_samples(case, c)) for c in recording.channels]
    pairs = [int(np.sum(np.diff(run_number[rows]) == 0)) for rows in rows_of_channels if rows.size]
    return bool(pairs) and min(pairs) >= NOISE_SETTINGS.min_samples_for_correlation


def add_whitening(case: Case, dataset: Dataset) -> Dataset:
    """Return the dataset with a filter for white noise; unchanged without enough neighbouring samples."""
    if not has_enough_neighbours(case):
        return dataset
    rows = dataset.rows
    weights = [np.asarray(w)[: case.recording.n] for w in (rows.force_weight, rows.diameter_weight)]
    informative_rows = [np.flatnonzero(w > 0) for w in weights]
    white = Ar1Noise(np.ones(case.recording.n), 1.0, 0.0, is_stated=True)
    noise = NoiseModel(
        tuple(white if r.size else None for r in informative_rows),
        tuple(informative_rows),
        tuple(np.array([[0, r.size]]) if r.size else np.zeros((0, 2), int) for r in informative_rows),
    )
    return dataclasses.replace(dataset, whitening=noise.build_filter(rows.pressure.size))


def _whiten_dataset(
    case: Case, dataset: Dataset, space: ParameterSpace, solution: Solution, loss: Loss
) -> tuple[Dataset, dict[str, ChannelNoise]]:
    """Return the dataset with the filter and weights of its noise model, and the noise by channel."""
    n = case.recording.n
    model, residual = estimate_noise_of_dataset(case, dataset, space.to_values(solution.u))
    weights, noise = np.zeros((2, dataset.rows.pressure.size)), {}
    fitted_parameters = _count_effective_parameters(solution)
    names = case.recording.model_channels
    for k, (name, channel, rows) in enumerate(zip(names, model.by_channel, model.rows, strict=True)):
        if channel is None:
            continue
        weights[k, rows] = 1 / channel.sd[rows]
        standardised = np.full(n, np.nan)
        standardised[rows] = residual[k, rows] / channel.sd[rows]
        standardised = standardised if loss == "square" else _clip_outliers(standardised)
        neighbour_sd = estimate_neighbour_sd(residual[k], rows, case.recording.is_run_start)
        noise[name] = _describe_noise(
            case, channel, rows, standardised, neighbour_sd, fitted_parameters * rows.size / model.size
        )
    new_dataset = dataclasses.replace(dataset, whitening=model.build_filter(weights.shape[1]))
    return _set_weights(new_dataset, weights, np.ones(2)), noise


def estimate_noise_of_dataset(
    case: Case, dataset: Dataset, values: jnp.ndarray
) -> tuple[NoiseModel, np.ndarray]:
    """Return the noise model of neighbouring samples, and the residual measured − model, SI, (2, n).

    Args:
        case: the recording and its muscle.toml.
        dataset: its dataset.
        values: (p,) parameter values, SI.
    """
    n = case.recording.n
    residual = compute_noise_residuals(dataset, values)[:, :n]
    variances = compute_noise_variances(case, dataset, np.asarray(values))
    model = estimate_noise_model(case, residual, np.isfinite(residual), np.ones(n, dtype=bool), variances)
    return model, residual


def _describe_noise(
    case: Case,
    channel: Ar1Noise,
    rows: np.ndarray,
    standardised: np.ndarray,
    neighbour_sd: float,
    effective_parameters: float,
) -> ChannelNoise:
    """Return the noise of a channel, with the rms and the autocorrelation of its standardised residual."""
    autocorrelation_time = estimate_autocorrelation_time(
        standardised, case.recording.is_run_start, effective_parameters
    )
    mean_square = np.nansum(standardised**2) / _compute_degrees_of_freedom(
        rows.size, effective_parameters, autocorrelation_time
    )
    return ChannelNoise(
        sd=float(np.sqrt(np.mean(channel.sd[rows] ** 2))),
        is_stated=channel.is_stated,
        rms_over_noise=math.sqrt(mean_square),
        autocorrelation_time=autocorrelation_time,
        correlation_time=compute_correlation_time(
            autocorrelation_time, case.recording, np.isfinite(standardised)
        ),
        samples=rows.size,
        neighbour_sd=neighbour_sd,
    )


def compute_mean_square(
    dataset: Dataset, space: ParameterSpace, solution: Solution, loss: Loss = "square"
) -> float:
    """Return the mean square of the whitened residuals; one without a filter."""
    if dataset.whitening is None:
        return 1.0
    residual, _ = _compute_white_residuals(dataset, space, solution, loss)
    return float(np.mean(residual**2))


def set_variance_inflation(
    dataset: Dataset, space: ParameterSpace, solution: Solution, loss: Loss = "square"
) -> Dataset:
    """Return the dataset with the variance inflation of its whitened residuals."""
    if dataset.whitening is None:
        return dataset
    inflation = compute_variance_inflation(*_compute_white_residuals(dataset, space, solution, loss))
    return eqx.tree_at(lambda m: m.whitening.variance_inflation, dataset, jnp.asarray(inflation))


def _compute_white_residuals(
    dataset: Dataset, space: ParameterSpace, solution: Solution, loss: Loss
) -> tuple[np.ndarray, np.ndarray]:
    """Return the whitened residuals of both channels, and whether a run begins at each."""
    assert dataset.whitening is not None
    position = np.asarray(dataset.whitening.position)
    standardised = compute_si_misfit(dataset, space.to_values(solution.u)) * dataset.rows.weights
    residual = np.asarray(_whiten_residuals(dataset, jnp.asarray(standardised)))[position >= 0]
    return residual if loss == "square" else _clip_outliers(residual), position[position >= 0] == 0


@compile_on_call
def _whiten_residuals(dataset: Dataset, standardised: Float[Array, "2 n"]) -> Float[Array, "2 n"]:
    return dataset.whiten_form_errors(jnp.concatenate(dataset.whiten_channels(*standardised))).reshape(2, -1)


def compute_noise_residuals(dataset: Dataset, values: jnp.ndarray) -> np.ndarray:
    """Return measured − model − estimated form errors, SI, (2, n); NaN where not measured."""
    residual = compute_si_misfit(dataset, values) - estimate_form(dataset, values)
    return np.where(dataset.rows.weights > 0, residual, np.nan)


def _clip_outliers(standardised: np.ndarray) -> np.ndarray:
    """Return residuals, clipped at `_SOFT_LOSS_CLIP_SD` robust standard deviations."""
    # For a normal distribution, the median absolute deviation is 0.6745 standard deviations.
    clip_level = _SOFT_LOSS_CLIP_SD * float(np.nanmedian(np.abs(standardised))) / 0.6745
    return np.clip(standardised, -clip_level, clip_level)


def _count_effective_parameters(solution: Solution) -> float:
    """Return the effective number of parameters that the data determine, not the priors."""
    total_information = np.asarray(solution.total_information)
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
    dataset = eqx.tree_at(
        lambda m: (m.rows.force_weight, m.rows.diameter_weight, m.channel_weights), dataset, new
    )
    # The form errors are whitened by the noise.
    return whiten_form_again(dataset)
