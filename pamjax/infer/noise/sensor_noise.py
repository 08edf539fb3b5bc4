"""What a misfit is measured against: sensor noise, carried through the model, and its correlation.

Noise of the pressure and length channels reaches force and diameter through the model,

    sd² = sd_channel² + (∂y/∂P sd_P)² + (∂y/∂L sd_L)²,

and neighbouring samples repeat each other. With integrated autocorrelation 1 + 2 Σ ρ_k (the
*inflation*), n samples are worth n / inflation; a fit's standard deviations are widened by its root.
For the slow sensitivities of a muscle to its parameters that is what generalised least squares
gives, without having to believe in one shape of correlation.
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

#: The sum of autocorrelations ends at this many of its own correlation times (Sokal's window) ...
AUTOCORRELATION_WINDOW = 4.0
#: ... and at the lag at which fewer than this share of the samples has a partner: beyond, it runs away.
MIN_PAIRED_SHARE = 0.5


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel, as found on the residual of a fit.

    Attributes:
        sd: effective standard deviation of a sample: its sensor's, with pressure's and length's
            noise carried through the model; SI. Where no sensor is given, the residual's own.
        stated: whether the sensor's noise was given.
        excess: residual rms over `sd`; above one, the model misses something.
        inflation: how many samples are worth one independent sample.
        correlation_time: correlation time, s (of an exponential correlation with this inflation).
        samples: number of samples it was found on.
    """

    sd: float
    stated: bool
    excess: float
    inflation: float
    correlation_time: float
    samples: int


@eqx.filter_jit
def compute_sensitivities(dataset: Dataset, values: Float[Array, " p"]) -> tuple[Array, Array]:
    """∂(force, diameter)/∂pressure and ∂(force, diameter)/∂length, each (2, n)."""
    muscle = dataset.build_muscle(values)

    def predict_both(pressure, length):
        reading = muscle(pressure, length)
        return jnp.stack([reading.force, reading.diameter])

    derivatives = jax.vmap(jax.jacfwd(predict_both, argnums=(0, 1)), out_axes=-1)
    return derivatives(dataset.rows.pressure, dataset.rows.length)


def compute_effective_sd(
    dataset: Dataset, values: Array, sensors: Sensors, own_sd: tuple[float, float]
) -> np.ndarray:
    """Standard deviation of every sample of force and diameter, SI, (2, n).

    Args:
        own_sd: standard deviation of the force and the diameter channel themselves, SI.
    """
    by_pressure, by_length = (np.asarray(s) for s in compute_sensitivities(dataset, values))
    pressure = (sensors.pressure or 0.0) * by_pressure
    # One error for each length that was set is a number of its own in the fit, no noise.
    length = (0.0 if sensors.length_per_setting else sensors.length or 0.0) * by_length
    return np.sqrt(np.asarray(own_sd)[:, None] ** 2 + pressure**2 + length**2)


def estimate_autocorrelation_time(
    residual: np.ndarray, starts: np.ndarray, effective_parameters: float = 0.0
) -> float:
    """How many samples are worth one independent sample, 1 + 2 Σ ρ_k.

    Each number that a fit has taken from n samples takes Γ/n from their autocovariance at every lag,
    with Γ its sum, because it absorbs what of the noise looks like itself. Over a window of 2W + 1 lags
    that is a share (2W + 1)/n of Γ, which is given back (for a mean: Wolff, Comput. Phys. Commun. 156,
    143 (2004)).

    Args:
        residual: (n,) misfit over its standard deviation, in the order of time; NaN where not measured.
        starts: (n,) whether a continuous run begins at this row.
        effective_parameters: how many numbers the fit has taken from these samples.
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
    # The first order of a series: worth a doubling at most. And no recording is worth less than a sample.
    correction = min(effective_parameters * (2 * window + 1) / n, 1.0)
    return float(np.clip(total[window] * (1 + correction), 1.0, n))


def _pool_autocovariance(runs: list[np.ndarray]) -> np.ndarray:
    """Autocovariance at every lag with enough pairs, pooled over runs; no product reaches across a gap."""
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
    """Time constant, s, of an exponential correlation with this inflation; 0 without a clock."""
    if recording.time is None or autocorrelation_time <= 1.05 or measured.sum() < 2:
        return 0.0
    step = float(np.median(np.diff(recording.time[measured])))
    lag_one = (autocorrelation_time - 1) / (autocorrelation_time + 1)
    return -step / np.log(lag_one)
