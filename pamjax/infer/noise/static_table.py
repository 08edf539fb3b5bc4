"""Noise of a static table whose sensors are not stated, read off how far readings lie from a line.

Rows of a table have no neighbours in time. But along pressure at one length (or along length at one
pressure) a muscle is smooth, and so is a misfit: a reading off the line through the two beside it,

    d = y₂ − (1 − w) y₁ − w y₃,     w = (x₂ − x₁) / (x₃ − x₁),     E d² = σ² [1 + (1 − w)² + w²],

tells the noise before anything is known of the misfit; of a line of few readings, all of them are held
against one straight line. Curvature is taken for noise, which is careful.

Source: second differences as T. Gasser, L. Sroka, C. Jennen-Steinmetz, Biometrika 73, 625 (1986).
"""

from __future__ import annotations

import numpy as np

#: Two settings are one if they differ by less than this share of the largest.
SETTING_TOLERANCE = 2e-3

#: A line of at most this many readings is taken for straight.
MAX_STRAIGHT_READINGS = 5

#: Independent squares that m second differences of a line are worth, over m: 18/35 of long lines.
SQUARES_PER_DIFFERENCE = 18 / 35


def estimate_table_variance(
    pressure: np.ndarray, length: np.ndarray, values: np.ndarray
) -> tuple[float, float]:
    """Variance of a reading, and how many independent squares it was found from; NaN and 0 without a line.

    Args:
        pressure: (n,) Pa.
        length: (n,) m.
        values: (n,) readings of one channel, or their misfit; the variance has their unit squared.

    >>> p = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    >>> estimate_table_variance(p, np.ones(5), 7 * p)[0] < 1e-20
    True
    """
    if not values.size:
        return float("nan"), 0.0
    for fixed, along in ((length, pressure), (pressure, length)):
        line_variances = [
            _estimate_line_variance(along[rows], values[rows]) for rows in _group_by_setting(fixed)
        ]
        degrees_of_freedom = sum(squares for _, squares in line_variances)
        if degrees_of_freedom > 0:
            return sum(
                variance * squares for variance, squares in line_variances
            ) / degrees_of_freedom, degrees_of_freedom
    return float("nan"), 0.0


def _estimate_line_variance(along: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Variance along one line, and how many independent squares it was found from."""
    if np.unique(along).size < 3:
        return 0.0, 0.0
    if along.size <= MAX_STRAIGHT_READINGS:
        x = along / np.max(np.abs(along))
        residual = values - np.polyval(np.polyfit(x, values, 1), x)
        return float(residual @ residual) / (along.size - 2), float(along.size - 2)
    squares = _square_second_differences(along, values)
    return float(np.mean(squares)), SQUARES_PER_DIFFERENCE * squares.size + 2 / 7


def _group_by_setting(fixed: np.ndarray) -> list[np.ndarray]:
    """Rows of each setting."""
    order = np.argsort(fixed, kind="stable")
    edges = np.flatnonzero(np.diff(fixed[order]) > SETTING_TOLERANCE * np.max(np.abs(fixed))) + 1
    return np.split(order, edges)


def _square_second_differences(along: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Squares of second differences along a line, each worth one variance."""
    order = np.argsort(along, kind="stable")
    x, y = along[order], values[order]
    span = x[2:] - x[:-2]
    has_span = span > 0
    w = (x[1:-1] - x[:-2])[has_span] / span[has_span]
    difference = y[1:-1][has_span] - (1 - w) * y[:-2][has_span] - w * y[2:][has_span]
    return difference**2 / (1 + (1 - w) ** 2 + w**2)
