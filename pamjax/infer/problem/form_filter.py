"""Filter for form errors: correlated deviations of known shape within a compiled program.

With whitened columns Φ, already multiplied by their standard deviations, the covariance of the whitened
residual is C = I + Φ Φᵀ. From the singular values s and left vectors U of Φ,

    C^(−1/2) v = v − U diag(1 − 1/√(1 + s²)) Uᵀ v.

Source: matrix inversion lemma; generalised least squares.
"""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def estimate_coefficients(columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return the posterior mean of the coefficients c ~ N(0, I) of some columns, (r,).

    Args:
        columns: (r, m) whitened columns.
        residual: (m,) whitened residual.
    """
    return np.linalg.solve(np.eye(len(columns)) + columns @ columns.T, columns @ residual)


class FormFilter(eqx.Module):
    """Form errors of a dataset; a form error of size zero has columns of zeros.

    Attributes:
        columns: (r, 2, n) shapes, multiplied by their standard deviations, SI.
        white: (r, 2n) the same, whitened by the noise.
        vectors: (2n, r) orthonormal shapes, whitened.
        reduction: (r,) share by which each of them is reduced.
        owners: for each column, the id of its mechanism.
    """

    columns: Float[Array, "r 2 n"]
    white: Float[Array, "r m"]
    vectors: Float[Array, "m r"]
    reduction: Float[Array, " r"]
    owners: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def from_columns(cls, columns: np.ndarray, white: np.ndarray, owners: Sequence[str]) -> FormFilter:
        """Return the filter from columns, (r, 2, n), SI, the whitened columns, (r, 2n), and their owners."""
        vectors, sizes, _ = np.linalg.svd(white.T, full_matrices=False)
        return cls(
            columns=jnp.asarray(columns),
            white=jnp.asarray(white),
            vectors=jnp.asarray(vectors),
            reduction=jnp.asarray(1 - 1 / np.sqrt(1 + sizes**2)),
            owners=tuple(owners),
        )

    def whiten(self, white: Float[Array, " m"]) -> Float[Array, " m"]:
        """Return residuals, (2n,), that are whitened by noise and form errors."""
        return white - self.vectors @ (self.reduction * (self.vectors.T @ white))

    def estimate_form(self, white: np.ndarray, owner: str | None = None) -> np.ndarray:
        """Return the posterior mean of all form errors, or those of one owner, (2, n), SI.

        Args:
            white: (2n,) whitened residuals.
            owner: id of a mechanism.
        """
        coefficients = estimate_coefficients(np.asarray(self.white), white)
        if owner is not None:
            coefficients = np.where([other == owner for other in self.owners], coefficients, 0.0)
        return np.einsum("r,rcn->cn", coefficients, np.asarray(self.columns))
