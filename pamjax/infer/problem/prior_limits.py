"""Limits of stated values while a model misses the recording.

A model that lacks a mechanism moves stated values far from their priors, where they imitate the mechanism.
These limits keep the values near what muscle.toml states, so that the misfit remains visible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

#: Greatest distance of a stated value from its estimate, in standard deviations of its prior.
MAX_PRIOR_DEVIATION_SD = 3.0
#: Greatest ratio of fitted and stated thread stiffness, in both directions.
MAX_STIFFNESS_FACTOR = 5.0
#: Mean squared whitened residual above which a model misses a recording.
MIN_MISFIT_MEAN_SQUARE = 1.5


def compute_prior_limits(
    names: Sequence[str],
    bounds: tuple[np.ndarray, np.ndarray],
    mean: np.ndarray,
    prior_sd: np.ndarray,
    max_deviation_sd: float = MAX_PRIOR_DEVIATION_SD,
    max_stiffness_factor: float = MAX_STIFFNESS_FACTOR,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper limits of the parameters of a baseline, (p,) each, SI.

    Args:
        names: of the parameters; a prefix with a slash is ignored.
        bounds: (p,) lower and upper bounds of each, SI.
        mean, prior_sd: (p,) of the priors, SI; sd infinite without a prior.
        max_deviation_sd: greatest distance from the mean, prior sd.
        max_stiffness_factor: greatest ratio of fitted and stated stiffness.
    """
    low, high = (bound.astype(float) for bound in bounds)
    for k, name in enumerate(names):
        if name.rpartition("/")[2] in ("thread.modulus", "thread.stiffness"):
            nearest = mean[k] / max_stiffness_factor, mean[k] * max_stiffness_factor
        elif math.isfinite(prior_sd[k]):
            reach = max_deviation_sd * prior_sd[k]
            nearest = mean[k] - reach, mean[k] + reach
        else:
            continue
        low[k], high[k] = max(low[k], nearest[0]), min(high[k], nearest[1])
    return low, high
