"""Filter for form errors: correlated deviations of known shape within a compiled program.

With whitened columns Φ, already multiplied by their standard deviations, the covariance of the whitened
residual is C = I + Φ Φᵀ. From the singular values s and left vectors U of Φ,

    C^(−1/2) v = v − U diag(1 − 1/√(1 + s²)) Uᵀ v.

Source: matrix inversion lemma; generalised least squares.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class FormFilter(eqx.Module):
    """Form errors of a dataset; a form error of size zero has columns of zeros.

    Attributes:
        columns: (r, 2, n) shapes, multiplied by their standard deviations, SI.
        white: (r, 2n) the same, whitened by the noise.
        vectors: (2n, r) orthonormal shapes, whitened.
        reduction: (r,) share by which each of them is reduced.
    """

    columns: Float[Array, "r 2 n"]
    white: Float[Array, "r m"]
    vectors: Float[Array, "m r"]
    reduction: Float[Array, " r"]

    @classmethod
    def from_columns(cls, columns: np.ndarray, white: np.ndarray) -> FormFilter:
        """Return the filter from columns, (r, 2, n), SI, and the whitened columns, (r, 2n)."""
        vectors, sizes, _ = np.linalg.svd(white.T, full_matrices=False)
        arrays = (columns, white, vectors, 1 - 1 / np.sqrt(1 + sizes**2))
        return cls(*(jnp.asarray(array) for array in arrays))

    def whiten(self, white: Float[Array, " m"]) -> Float[Array, " m"]:
        """Return residuals, (2n,), that are whitened by noise and form errors."""
        return white - self.vectors @ (self.reduction * (self.vectors.T @ white))

    def estimate_coefficients(self, white: np.ndarray) -> np.ndarray:
        """Return the posterior mean of the coefficients, (r,), from whitened residuals, (2n,)."""
        columns = np.asarray(self.white)
        return np.linalg.solve(np.eye(len(columns)) + columns @ columns.T, columns @ white)

    def estimate_form(self, white: np.ndarray) -> np.ndarray:
        """Return the posterior mean of the form errors, (2, n), SI, from whitened residuals, (2n,)."""
        return np.einsum("r,rcn->cn", self.estimate_coefficients(white), np.asarray(self.columns))
