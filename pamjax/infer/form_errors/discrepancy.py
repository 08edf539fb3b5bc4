"""A noise model with form errors: they are correlated deviations of known shape and unknown size.

With whitened columns Φ, already multiplied by their standard deviations, the covariance of the whitened
residual is C = I + Φ Φᵀ. From the singular values s and left vectors U of Φ,

    C^(−1/2) v = v − U diag(1 − 1/√(1 + s²)) Uᵀ v,      ln det C = Σ ln(1 + s²).

Source: matrix inversion lemma; generalised least squares.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.form_filter import estimate_coefficients

#: Prior sd of a free column, in sizes that one sample determines.
_FREE_COLUMN_SD = 10.0

#: Singular value below which a column has no effect.
_MIN_SINGULAR_VALUE = 1e-6


@dataclass(frozen=True, eq=False)
class DiscrepancyNoise(NoiseModel):
    """Noise of a recording plus the form errors of a model.

    Attributes:
        columns: (r, 2, n) shapes of the form errors, multiplied by their standard deviations, SI.
        owners: for each column, the id of its mechanism or template.
    """

    columns: np.ndarray = field(default_factory=lambda: np.zeros((0, len(CHANNELS), 0)))
    owners: tuple[str, ...] = ()

    @cached_property
    def _shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the orthonormal shapes, whitened, (size, r), and their sizes, (r,)."""
        white = np.nan_to_num(NoiseModel.whiten(self, self.columns))
        vectors, sizes, _ = np.linalg.svd(white.T, full_matrices=False)
        has_effect = sizes > _MIN_SINGULAR_VALUE
        return vectors[:, has_effect], sizes[has_effect]

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Return values whitened by noise and form errors, (…, size); NaN stays NaN."""
        white = super().whiten(values)
        if not len(self.columns):
            return white
        vectors, sizes = self._shapes
        missing = ~np.isfinite(white)
        white_or_zero = np.where(missing, 0.0, white)
        reduction = 1 - 1 / np.sqrt(1 + sizes**2)
        out = white_or_zero - ((white_or_zero @ vectors) * reduction) @ vectors.T
        return np.where(missing, np.nan, out)

    @property
    def log_determinant(self) -> float:
        """Return the logarithm of the determinant of the covariance, SI."""
        sizes = self._shapes[1] if len(self.columns) else np.zeros(0)
        return super().log_determinant + float(np.sum(np.log1p(sizes**2)))

    def estimate_discrepancy(self, residual: np.ndarray, owner: str | None = None) -> np.ndarray:
        """Return the posterior mean of all form errors, or those of one owner, in a residual, (2, n), SI."""
        coefficients = self.estimate_coefficients(residual)
        if owner is not None:
            coefficients = np.where([other == owner for other in self.owners], coefficients, 0.0)
        return np.einsum("r,rcn->cn", coefficients, self.columns)

    def estimate_coefficients(self, residual: np.ndarray) -> np.ndarray:
        """Return the posterior mean of the coefficients of the columns, (r,), from a residual, (2, n), SI."""
        white = np.nan_to_num(NoiseModel.whiten(self, self.columns))
        return estimate_coefficients(white, np.nan_to_num(NoiseModel.whiten(self, residual)))

    def remove_columns(self, owners: Collection[str]) -> DiscrepancyNoise:
        """Return the noise without the form errors of some mechanisms."""
        kept = [k for k, owner in enumerate(self.owners) if owner not in owners]
        return replace(self, columns=self.columns[kept], owners=tuple(self.owners[k] for k in kept))


def add_discrepancy(noise: NoiseModel, columns: np.ndarray, owners: Sequence[str]) -> DiscrepancyNoise:
    """Return the noise model with further form errors.

    Args:
        noise: noise of the recording, with form errors or without.
        columns: (r, 2, n) shapes, multiplied by their standard deviations, SI.
        owners: for each column, the id of its mechanism or template.
    """
    if isinstance(noise, DiscrepancyNoise):
        columns = np.concatenate([noise.columns, columns])
        owners = (*noise.owners, *owners)
    inherited = {field.name: getattr(noise, field.name) for field in fields(NoiseModel)}
    return DiscrepancyNoise(**inherited, columns=columns, owners=tuple(owners))


def build_free_columns(noise: NoiseModel, columns: np.ndarray) -> np.ndarray:
    """Return columns, (r, 2, n), scaled to a prior that leaves their sizes free."""
    white = np.nan_to_num(noise.whiten(columns))
    information = np.maximum(np.einsum("ij,ij->i", white, white), 1e-300)
    scale = _FREE_COLUMN_SD * np.sqrt(noise.sample_count / information)
    return columns * scale[:, None, None]


def compute_free_column_cost(count: int) -> float:
    """Return what the width of their prior adds to −2 ln L of some free columns.

    Each costs ln(1 + n sd²): this much more than the ln n of a parameter in the BIC.
    """
    return 2 * count * math.log(_FREE_COLUMN_SD)
