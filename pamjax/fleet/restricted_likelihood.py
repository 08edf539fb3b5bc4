"""Restricted likelihood of the sd between specimens, with a mean or a regression line.

Estimate yᵢ ± sᵢ of specimen i, row xᵢ of the design matrix X, coefficients β and sd between specimens τ:

    yᵢ ~ N(xᵢβ, vᵢ),    vᵢ = τ² + sᵢ²

With β integrated out, the log-likelihood of τ is (restricted likelihood, REML)

    ℓ(τ) = −½ [Σ log vᵢ + log det A + Σ (yᵢ − xᵢβ̂)² / vᵢ],    A = Σ xᵢᵀxᵢ / vᵢ,    β̂ = A⁻¹ Σ xᵢᵀyᵢ / vᵢ

β̂ is the generalised least-squares estimate, and A⁻¹ its covariance. A mean has X = 1.

Source: Patterson & Thompson, Biometrika 58 (1971) 545.
"""

from __future__ import annotations

import numpy as np


def fit_coefficients(
    y: np.ndarray, s: np.ndarray, design: np.ndarray, tau: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients, (k,), and their covariance, (k, k), at one τ.

    Args:
        y, s: (n,) estimates and their sd.
        design: (n, k) design matrix.
        tau: sd between specimens.
    """
    coefficients, information = _solve(y, design, 1 / (tau**2 + s[None] ** 2))
    return coefficients[0], np.linalg.inv(information[0])


def compute_log_likelihoods(y: np.ndarray, s: np.ndarray, design: np.ndarray, taus: np.ndarray) -> np.ndarray:
    """Return (m,) restricted log-likelihoods of (m,) values of τ.

    Args:
        y, s: (n,) estimates and their sd.
        design: (n, k) design matrix.
        taus: (m,) sd between specimens.
    """
    weight = 1 / (taus[:, None] ** 2 + s**2)
    coefficients, information = _solve(y, design, weight)
    misfit = (weight * (y - coefficients @ design.T) ** 2).sum(1)
    return -0.5 * (np.linalg.slogdet(information)[1] - np.log(weight).sum(1) + misfit)


def _solve(y: np.ndarray, design: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients, (m, k), and A, (m, k, k), for (m, n) weights."""
    count, size = design.shape
    squares = (design[:, :, None] * design[:, None, :]).reshape(count, size**2)
    information = (weight @ squares).reshape(-1, size, size)
    right = (weight * y) @ design
    return np.linalg.solve(information, right[:, :, None])[:, :, 0], information
