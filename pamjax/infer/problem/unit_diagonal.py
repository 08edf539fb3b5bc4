"""Matrices of parameters with different units, scaled to a unit diagonal before they are inverted.

Newtons and pascals are many orders of magnitude apart: without the scale, small eigenvalues are rounding.
"""

from __future__ import annotations

import numpy as np

#: Eigenvalues of a scaled matrix below this share of the largest one are rounding.
_MIN_EIGENVALUE_SHARE = 1e-12


def scale_to_unit_diagonal(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A / (u uᵀ) with a unit diagonal, and u, (k,), of a positive semi-definite matrix A, (k, k)."""
    unit = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return information / np.outer(unit, unit), unit


def invert_scaled(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pseudo-inverse of A / (u uᵀ), and u, (k,). Over u uᵀ it is the inverse of A."""
    scaled, unit = scale_to_unit_diagonal(information)
    return np.linalg.pinv(scaled, rcond=_MIN_EIGENVALUE_SHARE, hermitian=True), unit
