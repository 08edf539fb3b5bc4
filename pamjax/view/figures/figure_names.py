"""Figures of each result by name: one function for `fit.plot`, `diagnosis.plot` and the others.

A name is that of the figure's file, without suffix. Figures of one case of several begin with its name.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, singledispatch

from matplotlib.figure import Figure

from pamjax.diagnosis.result import Diagnosis
from pamjax.drawing import DrawableResult
from pamjax.errors import BadInput, suggest_word
from pamjax.explanation import Explanation
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.result import Posterior
from pamjax.model.registry import list_mechanisms
from pamjax.planning.plan import Plan
from pamjax.sizing.result import Design
from pamjax.view.figures.diagnosis import plot_candidates, plot_held_out_scores, plot_shifts
from pamjax.view.figures.diagnosis_loops import plot_explained_residuals, plot_loops
from pamjax.view.figures.diagnosis_steps import plot_steps
from pamjax.view.figures.fit import (
    plot_held_out,
    plot_prediction,
    plot_residual,
)
from pamjax.view.figures.fit_priors import plot_prior, select_with_prior
from pamjax.view.figures.mechanism import plot_mechanism
from pamjax.view.figures.misfit_map import list_other_channels, plot_map
from pamjax.view.figures.plan import PrecisionCourse, plot_commands, plot_precision
from pamjax.view.figures.posterior import find_ridges, plot_corner, plot_marginals, plot_ridges
from pamjax.view.figures.posterior_checks import plot_band, plot_profiles, plot_traces
from pamjax.view.figures.sizing import plot_chart, plot_front, plot_sensitivities
from pamjax.view.theme import escape_names

#: Function that draws a figure; its argument `narrow` is whether it is for one column.
PlotFunction = Callable[..., Figure | None]


def plot(result: DrawableResult, name: str | None = None, *, narrow: bool = False) -> Figure:
    """Return a figure of a result.

    Args:
        result: a `Fit`, a `Posterior`, a `Diagnosis`, a `Design`, a `Plan`, or the `Explanation` of a
            mechanism.
        name: name of the figure, one of `list_figures`; the first of them if omitted.
        narrow: draw for one column of a journal, with stacked panels.

    Returns:
        a matplotlib figure, which a notebook shows.

    Raises:
        BadInput: for an unknown name, or a result without figures.

    Example:
        fit = pamjax.fit("mine")
        pamjax.plot(fit, "residual").savefig("residual.png")
    """
    functions = _find_plot_functions(result)
    name = next(iter(functions)) if name is None else name
    if name not in functions:
        kind = type(result).__name__
        raise BadInput.from_rule(
            f"unknown figure of a {kind}", repr(name), remedy=suggest_word(name, functions)
        )
    figure = functions[name](narrow=narrow)
    if figure is None:
        raise BadInput.from_rule(
            f"the figure {name!r} has nothing to show", remedy=f"Draw {next(iter(functions))!r}."
        )
    escape_names(figure)
    return figure


def list_figures(result: DrawableResult) -> list[str]:
    """Return the names of the figures of a result, the most important one first.

    Args:
        result: a `Fit`, a `Posterior`, a `Diagnosis`, a `Design`, a `Plan`, or the `Explanation` of a
            mechanism.

    Returns:
        the names, for `plot`.

    Raises:
        BadInput: for a result without figures.

    Example:
        fit = pamjax.fit("mine")
        print(pamjax.list_figures(fit))
    """
    return list(_find_plot_functions(result))


@singledispatch
def _find_plot_functions(result: object) -> dict[str, PlotFunction]:
    """Return the functions that draw a result, by name of the figure."""
    rule = "`plot` needs a Fit, a Posterior, a Diagnosis, a Design, a Plan or an Explanation"
    remedy = "Pass the result of `fit`, `sample`, `diagnose`, `size`, `plan` or `explain`."
    raise BadInput.from_rule(rule, type(result).__name__, remedy=remedy)


@_find_plot_functions.register
def _(fit: Fit) -> dict[str, PlotFunction]:
    functions: dict[str, PlotFunction] = {}
    for case_fit in fit.cases:
        prefix = "" if len(fit.cases) == 1 else f"{case_fit.case.name}-"
        functions[f"{prefix}prediction"] = partial(plot_prediction, case_fit)
        functions[f"{prefix}residual"] = partial(plot_residual, case_fit)
        if case_fit.held_out_score is not None:
            functions[f"{prefix}held-out"] = partial(plot_held_out, case_fit)
    if select_with_prior(fit):
        functions["prior"] = partial(plot_prior, fit)
    return functions


@_find_plot_functions.register
def _(post: Posterior) -> dict[str, PlotFunction]:
    functions: dict[str, PlotFunction] = {
        "corner": partial(plot_corner, post),
        "marginals": partial(plot_marginals, post),
        "trace": partial(plot_traces, post),
    }
    if post.verdicts:
        functions["profile"] = partial(plot_profiles, post)
    if find_ridges(post):
        functions["ridge"] = partial(plot_ridges, post)
    for k, case_fit in enumerate(post.fit.cases):
        prefix = "" if len(post.fit.cases) == 1 else f"{case_fit.case.name}-"
        functions[f"{prefix}band"] = partial(plot_band, post, k)
    return functions


@_find_plot_functions.register
def _(diagnosis: Diagnosis) -> dict[str, PlotFunction]:
    functions: dict[str, PlotFunction] = {"map": partial(plot_map, diagnosis, None)}
    for channel in list_other_channels(diagnosis):
        functions[f"map-{diagnosis.problem.channels[channel]}"] = partial(plot_map, diagnosis, channel)
    functions["loops"] = partial(plot_loops, diagnosis)
    if diagnosis.named_mechanisms:
        functions["steps"] = partial(plot_steps, diagnosis)
        functions["residuals"] = partial(plot_explained_residuals, diagnosis)
    if diagnosis.held_out_errors.baseline_rmse:
        functions["held-out"] = partial(plot_held_out_scores, diagnosis)
    if diagnosis.parameter_shifts:
        functions["shifts"] = partial(plot_shifts, diagnosis)
    for mechanism in diagnosis.named_mechanisms:
        functions[f"candidates-{mechanism.id}"] = partial(plot_candidates, diagnosis, mechanism)
    return functions


@_find_plot_functions.register
def _(design: Design) -> dict[str, PlotFunction]:
    functions: dict[str, PlotFunction] = {"chart": partial(plot_chart, design)}
    if design.requirement_sensitivities:
        functions["sensitivities"] = partial(plot_sensitivities, design)
    if design.front is not None and len(design.front.values) > 1:
        functions["front"] = partial(plot_front, design)
    return functions


@_find_plot_functions.register
def _(plan: Plan) -> dict[str, PlotFunction]:
    functions: dict[str, PlotFunction] = {"precision": partial(_plot_precision, plan)}
    if plan.rows:
        functions["commands"] = partial(plot_commands, plan)
    return functions


@_find_plot_functions.register
def _(explanation: Explanation) -> dict[str, PlotFunction]:
    mechanisms = list_mechanisms()
    if explanation.name not in mechanisms:
        rule = "only the explanation of a mechanism has a figure"
        remedy = 'Draw one, as `pamjax.explain("braid_friction").plot()`.'
        raise BadInput.from_rule(rule, explanation.name or "that of everything", remedy=remedy)
    return {"effect": partial(plot_mechanism, mechanisms[explanation.name])}


def _plot_precision(plan: Plan, narrow: bool = False) -> Figure:
    return plot_precision(plan, PrecisionCourse.from_plan(plan), narrow)
