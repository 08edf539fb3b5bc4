"""Noise of a static table whose sensor noise is not stated, from second differences.

Rows of a table have no order in time. But force and misfit are smooth along pressure at one length, and along
length at one pressure. The deviation of a reading from the line through its two neighbours,

    d = y₂ − (1 − w) y₁ − w y₃,     w = (x₂ − x₁) / (x₃ − x₁),     E d² = σ² [1 + (1 − w)² + w²],

estimates the noise without a model. A line of few readings is compared with one straight line instead.
Curvature counts as noise, so the estimate is conservative.

Source: second differences as T. Gasser, L. Sroka, C. Jennen-Steinmetz, Biometrika 73, 625 (1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Two levels are equal if they differ by less than this fraction of the largest.
_LEVEL_TOLERANCE = 2e-3

#: Largest number of readings of a line that counts as straight.
_MAX_STRAIGHT_READINGS = 5

#: Degrees of freedom of m second differences of a line, relative to m: 18/35 for long lines.
_SQUARES_PER_DIFFERENCE = 18 / 35


@dataclass(frozen=True)
class TableVariance:
    """Variance of a reading of a static table, in the unit of the reading squared."""

    variance: float
    degrees_of_freedom: float


def estimate_table_variance(
    pressure: np.ndarray, second_input: np.ndarray, values: np.ndarray
) -> TableVariance | None:
    """Return the variance of a reading; None without a line of readings.

    Args:
        pressure: (n,) Pa.
        second_input: (n,) length, m, or the set force of an isotonic test, N.
        values: (n,) readings of one channel, or their misfit; the variance has their unit squared.

    >>> p = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    >>> estimate_table_variance(p, np.ones(5), 7 * p).variance < 1e-20
    True
    """
    if not values.size:
        return None
    for fixed, along in ((second_input, pressure), (pressure, second_input)):
        line_variances = [
            _estimate_line_variance(along[rows], values[rows]) for rows in _group_by_level(fixed)
        ]
        degrees_of_freedom = sum(squares for _, squares in line_variances)
        if degrees_of_freedom > 0:
            sum_of_squares = sum(variance * squares for variance, squares in line_variances)
            return TableVariance(sum_of_squares / degrees_of_freedom, degrees_of_freedom)
    return None


def _estimate_line_variance(along: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Return the variance along one line and its degrees of freedom."""
    if np.unique(along).size < 3:
        return 0.0, 0.0
    if along.size <= _MAX_STRAIGHT_READINGS:
        x = along / np.max(np.abs(along))
        residual = values - np.polyval(np.polyfit(x, values, 1), x)
        return float(residual @ residual) / (along.size - 2), float(along.size - 2)
    squares = _square_second_differences(along, values)
    return float(np.mean(squares)), _SQUARES_PER_DIFFERENCE * squares.size + 2 / 7


def _group_by_level(fixed: np.ndarray) -> list[np.ndarray]:
    """Return the rows of each level."""
    order = np.argsort(fixed, kind="stable")
    edges = np.flatnonzero(np.diff(fixed[order]) > _LEVEL_TOLERANCE * np.max(np.abs(fixed))) + 1
    return np.split(order, edges)


def _square_second_differences(along: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return squared second differences along a line, scaled to expectation σ²."""
    order = np.argsort(along, kind="stable")
    x, y = along[order], values[order]
    span = x[2:] - x[:-2]
    has_span = span > 0
    w = (x[1:-1] - x[:-2])[has_span] / span[has_span]
    difference = y[1:-1][has_span] - (1 - w) * y[:-2][has_span] - w * y[2:][has_span]
    return difference**2 / (1 + (1 - w) ** 2 + w**2)
