"""Form errors in a posterior: their coefficients are integrated out, and drawn after the parameters.

The filter of the noise (`ar1_likelihood.py`) converts the residual measured − equation into innovations e,
and the columns of the form errors into Φ. The columns contain their sizes, so that their coefficients are
c ~ N(0, I):

    M = I + ΦᵀΦ,    ĉ = M⁻¹ Φᵀ e
    ln ∫ p(e | c) p(c) dc = ln p(e | c = 0) + ½ ĉᵀ M ĉ − ½ ln det M
    c | parameters, data ~ N(ĉ, M⁻¹)

e and Φ are multiplied by the square root of the power of their channel's likelihood (`log_density.py`).

The sampler has the same parameters as without form errors. Given a draw of them, a draw of c is exact and
independent. So R̂ and effective sample size of the parameters hold for c as well.

Neglects: the change of the columns with the parameters of a draw, and the uncertainty of the sizes. Both are
those of the fit.

Source: Gaussian process with explicit basis functions, Rasmussen & Williams, Gaussian Processes for Machine
Learning (2006), ch. 2.7.
"""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cholesky, solve_triangular
from jaxtyping import Array, Float

from pamjax.infer.posterior.ar1_likelihood import Ar1Likelihood
from pamjax.infer.problem.form_filter import FormFilter


class FormColumns(eqx.Module):
    """Shapes of the form errors of a dataset.

    Attributes:
        columns: (r, 2, n) shapes, multiplied by their standard deviations, SI.
        owners: for each column, the id of its mechanism.
    """

    columns: Float[Array, "r 2 n"]
    owners: tuple[str, ...] = eqx.field(static=True)

    @property
    def count(self) -> int:
        """Return the number of columns, r; zero for exact equations."""
        return len(self.owners)

    @classmethod
    def from_filter(cls, form_filter: FormFilter | None, row_count: int) -> FormColumns:
        """Return the columns of a dataset that are not zero.

        Args:
            form_filter: form errors of the dataset; None for exact equations.
            row_count: number of its padded rows, n.
        """
        if form_filter is None:
            return cls(jnp.zeros((0, 2, row_count)), ())
        columns = np.asarray(form_filter.columns)
        kept = [k for k, column in enumerate(columns) if column.any()]
        return cls(jnp.asarray(columns[kept]), tuple(form_filter.owners[k] for k in kept))

    def compute_form(self, coefficients: Float[Array, " r"]) -> Float[Array, "2 n"]:
        """Return the form error of some coefficients, SI."""
        return jnp.einsum("r,rcn->cn", coefficients, self.columns)


class CoefficientDistribution(eqx.Module):
    """Distribution of the coefficients c of one dataset, given all parameters.

    Attributes:
        mean: (r,) ĉ.
        precision_root: (r, r) lower triangular root of M.
    """

    mean: Float[Array, " r"]
    precision_root: Float[Array, "r r"]

    @property
    def log_factor(self) -> Array:
        """Return ln of the likelihood with form errors over that without, at the same parameters."""
        root = self.precision_root.T @ self.mean
        return 0.5 * root @ root - jnp.sum(jnp.log(jnp.diag(self.precision_root)))

    def draw(self, normal: Float[Array, " r"]) -> Float[Array, " r"]:
        """Return a draw of c from independent standard normal values."""
        return self.mean + solve_triangular(self.precision_root.T, normal, lower=False)


def condition_coefficients(
    form: FormColumns,
    residual: Float[Array, "2 n"],
    likelihoods: Sequence[Ar1Likelihood],
    powers: Sequence[Array],
    values: Float[Array, " p"],
) -> CoefficientDistribution:
    """Return the distribution of the coefficients of one dataset.

    Args:
        form: the form errors.
        residual: measured − equation, SI; zero for a sample that is not informative.
        likelihoods: noise models of the channels.
        powers: powers of their likelihoods.
        values: all parameters of the posterior, SI.
    """
    innovations, columns = [], []
    for likelihood, power in zip(likelihoods, powers, strict=True):

        def whiten(misfit, likelihood=likelihood, power=power):
            return jnp.sqrt(power) * likelihood.standardise_innovations(misfit, values)[0]

        innovations.append(whiten(residual[likelihood.channel]))
        columns.append(jax.vmap(whiten)(form.columns[:, likelihood.channel]))
    white = jnp.concatenate(columns, axis=1)
    root = cholesky(jnp.eye(form.count) + white @ white.T, lower=True)
    half = solve_triangular(root, white @ jnp.concatenate(innovations), lower=True)
    return CoefficientDistribution(solve_triangular(root.T, half, lower=False), root)
