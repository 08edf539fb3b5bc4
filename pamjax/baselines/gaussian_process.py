"""Gaussian process on the residual of the baseline, for comparison with the mechanisms.

    measured = baseline(pressure, length) + δ(pressure, contraction, direction, speed) + noise
    δ ~ GP(0, s² exp(−½ Σ (Δx_i / ℓ_i)²))

with s, ℓ and the noise level at their largest marginal likelihood. It fits any smooth misfit near its data
and returns to the baseline far from them. It has no memory; only the direction of motion represents the past.
Source: M. C. Kennedy, A. O'Hagan, J. R. Statist. Soc. B 63, 425 (2001); the baseline is refitted first, on
its own, and the two are not estimated jointly.
"""

from __future__ import annotations

import warnings
from typing import Any, cast

import numpy as np

from pamjax.diagnosis.detect.recording_axes import SHORTENING, build_axes
from pamjax.diagnosis.library.library_problem import LibraryProblem

#: Largest number of training rows, evenly selected: the cost grows with their cube.
_MAX_TRAINING_ROWS = 300

#: Limits of its length scales, in standard deviations of an input.
_MIN_LENGTH_SCALE, _MAX_LENGTH_SCALE = 0.03, 100.0

#: A channel moves if its rate is above this share of the 95 % quantile of rates.
_MIN_RATE_SHARE = 0.05

#: Smallest ratio of speeds with which speed is an input.
_MIN_SPEED_RATIO_FOR_INPUT = 1.5


def build_inputs(problem: LibraryProblem) -> np.ndarray:
    """Return standardised inputs, (n, k): pressure, contraction, direction, and speed if it varies."""
    axes = build_axes(problem)
    pressure = np.asarray(problem.dataset.history.rate(problem.dataset.rows.pressure))[: problem.n]
    length = np.asarray(problem.dataset.history.rate(problem.dataset.rows.length))[: problem.n]
    # At a fixed length, direction and speed are those of the pressure.
    strokes = bool(np.any(axes.motion != 0))
    rate, direction = (
        (length, axes.motion / SHORTENING) if strokes else (pressure, _compute_rate_sign(pressure))
    )
    columns = [axes.pressure, axes.contraction, direction]
    speeds = np.abs(rate)[direction != 0]
    if speeds.size and np.quantile(speeds, 0.9) > _MIN_SPEED_RATIO_FOR_INPUT * np.quantile(speeds, 0.3):
        columns.append(np.arcsinh(np.abs(rate) / max(float(np.median(speeds)), 1e-300)))
    varying_columns = [c for c in columns if np.nanstd(c) > 0]
    return np.stack([(c - np.nanmean(c)) / np.nanstd(c) for c in varying_columns], axis=1)


def _compute_rate_sign(rate: np.ndarray) -> np.ndarray:
    high_rate = float(np.nanquantile(np.abs(rate), 0.95)) if rate.size else 0.0
    return np.where(np.abs(rate) > _MIN_RATE_SHARE * high_rate, np.sign(rate), 0.0)


def find_widest_gap(values: np.ndarray) -> float:
    """Return the widest gap between neighbouring values: the smallest useful length scale.

    With a shorter length scale each isobar is fitted separately, and the curve does not interpolate.

    >>> find_widest_gap(np.array([0.0, 1.0, 1.01, 3.0]))
    1.99
    """
    return float(
        np.clip(
            np.max(np.diff(np.sort(values)), initial=_MIN_LENGTH_SCALE),
            _MIN_LENGTH_SCALE,
            _MAX_LENGTH_SCALE / 2,
        )
    )


def predict_discrepancy(
    x: np.ndarray, residual: np.ndarray, training_mask: np.ndarray, seed: int = 0
) -> np.ndarray:
    """Fit a Gaussian process to the residual of some rows and return its prediction for all rows.

    Args:
        x: (n, k) standardised inputs.
        residual: (n,) measured minus baseline, any unit.
        training_mask: (n,) whether a row is used in the fit.
        seed: seed of the second start of the search.

    Returns:
        (n,) δ in the unit of `residual`; NaN where an input is missing.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from threadpoolctl import threadpool_limits

    complete_rows = np.all(np.isfinite(x), axis=1)
    rows = np.flatnonzero(training_mask & complete_rows & np.isfinite(residual))
    rows = rows[np.unique(np.linspace(0, rows.size - 1, min(_MAX_TRAINING_ROWS, rows.size)).astype(int))]
    out = np.full(residual.size, np.nan)
    residual_rms = float(np.sqrt(np.mean(residual[rows] ** 2))) or 1.0
    length_scale_bounds = [(find_widest_gap(x[rows, k]), _MAX_LENGTH_SCALE) for k in range(x.shape[1])]
    start = np.clip(1.0, *np.array(length_scale_bounds).T)
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(cast(Any, start), cast(Any, length_scale_bounds))
    process = GaussianProcessRegressor(
        kernel + WhiteKernel(0.01, (1e-8, 10.0)), n_restarts_optimizer=1, random_state=seed
    )
    # One thread is faster than several for matrices of this size.
    with warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
        # A length scale at its limit is a valid result: the input has no effect, or a very local one.
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(x[rows], residual[rows] / residual_rms)
    out[complete_rows] = residual_rms * np.asarray(process.predict(x[complete_rows]))
    return out
