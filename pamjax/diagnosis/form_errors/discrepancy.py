"""A noise model with form errors: they are correlated deviations of known shape and unknown size.

With whitened columns Φ, already multiplied by their standard deviations, the covariance of the whitened
residual is C = I + Φ Φᵀ. From the singular values s and left vectors U of Φ,

    C^(−1/2) v = v − U diag(1 − 1/√(1 + s²)) Uᵀ v,      ln det C = Σ ln(1 + s²).

Source: matrix inversion lemma; generalised least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pamjax.infer.noise.noise_model import NoiseModel

#: Prior sd of a free column, in sizes that one sample determines.
FREE_COLUMN_SD = 10.0

#: Singular value below which a column has no effect.
MIN_SINGULAR_VALUE = 1e-6


@dataclass(frozen=True, eq=False)
class DiscrepancyNoise(NoiseModel):
    """Noise of a recording plus the form errors of a model.

    Attributes:
        vectors: (size, r) orthonormal shapes of the form errors, whitened.
        shrinkage: (r,) share by which each is reduced.
    """

    vectors: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    shrinkage: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Return values whitened by noise and form errors, (…, size); NaN stays NaN."""
        white = super().whiten(values)
        if not self.shrinkage.size:
            return white
        missing = ~np.isfinite(white)
        white_or_zero = np.where(missing, 0.0, white)
        out = white_or_zero - ((white_or_zero @ self.vectors) * self.shrinkage) @ self.vectors.T
        return np.where(missing, np.nan, out)

    def restrict_to_rows(self, mask: np.ndarray) -> NoiseModel:
        """Return the same noise model for the rows of a mask, (n,), only."""
        row_noise = super().restrict_to_rows(mask)
        is_kept = np.concatenate([mask[rows] for rows in self.rows])
        s = np.sqrt(1 / (1 - self.shrinkage) ** 2 - 1)
        plain = NoiseModel(row_noise.channels, row_noise.rows, row_noise.runs, row_noise.weight)
        return add_discrepancy(plain, (self.vectors[is_kept] * s).T) if s.size else row_noise

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the covariance, SI."""
        return super().log_determinant - 2 * float(np.sum(np.log1p(-self.shrinkage)))


def extend_discrepancy(noise: NoiseModel, columns: np.ndarray) -> DiscrepancyNoise:
    """Return a noise model with further columns, (r, size), already whitened by the noise as it is.

    A column v that the noise whitens to w is C^(1/2) w in the units of the noise of the recording alone.
    """
    if not (isinstance(noise, DiscrepancyNoise) and noise.shrinkage.size):
        return add_discrepancy(noise, columns)
    growth = 1 / (1 - noise.shrinkage)
    plain = columns + ((columns @ noise.vectors) * (growth - 1)) @ noise.vectors.T
    present = (noise.vectors * np.sqrt(growth**2 - 1)).T
    return add_discrepancy(noise, np.concatenate([present, plain]))


def add_discrepancy(noise: NoiseModel, columns: np.ndarray) -> DiscrepancyNoise:
    """Return the noise model with form errors.

    Args:
        noise: noise of the recording.
        columns: (r, size) whitened columns, multiplied by their standard deviations.
    """
    fields = {"channels": noise.channels, "rows": noise.rows, "runs": noise.runs, "weight": noise.weight}
    if not len(columns):
        return DiscrepancyNoise(**fields)
    vectors, s, _ = np.linalg.svd(columns.T, full_matrices=False)
    has_effect = s > MIN_SINGULAR_VALUE
    return DiscrepancyNoise(
        **fields, vectors=vectors[:, has_effect], shrinkage=1 - 1 / np.sqrt(1 + s[has_effect] ** 2)
    )


def build_free_columns(columns: np.ndarray) -> np.ndarray:
    """Return whitened columns, (r, size), scaled to a prior that leaves their sizes free."""
    information = np.maximum(np.einsum("ij,ij->i", columns, columns), 1e-300)
    return columns * (FREE_COLUMN_SD * np.sqrt(columns.shape[1] / information))[:, None]
