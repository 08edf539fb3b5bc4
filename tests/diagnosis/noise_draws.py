"""Simulated noise for tests."""

import numpy as np
from scipy.signal import lfilter


def repeating(rng, rho, n):
    """Return AR(1) noise of unit variance with correlation rho."""
    fresh = rng.standard_normal(n) * np.sqrt(1 - rho**2)
    fresh[0] /= np.sqrt(1 - rho**2)
    return lfilter([1.0], [1.0, -rho], fresh)
