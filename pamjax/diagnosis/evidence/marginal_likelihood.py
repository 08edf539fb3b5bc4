"""Evidence of a model: its likelihood with all parameters integrated out (Laplace's approximation).

At the estimate x̂ the whitened residual r is linear in everything that is not known:

    r = J (x − x̂) + Σ_m Φ_m c_m + G g + e,      e ~ N(0, I),
    c_m ~ N(0, ε_m² I),   g ~ N(0, γ² I),   x ~ N(m, Λ⁻¹) with a finite prior, else of unit information,

J the Jacobian, Φ_m the columns of the form error of mechanism m at its estimated amplitude, G generic
physics: one of its families (`columns.py`) or all of them. In place of G g, a model can have one template
H h of unit information (`templates.py`).
With all columns X and their prior variances D,

    ln Z = −½ (rᵀr − bᵀ (D⁻¹ + XᵀX)⁻¹ b) − ½ ln det(I + D^½ XᵀX D^½),      b = Xᵀ r.

The form shares ε_m and the size γ are summed over their possible values. A parameter that switches a
mechanism on has a prior as wide as one sample determines it, or as its own estimate if that is larger; in the
quadratic form it is free.
Source: R. Kass & A. Raftery, J. Am. Stat. Assoc. 90, 773 (1995).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from pamjax.diagnosis.evidence.settings import EvidenceSettings

#: Relative size of the term that keeps a Cholesky factor positive.
JITTER = 1e-10

#: Most mechanisms with a form error for which all combinations of shares are summed.
MAX_ENUMERATED = 2


@dataclass(frozen=True, eq=False)
class OutsideColumns:
    """Columns of physics outside the library, whitened; the same for all models of a recording.

    Attributes:
        generic: (g, size) columns of generic physics, those of one family together of size one.
        families: rows of `generic` that belong to each family.
        templates: by template, (k, size) columns of any size.
        template_shares: share of each template in their prior probability.
    """

    generic: np.ndarray
    families: Sequence[slice] = (slice(None),)
    templates: Sequence[np.ndarray] = ()
    template_shares: Sequence[float] = ()

    @cached_property
    def all_columns(self) -> np.ndarray:
        """(g + k, size) all columns."""
        return np.concatenate([self.generic, *self.templates])

    @cached_property
    def gram(self) -> np.ndarray:
        """Products of all columns."""
        return self.all_columns @ self.all_columns.T

    @cached_property
    def generic_variances(self) -> np.ndarray:
        """(o, g) prior variances of the columns at a size of one: each family alone, then all together."""
        by_family = np.zeros((len(self.families), len(self.generic)))
        for variance, rows in zip(by_family, self.families, strict=True):
            variance[rows] = 1.0
        together = by_family.sum(axis=0, keepdims=True) / max(len(self.families), 1)
        return np.concatenate([by_family, together]) if len(by_family) > 1 else by_family

    @cached_property
    def template_slices(self) -> list[slice]:
        """Rows of each template in `all_columns`."""
        bounds = len(self.generic) + np.cumsum([0, *(len(block) for block in self.templates)])
        return [slice(a, b) for a, b in pairwise(bounds.tolist())]


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A model linearised at its estimate; all columns whitened.

    Attributes:
        residual: (size,) whitened residual.
        jacobian: (k, size) derivatives of the prediction by the coordinates of the free parameters.
        prior_offset: (k,) prior mean minus estimate in these coordinates, over the prior sd; zero without.
        prior_sd: (k,) sd of the priors; infinite without.
        is_amplitude: (k,) whether a parameter switches a mechanism on.
        amplitude: (k,) distance of the estimate from its neutral value, in coordinates.
        forms: by mechanism, (r, size) columns of its form error at a share of one.
        outside: physics outside the library.
    """

    residual: np.ndarray
    jacobian: np.ndarray
    prior_offset: np.ndarray
    prior_sd: np.ndarray
    is_amplitude: np.ndarray
    amplitude: np.ndarray
    forms: Sequence[np.ndarray]
    outside: OutsideColumns


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of a model alone, with generic physics, and with each template.

    Attributes:
        alone: ln Z times the prior probabilities, with nothing outside the library.
        with_generic: the same with generic physics.
        with_templates: (t,) the same with each template.
        generic_sd: (g,) most probable prior sds of the columns of generic physics.
        form_shares: most probable share of each mechanism's form error.
        form_coefficients: by mechanism, posterior means of the coefficients, with what is most probable
            outside the library.
        outside_mean_square: mean square of the estimated physics outside the library, whitened.
    """

    alone: float
    with_generic: float
    with_templates: np.ndarray
    generic_sd: np.ndarray
    form_shares: tuple[float, ...]
    form_coefficients: list[np.ndarray] = field(default_factory=list)
    outside_mean_square: float = 0.0

    @property
    def total(self) -> float:
        """ln Z with physics outside the library present or absent."""
        return _log_sum_exp([self.alone, self.with_generic, *self.with_templates])

    @property
    def outside_probability(self) -> float:
        """Probability, given the mechanisms, of physics outside the library."""
        return 1 - float(np.exp(self.alone - self.total))

    @property
    def best_template(self) -> int | None:
        """Index of the template, if one is more probable than its absence and than generic physics."""
        return _find_best_template(self.alone, self.with_generic, self.with_templates)

    @property
    def prefers_generic(self) -> bool:
        """Whether generic physics is more probable than its absence and than each template."""
        return self.best_template is None and self.with_generic > self.alone


def compute_evidence(model: LinearModel, mechanism_count: int, settings: EvidenceSettings) -> Evidence:
    """Return the evidence of a model.

    Args:
        model: the model at its estimate.
        mechanism_count: number of its mechanisms.
        settings: prior probabilities.
    """
    gram = _Gram(model)
    shares, log_weights = _enumerate_shares(gram, settings)
    log_z = np.array([gram.compute_log_z(share)[0] for share in shares]) + log_weights
    prior = mechanism_count * math.log(settings.mechanism_probability)
    none_probability = 1 - settings.generic_probability - settings.template_probability
    alone = _log_sum_exp(log_z) + prior + math.log(none_probability)
    best = shares[int(np.argmax(log_z))]
    offset = float(log_weights[int(np.argmax(log_z))]) + prior
    options = [
        size**2 * variance for variance in model.outside.generic_variances for size in settings.generic_sizes
    ]
    by_option = np.array([gram.compute_log_z(best, variance)[0] for variance in options])
    with_generic = (
        _log_sum_exp(by_option) - math.log(len(options)) + offset + math.log(settings.generic_probability)
    )
    weights = np.asarray(model.outside.template_shares) * settings.template_probability
    with_templates = gram.compute_template_log_z(best) + np.log(weights)
    generic_variance = options[int(np.argmax(by_option))]
    template = _find_best_template(alone, with_generic, with_templates + offset)
    present = generic_variance if template is None and with_generic > alone else None
    coefficients = gram.compute_log_z(best, present, template)[1]
    bounds = gram.parameter_count + np.cumsum([0, *gram.form_sizes])
    outside = coefficients[bounds[-1] :]
    return Evidence(
        alone=alone,
        with_generic=with_generic,
        with_templates=with_templates + offset,
        generic_sd=np.sqrt(generic_variance),
        form_shares=best,
        form_coefficients=[coefficients[a:b] for a, b in pairwise(bounds)],
        outside_mean_square=float(outside @ model.outside.gram @ outside) / max(model.residual.size, 1),
    )


def _find_best_template(alone: float, with_generic: float, with_templates: np.ndarray) -> int | None:
    if not len(with_templates):
        return None
    best = int(np.argmax(with_templates))
    return best if with_templates[best] > max(alone, with_generic) else None


def _log_sum_exp(values: Sequence[float] | np.ndarray) -> float:
    return float(np.asarray(logsumexp(values)))


def _enumerate_shares(gram: _Gram, settings: EvidenceSettings) -> tuple[list[tuple[float, ...]], np.ndarray]:
    """Return combinations of form shares and their log prior probabilities; the likely ones if many."""
    log_weight = dict(zip(settings.form_shares, np.log(settings.form_share_probabilities), strict=True))
    options = [settings.form_shares if size else (0.0,) for size in gram.form_sizes]

    def weigh(shares: tuple[float, ...]) -> float:
        return float(sum(log_weight[s] for s, size in zip(shares, gram.form_sizes, strict=True) if size))

    if sum(len(option) > 1 for option in options) <= MAX_ENUMERATED:
        combinations = list(product(*options))
    else:
        best = tuple(option[len(option) // 2] for option in options)
        for k, option in enumerate(options):
            trials = [(*best[:k], share, *best[k + 1 :]) for share in option]
            best = max(trials, key=lambda shares: gram.compute_log_z(shares)[0] + weigh(shares))
        combinations = [
            (*best[:k], share, *best[k + 1 :]) for k, option in enumerate(options) for share in option
        ]
        combinations = list(dict.fromkeys(combinations))
    return combinations, np.array([weigh(shares) for shares in combinations])


class _Gram:
    """Products of all columns, from which the evidence of any prior variances follows."""

    def __init__(self, model: LinearModel) -> None:
        self.outside = model.outside
        self.parameter_count = k = len(model.jacobian)
        self.form_sizes = [len(block) for block in model.forms]
        own = np.concatenate([model.jacobian, *model.forms])
        across = own @ model.outside.all_columns.T
        self.gram = np.block([[own @ own.T, across], [across.T, model.outside.gram]])
        self.projection = np.concatenate([own @ model.residual, model.outside.all_columns @ model.residual])
        self.size = model.residual.size
        has_prior = np.isfinite(model.prior_sd)
        prior_sd = np.where(has_prior, model.prior_sd, 1.0)
        precision = np.where(has_prior, 1 / prior_sd, 0.0)
        self.gram[np.arange(k), np.arange(k)] += precision**2
        self.projection[:k] += precision * model.prior_offset
        self.square = float(model.residual @ model.residual + model.prior_offset @ model.prior_offset)
        unit = self.size / np.maximum(np.einsum("ij,ij->i", model.jacobian, model.jacobian), 1e-200)
        wide = np.maximum(unit, model.amplitude**2)
        self.parameter_variance = np.where(
            model.is_amplitude, wide, np.where(has_prior, prior_sd**2, 1e6 * unit)
        )
        # A finite prior is part of the products already.
        self.identity = np.where(has_prior, 0.0, 1.0)

    def compute_log_z(
        self,
        shares: Sequence[float],
        generic_variance: np.ndarray | None = None,
        template: int | None = None,
    ) -> tuple[float, np.ndarray]:
        """Return ln Z and all coefficients.

        Args:
            shares: sizes of the form errors.
            generic_variance: (g,) prior variances of generic physics; zero if omitted.
            template: index of a template that is present.
        """
        indices, variance, is_free = self._select_columns(shares, generic_variance)
        if template is not None:
            rows = np.arange(len(self.gram))[self._get_rows(template)]
            indices, variance = (
                np.append(indices, rows),
                np.append(variance, self._get_template_variance(rows)),
            )
            is_free = np.append(is_free, np.ones(rows.size, dtype=bool))
        occam, quadratic, root = self._scale_products(indices, variance, is_free)
        b = self.projection[indices] * root
        solution = cho_solve(cho_factor(quadratic, lower=True), b)
        log_z = -0.5 * (self.square - float(b @ solution)) - 0.5 * float(np.linalg.slogdet(occam)[1])
        coefficients = np.zeros(len(self.gram))
        coefficients[indices] = solution * root
        return log_z, coefficients

    def compute_template_log_z(self, shares: Sequence[float]) -> np.ndarray:
        """Return ln Z with each template, (t,), by the Schur complement of all other columns."""
        indices, variance, is_free = self._select_columns(shares)
        occam, quadratic, root = self._scale_products(indices, variance, is_free)
        b, begin = self.projection[indices] * root, self.parameter_count + sum(self.form_sizes)
        across = self.gram[indices, begin:] * root[:, None]
        factor = cho_factor(quadratic, lower=True)
        solution_across, occam_across = cho_solve(factor, across), np.linalg.solve(occam, across)
        solution = cho_solve(factor, b)
        log_z = -0.5 * (self.square - float(b @ solution)) - 0.5 * float(np.linalg.slogdet(occam)[1])
        remaining = self.projection[begin:] - across.T @ solution
        out = np.empty(len(self.outside.templates))
        for k, rows in enumerate(self.outside.template_slices):
            own = self.outside.gram[rows, rows]
            if not np.diag(own).all():
                # The rows in use do not show this template.
                out[k] = -np.inf
                continue
            conditional = own - across[:, rows].T @ solution_across[:, rows]
            scale = np.sqrt(self._get_template_variance(np.arange(rows.start, rows.stop) + begin))
            wide = np.eye(len(own)) + np.outer(scale, scale) * (
                own - across[:, rows].T @ occam_across[:, rows]
            )
            conditional += JITTER * np.diag(np.diag(own))
            gain = float(remaining[rows] @ np.linalg.solve(conditional, remaining[rows]))
            out[k] = log_z + 0.5 * gain - 0.5 * float(np.linalg.slogdet(wide)[1])
        return out

    def _select_columns(
        self, shares: Sequence[float], generic_variance: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the indices in use, their prior variances, and which are free in the quadratic form."""
        forms = [np.full(size, share**2) for size, share in zip(self.form_sizes, shares, strict=True)]
        generic = np.zeros(len(self.outside.generic)) if generic_variance is None else generic_variance
        variance = np.concatenate([self.parameter_variance, *forms, generic])
        indices = np.flatnonzero(variance > 0)
        return indices, variance[indices], indices < self.parameter_count

    def _scale_products(
        self, indices: np.ndarray, variance: np.ndarray, is_free: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return I + D^½ XᵀX D^½, the same with free parameters, and the prior sds."""
        root = np.sqrt(variance)
        products = self.gram[np.ix_(indices, indices)] * np.outer(root, root)
        identity = np.ones(indices.size)
        is_parameter = indices < self.parameter_count
        identity[is_parameter] = self.identity[indices[is_parameter]]
        occam = products + np.diag(np.maximum(identity, 1e-12))
        # In the quadratic form a parameter without a prior is free.
        quadratic = products + np.diag(np.where(is_free, 1e-12, 1.0))
        quadratic += np.diag(JITTER * np.diag(quadratic))
        return occam, quadratic, root

    def _get_rows(self, template: int) -> slice:
        begin, rows = self.parameter_count + sum(self.form_sizes), self.outside.template_slices[template]
        return slice(begin + rows.start, begin + rows.stop)

    def _get_template_variance(self, rows: np.ndarray) -> np.ndarray:
        """Return the prior variance of template columns: as wide as one sample determines them."""
        return self.size / np.maximum(np.diag(self.gram)[rows], 1e-300)
