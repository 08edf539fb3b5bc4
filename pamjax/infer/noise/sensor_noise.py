"""Effective noise of force and diameter.

The model propagates the noise of pressure P and length L to force and diameter y:

    sd² = sd_channel² + (∂y/∂P sd_P)² + (∂y/∂L sd_L)²

In an isotonic test, y is the length at the set force. The noise of the set force F takes the place of that of
the length. The propagated noise is the change of the prediction by one sd of P and of F.

Neglects: in an isotonic test, the noise of the measured length that reaches the predicted length through the
memories. In simulated ramps with friction, the sd of the residual is up to three times that of the sensor in
the samples after a reversal. Elsewhere it is about that of the sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.compile.programs import run_compiled
from pamjax.infer.problem.dataset import Dataset, predict_row_channels
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.recording import Recording


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel, from the residuals of a fit.

    Attributes:
        sd: effective sd of a sample, SI: of its sensor, with the propagated noise of pressure and length.
            Without a stated sensor, from neighbouring samples, or the rms residual.
        is_stated: whether muscle.toml states the sensor's noise.
        rms_over_noise: residual rms / `sd`; above one, the model lacks a mechanism.
        autocorrelation_time: integrated autocorrelation time, samples.
        correlation_time: time constant of an exponential autocorrelation with this integrated time, s.
        samples: number of samples.
        neighbour_sd: sd of a sample from the differences of neighbouring samples, SI; None without them.
    """

    sd: float
    is_stated: bool
    rms_over_noise: float
    autocorrelation_time: float
    correlation_time: float
    samples: int
    neighbour_sd: float | None = None

    @property
    def is_known(self) -> bool:
        """Return whether the noise is stated or from neighbouring samples, so that it excludes a misfit."""
        return self.is_stated or self.neighbour_sd is not None


def compute_sensitivities(dataset: Dataset, values: Float[Array, " p"]) -> tuple[Array, Array]:
    """Return ∂(force, diameter)/∂pressure and ∂(force, diameter)/∂length, each (2, n)."""
    return run_compiled(_compute_sensitivities, dataset.without_filters(), values)


def _compute_sensitivities(dataset: Dataset, values: Float[Array, " p"]) -> tuple[Array, Array]:
    muscle = dataset.build_muscle(values)

    def predict_both(pressure, length):
        reading = muscle(pressure, length)
        return jnp.stack([reading.force, reading.diameter])

    derivatives = jax.vmap(jax.jacfwd(predict_both, argnums=(0, 1)), out_axes=-1)
    return derivatives(dataset.rows.pressure, dataset.rows.length)


def compute_effective_sd(
    dataset: Dataset, values: Array, sensors: Sensors, sensor_sds: tuple[float, float]
) -> np.ndarray:
    """Return the effective standard deviation of every sample of force and diameter, SI, (2, n).

    Args:
        dataset: the recording.
        values: (p,) parameters, SI.
        sensors: the stated noise.
        sensor_sds: standard deviations of the force sensor and of the diameter sensor, SI.
    """
    if dataset.rows.set_force is not None:
        variance = compute_isotonic_variance(dataset, sensors, lambda d: predict_row_channels(d, values))
        return np.sqrt(np.asarray(sensor_sds)[:, None] ** 2 + variance)
    variance = np.square(sensor_sds)[:, None] + compute_propagated_variance(dataset, values, sensors)
    return np.sqrt(variance)


def compute_propagated_variance(dataset: Dataset, values: Array, sensors: Sensors) -> np.ndarray:
    """Return the variance of force and diameter by the noise of pressure and length, SI, (2, n).

    Args:
        dataset, values, sensors: as for `compute_effective_sd`.
    """
    # An error of a length level is a parameter of the fit, not noise.
    length_sd = 0.0 if sensors.length_per_level else sensors.length or 0.0
    pressure_sd = sensors.pressure or 0.0
    if not (pressure_sd or length_sd):
        return np.zeros((2, dataset.rows.pressure.size))
    by_pressure, by_length = (np.asarray(s) for s in compute_sensitivities(dataset, values))
    return (pressure_sd * by_pressure) ** 2 + (length_sd * by_length) ** 2


def compute_isotonic_variance(
    dataset: Dataset, sensors: Sensors, predict: Callable[[Dataset], np.ndarray]
) -> np.ndarray:
    """Return the variance of length and diameter by the noise of pressure and set force, SI, (2, n).

    The diameter also contains the noise of the length at which it is predicted. The noise of the length that
    passes through the memories is neglected.

    Args:
        dataset: an isotonic recording.
        sensors: the stated noise.
        predict: both predicted channels of a dataset, (2, n), SI.
    """
    stated_sds = {"pressure": sensors.pressure, "set_force": sensors.force, "length": sensors.length}
    exact, variance = None, np.zeros((2, 1))
    for name, sd in stated_sds.items():
        if sd is None:
            continue
        exact = predict(dataset) if exact is None else exact
        shifted = eqx.tree_at(lambda d, n=name: getattr(d.rows, n), dataset, getattr(dataset.rows, name) + sd)
        change = np.nan_to_num(predict(shifted) - exact)
        # The noise of the length itself is that of its sensor; that through the memories is neglected.
        variance = variance + (change * [[0.0], [1.0]] if name == "length" else change) ** 2
    return np.broadcast_to(variance, (2, dataset.rows.pressure.size))


def compute_correlation_time(
    autocorrelation_time: float, recording: Recording, measured: np.ndarray
) -> float:
    """Return the time constant of an exponential autocorrelation, s; 0 without a time column."""
    if recording.time is None or autocorrelation_time <= 1.05 or measured.sum() < 2:
        return 0.0
    step = float(np.median(np.diff(recording.time[measured])))
    lag_one = (autocorrelation_time - 1) / (autocorrelation_time + 1)
    return -step / np.log(lag_one)
