"""Effective noise of force and diameter, and its integrated autocorrelation time.

The model propagates the noise of pressure P and length L to force and diameter y:

    sd² = sd_channel² + (∂y/∂P sd_P)² + (∂y/∂L sd_L)²

With the integrated autocorrelation time τ = 1 + 2 Σ ρ_k, n samples have the effective sample size n / τ. The
standard deviations of a fit are multiplied by √τ. This approximates generalised least squares where the
sensitivities to the parameters change slowly, and needs no model of the autocorrelation.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.infer.problem.dataset import Dataset
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.recording import Recording

#: The sum of autocorrelations ends at this many correlation times (Sokal's window).
AUTOCORRELATION_WINDOW = 4.0
#: The sum also ends at the lag at which fewer than this fraction of the samples has a partner.
MIN_PAIRED_SHARE = 0.5


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel, from the residuals of a fit.

    Attributes:
        sd: effective sd of a sample, SI: of its sensor, with the propagated noise of pressure and length.
            Without a stated sensor, the rms residual.
        stated: whether muscle.toml states the sensor's noise.
        excess: residual rms / `sd`; above one, the model lacks a mechanism.
        autocorrelation_time: integrated autocorrelation time, samples.
        correlation_time: time constant of an exponential autocorrelation with this integrated time, s.
        samples: number of samples.
    """

    sd: float
    stated: bool
    excess: float
    autocorrelation_time: float
    correlation_time: float
    samples: int


@eqx.filter_jit
def compute_sensitivities(dataset: Dataset, values: Float[Array, " p"]) -> tuple[Array, Array]:
    """Return ∂(force, diameter)/∂pressure and ∂(force, diameter)/∂length, each (2, n)."""
    muscle = dataset.build_muscle(values)

    def predict_both(pressure, length):
        reading = muscle(pressure, length)
        return jnp.stack([reading.force, reading.diameter])

    derivatives = jax.vmap(jax.jacfwd(predict_both, argnums=(0, 1)), out_axes=-1)
    return derivatives(dataset.rows.pressure, dataset.rows.length)


def compute_effective_sd(
    dataset: Dataset, values: Array, sensors: Sensors, own_sd: tuple[float, float]
) -> np.ndarray:
    """Return the effective standard deviation of every sample of force and diameter, SI, (2, n).

    Args:
        dataset: the recording.
        values: (p,) parameters, SI.
        sensors: the stated noise.
        own_sd: standard deviations of the force sensor and of the diameter sensor, SI.
    """
    by_pressure, by_length = (np.asarray(s) for s in compute_sensitivities(dataset, values))
    pressure = (sensors.pressure or 0.0) * by_pressure
    # An error of a length setting is a parameter of the fit, not noise.
    length = (0.0 if sensors.length_per_setting else sensors.length or 0.0) * by_length
    return np.sqrt(np.asarray(own_sd)[:, None] ** 2 + pressure**2 + length**2)


def estimate_autocorrelation_time(
    residual: np.ndarray, starts: np.ndarray, effective_parameters: float = 0.0
) -> float:
    """Return the integrated autocorrelation time 1 + 2 Σ ρ_k, samples.

    Each fitted parameter reduces the autocovariance of n residuals by Γ/n at every lag, where Γ is the sum of
    the autocovariance. In a window of 2W + 1 lags, the sum is too small by the fraction (2W + 1)/n for each
    parameter. The result is corrected for this bias.

    Source: for a mean, Wolff, Comput. Phys. Commun. 156, 143 (2004).

    Args:
        residual: (n,) residuals over their standard deviation, in the order of time; NaN where not measured.
        starts: (n,) whether a continuous run begins at this row.
        effective_parameters: number of parameters that the fit has estimated from these samples.
    """
    runs = [run[np.isfinite(run)] for run in np.split(residual, np.flatnonzero(starts)[1:])]
    runs = [run for run in runs if run.size > 1]
    n = sum(run.size for run in runs)
    if n < 30:
        return 1.0
    covariance = _pool_autocovariance(runs)
    if covariance[0] <= 0:
        return 1.0
    total = 2 * np.cumsum(covariance / covariance[0]) - 1
    long_enough = np.flatnonzero(np.arange(total.size) >= AUTOCORRELATION_WINDOW * np.maximum(total, 1) / 2)
    window = int(long_enough[0]) if long_enough.size else total.size - 1
    # This is the first order of a series: at most a factor of two. The result is between one and n.
    correction = min(effective_parameters * (2 * window + 1) / n, 1.0)
    return float(np.clip(total[window] * (1 + correction), 1.0, n))


def _pool_autocovariance(runs: list[np.ndarray]) -> np.ndarray:
    """Return the autocovariance at lags with enough pairs, pooled over runs, without pairs across gaps."""
    longest = max(run.size for run in runs)
    size = 1 << (2 * longest - 1).bit_length()
    total, count = np.zeros(longest), np.zeros(longest)
    for run in runs:
        spectrum = np.abs(np.fft.rfft(run, size)) ** 2
        total[: run.size] += np.fft.irfft(spectrum, size)[: run.size]
        count[: run.size] += run.size - np.arange(run.size)
    has_pairs = count >= MIN_PAIRED_SHARE * count[0]
    return total[has_pairs] / count[has_pairs]


def compute_correlation_time(
    autocorrelation_time: float, recording: Recording, measured: np.ndarray
) -> float:
    """Return the time constant of an exponential autocorrelation, s; 0 without a time column."""
    if recording.time is None or autocorrelation_time <= 1.05 or measured.sum() < 2:
        return 0.0
    step = float(np.median(np.diff(recording.time[measured])))
    lag_one = (autocorrelation_time - 1) / (autocorrelation_time + 1)
    return -step / np.log(lag_one)
