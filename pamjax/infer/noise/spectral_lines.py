"""Lines in the spectrum of a residual: a periodic disturbance is no noise.

A ripple of the pressure, or mains interference, changes from sample to sample as noise does. In the estimate
of the noise from neighbouring samples, it would count as noise. The spectrum separates them:
noise is spread over all frequencies. A line is removed if noise has so large an amplitude anywhere with
a probability below `_MAX_PROBABILITY`. For the power P at one of N frequencies, over the mean around it,

    p = N exp(−P).

Source: R. A. Fisher, Proc. R. Soc. A 125, 54 (1929), with a local mean, because noise can be correlated.
Limits: gaps are bridged by straight lines; a disturbance of variable amplitude has several lines.
"""

from __future__ import annotations

import math

import numpy as np

#: Probability of noise below which a line is removed, and largest number of lines.
_MAX_PROBABILITY, _MAX_LINES = 1e-4, 8
#: Fewest samples, and fewest periods of a line: slower courses are smooth.
_MIN_SAMPLES, _MIN_PERIODS = 128, 10
#: Frequencies that are tried on each side of a line, and their distance in resolutions of the spectrum.
_TRIALS, _TRIAL_STEP = 10, 0.1
#: Number of frequencies on each side whose median power is the noise around a line.
_NEIGHBOURS = 24


def remove_spectral_lines(residual: np.ndarray, rows: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the residual without its periodic parts, (n,), SI.

    Args:
        residual: (n,) measured − model, SI.
        rows: rows of the samples, in the order of time.
        time: (n,) s.
    """
    values, moments = residual[rows].copy(), time[rows]
    if not np.all(np.isfinite(values)):
        return residual
    for _ in range(_MAX_LINES):
        frequencies, power = compute_relative_power(values, moments)
        if not power.size or math.log(power.size) - power.max() > math.log(_MAX_PROBABILITY):
            break
        frequency = refine_frequency(values, moments, frequencies[np.argmax(power)])
        values -= _fit_wave(values, moments, frequency)
    out = residual.copy()
    out[rows] = values
    return out


def compute_relative_power(values: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies, Hz, and at each the power of a signal over the mean power of the noise around it.

    Frequencies of fewer than `_MIN_PERIODS` periods are left out. Both arrays are empty for a short signal.

    Args:
        values: (n,) the signal.
        moments: (n,) s, increasing.
    """
    from scipy.ndimage import median_filter

    step = float(np.median(np.diff(moments))) if moments.size >= _MIN_SAMPLES else 0.0
    if not step > 0:
        return np.zeros(0), np.zeros(0)
    even = np.arange(moments[0], moments[-1], step)
    signal = np.interp(even, moments, values - values.mean())
    # Prewhitened: the spectrum of slow courses and of correlated noise is steep, and their mean is not local.
    correlation = float(signal[1:] @ signal[:-1]) / max(float(signal @ signal), 1e-300)
    signal = signal[1:] - correlation * signal[:-1]
    power = np.abs(np.fft.rfft(signal * np.hanning(signal.size))) ** 2
    if power.size <= _MIN_PERIODS + 2 * _NEIGHBOURS:
        return np.zeros(0), np.zeros(0)
    # The power of noise has an exponential distribution, whose median is ln 2 times its mean.
    median = median_filter(power, 2 * _NEIGHBOURS + 1, mode="mirror")
    relative = power * math.log(2) / np.maximum(median, 1e-300)
    return np.fft.rfftfreq(signal.size, step)[_MIN_PERIODS:], relative[_MIN_PERIODS:]


def refine_frequency(values: np.ndarray, moments: np.ndarray, frequency: float) -> float:
    """Return the frequency within one resolution, Hz, whose wave fits most of the values.

    Args:
        values: (n,) the signal.
        moments: (n,) s, increasing.
        frequency: of the discrete spectrum, Hz.
    """
    resolution = 1 / float(np.ptp(moments))
    trials = frequency + _TRIAL_STEP * resolution * np.arange(-_TRIALS, _TRIALS + 1)
    # From one trial to the next, the phase of each sample advances by a constant.
    (cosine, sine), (by_cosine, by_sine) = (
        _compute_waves(f, moments) for f in (trials[0], _TRIAL_STEP * resolution)
    )
    sizes = []
    for _ in trials:
        amplitudes, projections = _fit_amplitudes(values, np.stack([cosine, sine]))
        sizes.append(amplitudes @ projections)
        cosine, sine = cosine * by_cosine - sine * by_sine, sine * by_cosine + cosine * by_sine
    return float(trials[np.argmax(sizes)])


def _fit_wave(values: np.ndarray, moments: np.ndarray, frequency: float) -> np.ndarray:
    """Return the wave of a frequency that fits most of the values, (n,)."""
    waves = _compute_waves(frequency, moments)
    return _fit_amplitudes(values, waves)[0] @ waves


def _compute_waves(frequency: float, moments: np.ndarray) -> np.ndarray:
    """Return cosine and sine of a frequency, (2, n)."""
    phase = 2 * np.pi * frequency * moments
    return np.stack([np.cos(phase), np.sin(phase)])


def _fit_amplitudes(values: np.ndarray, waves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitudes of cosine and sine that fit most, and the products of both with the values."""
    projections = waves @ values
    # A pseudo-inverse: at half the sampling rate, cosine and sine are the same wave.
    return np.linalg.pinv(waves @ waves.T, rcond=1e-10, hermitian=True) @ projections, projections
