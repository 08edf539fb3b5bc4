"""Standard deviations and correlations of parameters, from their Fisher information."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pamjax.infer.problem.unit_diagonal import scale_to_unit_diagonal


def compute_sd_and_correlation(information: ArrayLike, slope: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the sds of the parameters, SI, NaN without information, and their correlation matrix.

    Args:
        information: (p, p) Fisher information of data and priors, in the coordinates u of the space.
        slope: (p,) d value / d u, SI.
    """
    scaled_information, unit = scale_to_unit_diagonal(np.asarray(information))
    # With a unit diagonal, an eigenvalue of rounding size is a combination without information.
    eigenvalues, vectors = np.linalg.eigh(scaled_information)
    has_information = eigenvalues > 1e-12
    inverse = (vectors[:, has_information] / eigenvalues[has_information]) @ vectors[:, has_information].T
    is_undetermined = (vectors[:, ~has_information] ** 2).sum(axis=1) > 1e-6
    sd = np.sqrt(np.diag(inverse)) / unit * np.abs(np.asarray(slope))
    # A parameter at its bound has no correlation.
    root = np.sqrt(np.where(np.diag(inverse) > 0, np.diag(inverse), 1.0))
    correlation = inverse / np.outer(root, root) * np.sign(np.outer(np.asarray(slope), np.asarray(slope)))
    return np.where(is_undetermined, np.nan, sd), correlation
