"""Differences between benches and drift: regressions with the sd between specimens as a parameter.

The model is that of `restricted_likelihood.py` with a line: yᵢ ~ N(a + b xᵢ, τ² + sᵢ²). τ has the largest
restricted likelihood; b is the generalised least-squares estimate at this τ. Its p-value is from Student's t
with n − 2 degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import minimize_scalar

from pamjax.fleet.restricted_likelihood import compute_log_likelihoods, fit_coefficients

#: Smallest number of specimens of a regression.
_MIN_REGRESSION_SPECIMENS = 5


@dataclass(frozen=True)
class Slope:
    """Change of a parameter with a quantity.

    Attributes:
        value, sd: change for one unit of the quantity.
        p_value: two-sided, of no change.
        intercept: value of the parameter where the quantity is zero.
    """

    value: float
    sd: float
    p_value: float
    intercept: float


def fit_slope(estimate: np.ndarray, sd: np.ndarray, x: np.ndarray) -> Slope | None:
    """Return the change of a parameter with x, or None with too few specimens or one value of x only.

    Args:
        estimate, sd: (n,) estimates of the specimens and their sd.
        x: (n,) the quantity; for a bench the share of its recordings, from 0 to 1.
    """
    n = len(estimate)
    if n < _MIN_REGRESSION_SPECIMENS or np.ptp(x) == 0:
        return None
    scale = float(np.ptp(estimate) + sd.max())
    y, s = (estimate - np.median(estimate)) / scale, sd / scale
    design = np.column_stack([np.ones(n), (x - x.min()) / np.ptp(x)])
    result = minimize_scalar(
        lambda tau: -compute_log_likelihoods(y, s, design, np.array([tau]))[0],
        bounds=(0.0, 3.0),
        method="bounded",
    )
    taus = np.array([0.0, float(result.x)])
    tau = float(taus[np.argmax(compute_log_likelihoods(y, s, design, taus))])
    coefficients, covariance = fit_coefficients(y, s, design, tau)
    slope, slope_sd = coefficients[1], float(np.sqrt(covariance[1, 1]))
    p_value = float(2 * stats.t.sf(abs(slope) / slope_sd, n - 2))
    change = scale * slope / np.ptp(x)
    start = float(np.median(estimate)) + scale * coefficients[0]
    return Slope(float(change), float(scale * slope_sd / np.ptp(x)), p_value, float(start - change * x.min()))
