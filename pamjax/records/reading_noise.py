"""Noise of a channel from its second differences, without a model of the channel.

Source: the second difference of white noise has six times its variance; median of the absolute value of a
normal variable.
"""

from __future__ import annotations

import numpy as np

#: Median of the absolute second difference of white noise with a standard deviation of 1.
_MEDIAN_SECOND_DIFFERENCE = 0.6745 * np.sqrt(6)


def estimate_reading_noise(second_differences: np.ndarray) -> float:
    """Return the standard deviation of white noise with these second differences; NaN without any.

    The median is robust against single jumps. A slow course of the channel has small second differences.

    Args:
        second_differences: any shape; NaN where not measured.

    >>> rng = np.random.default_rng(0)
    >>> round(estimate_reading_noise(np.diff(0.1 * np.arange(9999) + 2.0 * rng.standard_normal(9999), 2)), 1)
    2.0
    """
    finite = second_differences[np.isfinite(second_differences)]
    return float(np.median(np.abs(finite)) / _MEDIAN_SECOND_DIFFERENCE) if finite.size else float("nan")
