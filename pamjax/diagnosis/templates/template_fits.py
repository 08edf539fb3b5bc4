"""Fits with a template, which compete with the fit of the selected mechanisms.

Several mechanisms together can imitate an effect outside the library, as a stop or a step of the force zero.
Such an effect is a template of known shape and unknown size. Models with fewer mechanisms and the best
template compete with the model without it. All have the form errors of their mechanisms, and are compared by

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
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_priors,
    evaluate_estimate,
    fit_parameters,
    transform_to_coordinates,
)
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.templates.templates import Template, TemplateBuilder
from pamjax.infer.form_errors.columns import build_columns_of_effect
from pamjax.infer.form_errors.discrepancy import (
    DiscrepancyNoise,
    add_discrepancy,
    build_free_columns,
    compute_free_column_cost,
)
from pamjax.infer.problem.unit_diagonal import invert_scaled

#: Largest number of moves of a template to a better place or to another family.
_MAX_TEMPLATE_MOVES = 6

#: Share of a template that the parameters must not imitate; a smaller one is rounding.
_MIN_FREE_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class TemplateFit:
    """A fit with one template.

    Attributes:
        fit: the mechanisms in it, without the template.
        template: the template.
        estimate: the estimate with the template.
        cost: −2 ln L + k ln n with the template, and the cost of its place.
    """

    fit: ModelFit
    template: Template
    estimate: MapEstimate
    cost: float

    def leaves_misfit(self, max_noise_chi2_sd: float) -> bool:
        """Return whether χ² exceeds that of noise by more than some standard deviations."""
        size = self.estimate.residual.size
        return self.estimate.chi2 - size > max_noise_chi2_sd * math.sqrt(2 * size)


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


def find_best_template_fits(
    problem: LibraryProblem,
    build_templates_at: TemplateBuilder,
    fits: Sequence[ModelFit],
    similar: TemplateFit | None = None,
) -> list[TemplateFit]:
    """Return for each fit the template with the smallest cost; empty if there is no template.

    A linear model selects a template for each fit. Far from the estimate it may select a wrong place, so each
    fit is also tried with the templates of the other fits. The shape of a template depends on the prediction.
    If misfit remains, the templates are therefore built again at the best estimate.

    Args:
        problem: the recording and the library.
        build_templates_at: returns all templates at all coarse places.
        fits: fits with different mechanisms.
        similar: a fit with more mechanisms and a template, from which the search starts too.
    """
    form_error_fits = parallel_map(lambda fit: add_form_errors(problem, fit), list(fits))
    if not fits:
        return []
    templates = build_templates_at((similar or fits[0]).estimate.values)
    starts = [] if similar is None else [similar.template]
    starts += [t for fit in form_error_fits if (t := _select_template(fit, templates)) is not None]
    starts = list({id(template): template for template in starts}.values())
    if not starts:
        return []

    def find_first(pair: tuple[ModelFit, ModelFit]) -> TemplateFit:
        best = starts[0]
        if len(starts) > 1:
            trials = [_fit_template(problem, template, *pair, is_rough=True) for template in starts]
            best = min(trials, key=lambda trial: trial.cost).template
        return _move_template(problem, templates, pair[1], _fit_template(problem, best, *pair))

    template_fits = parallel_map(find_first, list(zip(fits, form_error_fits, strict=True)))
    best = min(template_fits, key=lambda each: each.cost)
    if not best.leaves_misfit(problem.settings.max_noise_chi2_sd):
        return template_fits
    templates_at_best = build_templates_at(best.estimate.values)
    return parallel_map(
        lambda pair: _move_template(problem, templates_at_best, *pair),
        list(zip(form_error_fits, template_fits, strict=True)),
    )


def _select_template(fit: ModelFit, templates: Sequence[Template]) -> Template | None:
    """Return the template of the largest cost reduction in the linear model; None if none applies."""
    gains = compute_cost_reductions(fit, templates)
    return templates[int(np.argmax(gains))] if np.isfinite(gains).any() else None


def _move_template(
    problem: LibraryProblem, templates: Sequence[Template], form_error_fit: ModelFit, best: TemplateFit
) -> TemplateFit:
    """Return the fit with a better place or another family of its template, as long as the cost decreases.

    The linear model at the estimate with a template selects the next one.
    """
    for _ in range(_MAX_TEMPLATE_MOVES):
        linear_fit = _linearise_at(problem, form_error_fit, best.estimate)
        template = _select_template(linear_fit, [*templates, *best.template.refine()])
        if template is None or template is best.template:
            break
        moved = _fit_template(problem, template, best.fit, form_error_fit)
        if moved.cost >= best.cost:
            break
        best = moved
    return best


def _linearise_at(problem: LibraryProblem, fit: ModelFit, moved_estimate: MapEstimate) -> ModelFit:
    """Return a fit whose residual is linear in the parameters, with derivatives at another estimate.

    The residual is that of the linear model at its own minimum, without a template.
    """
    free, values = moved_estimate.free, moved_estimate.values
    estimate = evaluate_estimate(problem, fit.noise, free, values)
    mean, prior_sd = compute_priors(problem, free)
    prior_force = np.where(
        np.isfinite(prior_sd), (mean - transform_to_coordinates(problem, free, values)) / prior_sd**2, 0.0
    )
    jacobian = estimate.jacobian
    inverse, unit = invert_scaled(jacobian.T @ jacobian + np.diag(1 / estimate.prior_sd**2))
    step = inverse @ ((jacobian.T @ estimate.residual + prior_force) / unit) / unit
    residual = estimate.residual - jacobian @ step
    return replace(fit, estimate=replace(estimate, residual=residual, chi2=float(residual @ residual)))


def _fit_template(
    problem: LibraryProblem,
    template: Template,
    fit: ModelFit,
    form_error_fit: ModelFit,
    is_rough: bool = False,
) -> TemplateFit:
    """Return the fit with a template, refitted; a rough refit ends early and has no form error of it."""
    columns = build_free_columns(form_error_fit.noise, template.columns)
    noise = add_discrepancy(form_error_fit.noise, columns, [template.id] * len(columns))
    estimate = fit_parameters(
        problem,
        noise,
        fit.estimate.free,
        form_error_fit.estimate.values,
        problem.settings.rough_evaluations if is_rough else None,
        is_rough,
    )
    if not is_rough:
        noise, estimate = _add_form_error(problem, template, noise, estimate)
    cost = replace(fit, noise=noise, estimate=estimate).full_bic - compute_free_column_cost(len(columns))
    cost -= 2 * math.log(template.share)
    return TemplateFit(fit, template, estimate, cost)


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
    problem: LibraryProblem, build_templates_at: TemplateBuilder, fit: ModelFit
) -> tuple[Likeness, ...]:
    """Return the families of templates that the residual of a fit resembles, most probable first.

    A family is listed if it has the probability `min_likeness` and explains `min_likeness_excess_share`.
    """
    best_fits = find_best_template_fits(problem, build_templates_at, [fit])
    if not best_fits:
        return ()
    (best,) = best_fits
    templates = [*build_templates_at(best.estimate.values), *best.template.refine()]
    if best.template.description not in {template.description for template in templates}:
        templates.append(best.template)
    linear_fit = _linearise_at(problem, add_form_errors(problem, fit), best.estimate)
    explained = compute_explained_chi2(linear_fit, templates)
    gains = explained - _compute_penalties(linear_fit, templates)
    # What the best template leaves is misfit too, so the comparison counts in units of that of a sample.
    excess = max(best.estimate.chi2 - best.estimate.residual.size, 0.0)
    scale = 1 + excess / max(linear_fit.noise.sample_count, 1.0)
    probabilities = softmax(np.append(gains, 0.0) / (2 * scale))[:-1]
    settings, out = problem.settings, {}
    for k in np.argsort(-probabilities):
        id = templates[k].id
        total = sum(float(p) for p, other in zip(probabilities, templates, strict=True) if other.id == id)
        explains_enough = explained[k] >= settings.min_likeness_excess_share * linear_fit.excess_chi2
        if id not in out and total >= settings.min_likeness and explains_enough:
            out[id] = Likeness(id, min(total, 1.0), templates[k].description)
    return tuple(out.values())


def compute_cost_reductions(fit: ModelFit, templates: Sequence[Template]) -> np.ndarray:
    """Return by template the reduction of −2 ln L + k ln n in the linear model; −∞ where it has no effect."""
    return compute_explained_chi2(fit, templates) - _compute_penalties(fit, templates)


def _compute_penalties(fit: ModelFit, templates: Sequence[Template]) -> np.ndarray:
    """Return the cost of the columns and of the place of each template."""
    rows = math.log(fit.noise.sample_count)
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
