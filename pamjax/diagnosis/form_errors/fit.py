"""Refit with form errors: correlated noise in proportion to each effect, of the most likely size.

A real effect follows its textbook equation only to some 10 to 30 %. Without an allowance for this difference,
further mechanisms are added that fit it. The form error of mechanism m is Φ_m c_m with c_m ~ N(0, ε_m² I).
Each ε_m is the most likely of four shares (`infer/form_errors/shares.py`), from zero to the setting
`max_form_share`. Then Φ ε is part of the noise (`infer/form_errors/discrepancy.py`), and the parameters are
refitted.

Neglects: form errors that are not smooth in the declared variables of a mechanism.
Source: M. Kennedy & A. O'Hagan, J. R. Stat. Soc. B 63, 425 (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pamjax.diagnosis.form_errors.columns import build_coordinates, build_form_columns
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_priors,
    evaluate_estimate,
    find_parameters_at_limit,
    fit_parameters,
    transform_to_coordinates,
)
from pamjax.diagnosis.refit.memoise import memoise_per_fit
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.form_errors.discrepancy import add_discrepancy
from pamjax.infer.form_errors.shares import FormCost, choose_shares

#: Refits; the form errors are computed again before each, because they change with their effects.
ROUNDS = 2


@dataclass(frozen=True, eq=False)
class FormErrorFit(ModelFit):
    """A fit whose noise contains the form errors of its mechanisms.

    Attributes:
        shares: by mechanism id, the most likely size of its form error as a share of the effect; mechanisms
            without form error are absent.
        column_values: (p,) parameter values from which the columns of the form errors were built, SI.
    """

    shares: dict[str, float] = field(default_factory=dict)
    column_values: np.ndarray = field(default_factory=lambda: np.zeros(0))


@memoise_per_fit(lambda: None)
def add_form_errors(problem: LibraryProblem, fit: ModelFit) -> ModelFit:
    """Return the fit, refitted with the form errors of its mechanisms as noise.

    Args:
        problem: the recording and the library.
        fit: a fit of this recording without form errors; returned unchanged if its mechanisms have none.
    """
    coordinates, values, out = build_coordinates(problem), fit.estimate.values, fit
    for _ in range(ROUNDS):
        forms = {m.id: build_form_columns(problem, coordinates, values, m) for m in fit.mechanisms}
        white = {id: np.nan_to_num(fit.noise.whiten(f)) for id, f in forms.items() if len(f)}
        white = {id: columns for id, columns in white.items() if columns.any()}
        if not white:
            return fit
        estimate = evaluate_estimate(problem, fit.noise, fit.estimate.free, values)
        shares = estimate_form_shares(problem, estimate, list(white.values()))
        noise = add_discrepancy(
            fit.noise,
            np.concatenate([share * forms[id] for id, share in zip(white, shares, strict=True)]),
            [id for id in white for _ in forms[id]],
        )
        estimate = fit_parameters(
            problem, noise, fit.estimate.free, values, problem.settings.rough_evaluations
        )
        out = FormErrorFit(
            **{**vars(fit), "noise": noise, "estimate": estimate},
            shares=dict(zip(white, shares, strict=True)),
            column_values=values,
        )
        values = estimate.values
    return out


def estimate_form_shares(
    problem: LibraryProblem, estimate: MapEstimate, forms: Sequence[np.ndarray]
) -> tuple[float, ...]:
    """Return the most likely share of each form error, found in turn.

    Args:
        problem: the recording and the library.
        estimate: an estimate with the noise of the recording alone.
        forms: by mechanism, (r, size) whitened columns of its form error at a share of one.
    """
    return choose_shares(build_form_cost(problem, estimate, forms), problem.settings.max_form_share)


def build_form_cost(problem: LibraryProblem, estimate: MapEstimate, forms: Sequence[np.ndarray]) -> FormCost:
    """Return −2 ln L as a function of the shares; arguments as in `estimate_form_shares`.

    Parameters at a limit are fixed: beyond it, they would explain the residual in place of the form errors.
    """
    mean, _ = compute_priors(problem, estimate.free)
    deviation = transform_to_coordinates(problem, estimate.free, estimate.values) - mean
    inside = np.delete(np.arange(len(estimate.free)), find_parameters_at_limit(problem, estimate))
    return FormCost(
        estimate.residual,
        estimate.jacobian[:, inside],
        1 / estimate.prior_sd[inside] ** 2,
        deviation[inside],
        forms,
    )
