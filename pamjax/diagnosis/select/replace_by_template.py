"""Replacement of mechanisms by a template of an effect outside the library.

Several mechanisms together can imitate such an effect. The best template is added to the model, to the models
with one mechanism less, and to the baseline. If the best of these is better than the model without a
template, mechanisms are removed one by one. The criterion −2 ln L + k ln n must stay below that of the model
without a template, and within the setting `tie_chi2` of its smallest value (`templates/template_fits.py`). A
mechanism that explained a part of the effect is often superfluous in a model with the template.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_refits import fit_without_mechanism, refit_baseline
from pamjax.diagnosis.select.selection import Selection, restrict_selection
from pamjax.diagnosis.templates.template_fits import TemplateFit, find_best_template_fits
from pamjax.diagnosis.templates.templates import TemplateBuilder
from pamjax.text import join_words


def replace_by_template(
    problem: LibraryProblem,
    training_mask: np.ndarray,
    selection: Selection,
    build_templates_at: TemplateBuilder,
) -> tuple[Selection, list[str]]:
    """Return the selection without the mechanisms that a template replaces, and a note on them.

    Args:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fit.
        selection: the mechanisms and their fit.
        build_templates_at: returns all templates at all coarse places.

    Returns:
        the selection itself and an empty list, if no template explains more.
    """
    if not selection.named_mechanisms:
        return selection, []
    # The same noise in all fits: its estimate differs between models with much misfit.
    fit = selection.model
    smaller_fits = _list_smaller_fits(problem, fit)
    if len(fit.mechanisms) > 1:
        smaller_fits.append(refit_baseline(problem, fit))
    with_template = find_best_template_fits(problem, build_templates_at, [fit, *smaller_fits])
    cost_without_template = add_form_errors(problem, fit).full_bic
    cheapest = min(with_template, key=lambda each: each.cost, default=None)
    if cheapest is None or cheapest.cost >= cost_without_template:
        return selection, []
    limit = min(cheapest.cost + problem.settings.tie_chi2, cost_without_template)
    better = _find_smallest(with_template, limit) or cheapest
    better = _remove_mechanisms(problem, build_templates_at, better, limit)
    if len(better.fit.mechanisms) == len(fit.mechanisms):
        # All mechanisms are also necessary with the template: the template is only a likeness.
        return selection, []
    named_mechanisms = [
        mechanism for mechanism in selection.named_mechanisms if mechanism.id in better.fit.ids
    ]
    ids = [
        f"`{mechanism.id}`" for mechanism in selection.named_mechanisms if mechanism not in named_mechanisms
    ]
    note = f"{better.template.description} explains the misfit better than {join_words(ids)}"
    return restrict_selection(problem, training_mask, selection, named_mechanisms), [
        f"{note[0].upper()}{note[1:]}."
    ]


def _list_smaller_fits(problem: LibraryProblem, fit: ModelFit) -> list[ModelFit]:
    """Return the fits without one of the mechanisms."""
    return [fit_without_mechanism(problem, fit, k) for k in range(len(fit.mechanisms))]


def _find_smallest(template_fits: Sequence[TemplateFit], limit: float) -> TemplateFit | None:
    """Return the fit with the fewest mechanisms, then of the smallest cost; None if none is below a limit."""
    return min(
        (each for each in template_fits if each.cost < limit),
        key=lambda each: (len(each.fit.mechanisms), each.cost),
        default=None,
    )


def _remove_mechanisms(
    problem: LibraryProblem, build_templates_at: TemplateBuilder, template_fit: TemplateFit, limit: float
) -> TemplateFit:
    """Return a fit with a template without the mechanisms that the template makes unnecessary."""
    smaller_fits = _list_smaller_fits(problem, template_fit.fit)
    smaller = _find_smallest(
        find_best_template_fits(problem, build_templates_at, smaller_fits, template_fit), limit
    )
    return (
        template_fit if smaller is None else _remove_mechanisms(problem, build_templates_at, smaller, limit)
    )
