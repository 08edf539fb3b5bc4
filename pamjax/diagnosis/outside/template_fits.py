"""Fits with a template, which compete with the fit of the selected mechanisms.

Several mechanisms together can imitate an effect outside the library, as a stop or a step of the force zero.
Such an effect is a template of known shape and unknown size. Each mechanism of a set, and all of them, are
replaced by the best template. Both models have the form errors of their mechanisms, and are compared by

    −2 ln L + k ln n,

with k parameters that are not the baseline's, n samples, and the columns of the template as noise with a wide
prior. A template at one of N places counts as ln N² worse.

Source: G. Schwarz, Ann. Stat. 6, 461 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.form_errors.columns import build_coordinates
from pamjax.diagnosis.form_errors.fit import add_form_errors, estimate_form_shares
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.outside.templates import Template
from pamjax.diagnosis.refit.least_squares import MapEstimate, fit_parameters
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.form_errors.columns import build_columns_of_effect
from pamjax.infer.form_errors.discrepancy import (
    DiscrepancyNoise,
    add_discrepancy,
    build_free_columns,
    compute_free_column_cost,
)
from pamjax.infer.problem.unit_diagonal import invert_scaled

#: Share of a template that the parameters must not imitate; a smaller one is rounding.
_MIN_FREE_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class TemplateFit:
    """A fit with one template.

    Attributes:
        fit: the mechanisms in it, without the template.
        template: the template.
        cost: −2 ln L + k ln n with the template, and the cost of its place.
    """

    fit: ModelFit
    template: Template
    cost: float


@dataclass(frozen=True)
class Likeness:
    """An effect outside the library that the unexplained part resembles.

    Attributes:
        id: family of the effect.
        probability: that it is this effect, if something outside the library is present.
        description: the effect with its place, as "a step of the force zero after 120 s".
    """

    id: str
    probability: float
    description: str


def find_best_template_fit(
    problem: LibraryProblem,
    templates: Sequence[Template],
    fits: Sequence[ModelFit],
    max_cost: float,
) -> TemplateFit | None:
    """Return the model with a template of the smallest cost; None if no cost is below the maximum.

    Args:
        problem: the recording and the library.
        templates: all templates at all places.
        fits: fits with different mechanisms; the best template is added to each.
        max_cost: −2 ln L + k ln n of the model that they compete with.
    """
    template_fits = parallel_map(lambda fit: _fit_best_template(problem, templates, fit), list(fits))
    better = [each for each in template_fits if each is not None and each.cost < max_cost]
    return min(better, key=lambda each: each.cost) if better else None


def _fit_best_template(
    problem: LibraryProblem, templates: Sequence[Template], fit: ModelFit
) -> TemplateFit | None:
    """Return the fit with the template that explains most of its residual; None if no template applies."""
    form_error_fit = add_form_errors(problem, fit)
    gains = compute_cost_reductions(form_error_fit, templates)
    if not np.isfinite(gains).any():
        return None
    best = templates[int(np.argmax(gains))]
    columns = build_free_columns(form_error_fit.noise, best.columns)
    noise = add_discrepancy(form_error_fit.noise, columns, [best.id] * len(columns))
    estimate = fit_parameters(problem, noise, fit.estimate.free, form_error_fit.estimate.values)
    noise, estimate = _add_form_error(problem, best, noise, estimate)
    cost = replace(fit, noise=noise, estimate=estimate).full_bic - compute_free_column_cost(len(columns))
    cost -= 2 * math.log(best.share)
    return TemplateFit(fit, best, cost)


def _add_form_error(
    problem: LibraryProblem, template: Template, noise: DiscrepancyNoise, estimate: MapEstimate
) -> tuple[DiscrepancyNoise, MapEstimate]:
    """Return noise and estimate with the form error of a template, of the most likely size."""
    if not template.form_error.terms:
        return noise, estimate
    effect = noise.estimate_discrepancy(problem.measured - problem.predict(estimate.values), template.id)
    forms = build_columns_of_effect(template.form_error, build_coordinates(problem), effect)
    (share,) = estimate_form_shares(problem, estimate, [np.nan_to_num(noise.whiten(forms))])
    if not share:
        return noise, estimate
    noise = add_discrepancy(noise, share * forms, [template.id] * len(forms))
    return noise, fit_parameters(problem, noise, estimate.free, estimate.values)


def list_likenesses(
    problem: LibraryProblem, templates: Sequence[Template], fit: ModelFit
) -> tuple[Likeness, ...]:
    """Return the families of templates that the residual of a fit resembles, most probable first.

    A family is listed if it has the probability `min_likeness` and explains `min_likeness_excess_share`.
    """
    settings, form_error_fit = problem.settings, add_form_errors(problem, fit)
    explained = compute_explained_chi2(form_error_fit, templates)
    gains = explained - _compute_penalties(form_error_fit, templates)
    scale = max(form_error_fit.estimate.chi2 / max(form_error_fit.noise.size, 1), 1.0)
    probabilities = softmax(np.append(gains, 0.0) / (2 * scale))[:-1]
    out: dict[str, Likeness] = {}
    for k in np.argsort(-probabilities):
        template = templates[k]
        total = sum(
            float(p) for p, other in zip(probabilities, templates, strict=True) if other.id == template.id
        )
        if template.id not in out and total >= settings.min_likeness:
            if explained[k] < settings.min_likeness_excess_share * form_error_fit.excess_chi2:
                continue
            out[template.id] = Likeness(template.id, total, template.description)
    return tuple(out.values())


def compute_cost_reductions(fit: ModelFit, templates: Sequence[Template]) -> np.ndarray:
    """Return by template the reduction of −2 ln L + k ln n in the linear model; −∞ where it has no effect."""
    return compute_explained_chi2(fit, templates) - _compute_penalties(fit, templates)


def _compute_penalties(fit: ModelFit, templates: Sequence[Template]) -> np.ndarray:
    """Return the cost of the columns and of the place of each template."""
    rows = math.log(fit.noise.size)
    return np.array([len(each.columns) * rows - 2 * math.log(each.share) for each in templates])


def compute_explained_chi2(fit: ModelFit, templates: Sequence[Template]) -> np.ndarray:
    """Return by template the reduction of χ² with priors in the linear model; −∞ where it has no effect."""
    jacobian = fit.estimate.jacobian
    information = jacobian.T @ jacobian + np.diag(1 / fit.estimate.prior_sd**2)
    covariance, unit = invert_scaled(information)
    explained = np.full(len(templates), -np.inf)
    for k, template in enumerate(templates):
        columns = np.nan_to_num(fit.noise.whiten(template.columns))
        gram, cross_gram = columns @ columns.T, (columns @ jacobian) / unit
        # The part of the columns that the parameters do not absorb.
        remaining_gram = gram - cross_gram @ covariance @ cross_gram.T
        if np.all(np.diag(gram) > 0) and np.all(np.diag(remaining_gram) > _MIN_FREE_SHARE * np.diag(gram)):
            projection = columns @ fit.estimate.residual
            explained[k] = projection @ np.linalg.lstsq(remaining_gram, projection, rcond=1e-9)[0]
    return explained
