"""Root mean square of residuals with missing values."""

from __future__ import annotations

import math

import numpy as np


def compute_rms(values: np.ndarray, default: float = math.nan) -> float:
    """Return the root mean square of the finite values; `default` without any.

    >>> compute_rms(np.array([3.0, np.nan, -3.0]))
    3.0
    """
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else default
