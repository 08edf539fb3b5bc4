"""Most likely sizes of form errors.

At an estimate x, the whitened residual r has the likelihood, with the Jacobian J and the priors N(m, s²),

    −2 ln L(ε) = min |r − J δ − Σ Φ_m c_m|² + |(x + δ − m) / s|² + Σ |c_m / ε_m|²
                 + ln det(I + Σ ε_m² Φ_m Φ_mᵀ)

over δ and c. Φ_m has the form error of mechanism m, ε_m its size as a share of the effect. Each ε_m is the
most likely of four shares.

Source: M. Kennedy & A. O'Hagan, J. R. Stat. Soc. B 63, 425 (2001).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.infer.problem.unit_diagonal import scale_to_unit_diagonal

#: Sizes of a form error that are compared, as shares of its largest size.
RELATIVE_SHARES = (0.0, 0.1, 1 / 3, 1.0)
#: Largest size of a form error, as a share of its effect.
MAX_FORM_SHARE = 0.3


class FormCost:
    """−2 ln L as a function of the shares, from products of all columns."""

    def __init__(
        self,
        residual: np.ndarray,
        jacobian: np.ndarray,
        prior_precision: np.ndarray,
        prior_deviation: np.ndarray,
        forms: Sequence[np.ndarray],
    ) -> None:
        """Compute the products.

        Args:
            residual: (size,) measured − model, whitened.
            jacobian: (size, k) derivative of the whitened prediction by the parameters.
            prior_precision: (k,) 1 / variance of the prior of each parameter.
            prior_deviation: (k,) parameter − mean of its prior.
            forms: by mechanism, (r, size) whitened columns of its form error at a share of one.
        """
        columns = np.concatenate([jacobian.T, *forms])
        self.sizes, self.parameter_precision = [len(form) for form in forms], prior_precision
        self.gram, self.projection = columns @ columns.T, columns @ residual
        self.projection[: prior_precision.size] -= prior_precision * prior_deviation

    def evaluate(self, shares: Sequence[float]) -> float:
        """Return −2 ln L up to a constant."""
        share_of_column = np.repeat(shares, self.sizes)
        count, used = self.parameter_precision.size, np.flatnonzero(share_of_column)
        sizes, form_rows = share_of_column[used], self.parameter_precision.size + used
        rows = np.concatenate([np.arange(count), form_rows])
        matrix = self.gram[np.ix_(rows, rows)] + np.diag(
            np.concatenate([self.parameter_precision, 1 / sizes**2])
        )
        scaled_matrix, unit = scale_to_unit_diagonal(matrix)
        projection = self.projection[rows] / unit
        explained = projection @ np.linalg.lstsq(scaled_matrix, projection, rcond=1e-12)[0]
        inflation = np.eye(used.size) + np.outer(sizes, sizes) * self.gram[np.ix_(form_rows, form_rows)]
        return float(np.linalg.slogdet(inflation)[1] - explained)


def choose_shares(cost: FormCost, max_share: float = MAX_FORM_SHARE) -> tuple[float, ...]:
    """Return the most likely share of each form error, one after the other.

    Args:
        cost: −2 ln L.
        max_share: largest share; zero assumes exact equations.
    """
    options = [share * max_share for share in RELATIVE_SHARES]
    shares = (0.0,) * len(cost.sizes)
    # Form errors of several mechanisms interact little: two rounds suffice.
    for _ in range(2 if len(shares) > 1 else 1):
        for k in range(len(shares)):
            shares = min(((*shares[:k], share, *shares[k + 1 :]) for share in options), key=cost.evaluate)
    return shares
