"""Differences between benches and drift: regressions with the sd between specimens as a parameter.

The model is that of `restricted_likelihood.py` with a line: yᵢ ~ N(a + b xᵢ, τ² + sᵢ²). τ has the largest
restricted likelihood; b is the generalised least-squares estimate at this τ. Its p-value is from Student's t
with n − 2 degrees of freedom. For a drift each bench has its own a, and each bench after the first takes one
degree of freedom. So there is no drift if the recordings of one bench are later than those of another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import minimize_scalar

from pamjax.fleet.restricted_likelihood import compute_log_likelihoods, fit_coefficients

#: Smallest number of specimens of a regression with two coefficients.
_MIN_REGRESSION_SPECIMENS = 5

#: Share of the scatter of a quantity below which other quantities determine it.
_MIN_OWN_SCATTER = 1e-6


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


def fit_slope(
    estimate: np.ndarray, sd: np.ndarray, x: np.ndarray, others: np.ndarray | None = None
) -> Slope | None:
    """Return the change of a parameter with x, or None with too few specimens or one value of x only.

    Args:
        estimate, sd: (n,) estimates of the specimens and their sd.
        x: (n,) the quantity; for a bench the share of its recordings, from 0 to 1.
        others: (n, k) other quantities with an influence, such as the shares of the benches. None for no
            others. The result is None if they determine x.
    """
    n, others = len(estimate), _find_independent_columns(np.empty((len(x), 0)) if others is None else others)
    if n < _MIN_REGRESSION_SPECIMENS + others.shape[1] or _is_determined(x, others):
        return None
    scale = float(np.ptp(estimate) + sd.max())
    y, s = (estimate - np.median(estimate)) / scale, sd / scale
    design = np.column_stack([np.ones(n), (x - x.min()) / np.ptp(x), others])
    result = minimize_scalar(
        lambda tau: -compute_log_likelihoods(y, s, design, np.array([tau]))[0],
        bounds=(0.0, 3.0),
        method="bounded",
    )
    taus = np.array([0.0, float(result.x)])
    tau = float(taus[np.argmax(compute_log_likelihoods(y, s, design, taus))])
    coefficients, covariance = fit_coefficients(y, s, design, tau)
    slope, slope_sd = coefficients[1], float(np.sqrt(covariance[1, 1]))
    p_value = float(2 * stats.t.sf(abs(slope) / slope_sd, n - design.shape[1]))
    change = scale * slope / np.ptp(x)
    start = float(np.median(estimate)) + scale * coefficients[0]
    return Slope(float(change), float(scale * slope_sd / np.ptp(x)), p_value, float(start - change * x.min()))


def _find_independent_columns(columns: np.ndarray) -> np.ndarray:
    """Return centred columns, (n, k), without those that are constant or a sum of earlier ones."""
    independent = np.empty((len(columns), 0))
    for column in (columns - columns.mean(axis=0)).T:
        if not _is_determined(column, independent):
            independent = np.column_stack([independent, column])
    return independent


def _is_determined(x: np.ndarray, columns: np.ndarray) -> bool:
    """Return whether a quantity, (n,), is constant or a linear function of centred columns, (n, k)."""
    centred = x - x.mean()
    rest = centred - columns @ np.linalg.lstsq(columns, centred, rcond=None)[0] if columns.size else centred
    return float(rest @ rest) <= _MIN_OWN_SCATTER * max(float(centred @ centred), 1e-300)
