"""Fit with form errors: their most likely sizes, and their part of the prediction.

The form error of a mechanism is Φ c with c ~ N(0, ε² I), see `infer/form_errors`. Each ε is the most likely
of four shares of the effect. Then Φ ε is part of the noise, and the parameters are fitted again.

Neglects: form errors that are not smooth in the declared variables of a mechanism. Without a time column and
without stated noise, all misfit counts as noise, and no form error is estimated.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.errors import BadInput
from pamjax.infer.fitting.least_squares import Solution, solve_least_squares
from pamjax.infer.form_errors.dataset_form import (
    build_dataset_form_source,
    build_form_columns,
    compute_raw_effect,
    compute_white_misfit,
    has_form_error,
    set_form_columns,
    whiten_columns,
)
from pamjax.infer.form_errors.form_model import FormErrorModel, build_form_error_model, is_transferable
from pamjax.infer.form_errors.parts import (
    FormErrorPart,
    build_form_part,
    compute_joint_covariance,
    compute_prediction_sd,
)
from pamjax.infer.form_errors.shares import FormCost, choose_shares
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.form_filter import estimate_coefficients
from pamjax.infer.problem.informative_samples import get_stated_sds
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.jit import compile_on_call
from pamjax.records.case import Case

#: Refits; the form errors are computed again before each, because they change with effects and noise.
_FORM_ERROR_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class FormSizes:
    """Sizes of the form errors of one dataset.

    Attributes:
        shares: by mechanism, the size as a share of the effect.
        values: (p,) parameter values from which the columns were built, SI.
    """

    shares: dict[str, float]
    values: Float[Array, " p"]


#: Function that estimates the noise of all datasets from the residuals of a solution.
Reweight = Callable[[tuple[Dataset, ...], Solution], tuple[Dataset, ...]]


def check_form_errors(mechanisms: Sequence[str], loss: str) -> None:
    """Refuse a fit with form errors whose mechanisms have none, or whose loss is not a likelihood."""
    if not any(map(has_form_error, mechanisms)):
        got = ", ".join(mechanisms) or "no mechanism"
        rule = "a form error needs a mechanism whose equation may be inexact"
        raise BadInput.from_rule(rule, got, "", 'Include one, for example `mechanisms=["braid_friction"]`.')
    if loss != "square":
        rule, remedy = "a form error needs a likelihood", 'Use `loss="square"`, or remove the outliers.'
        raise BadInput.from_rule(rule, f"a {loss} loss", "", remedy)


def fit_form_errors(
    cases: Sequence[Case],
    datasets: tuple[Dataset, ...],
    space: ParameterSpace,
    solution: Solution,
    reweight: Reweight,
) -> tuple[tuple[Dataset, ...], list[FormSizes], Solution]:
    """Return the datasets with form errors, their sizes for each dataset, and the solution.

    Args:
        cases: the recordings.
        datasets: their datasets, without form errors.
        space: the free parameters.
        solution: the solution without form errors.
        reweight: estimates the noise; the form errors are then no part of the residual.
    """
    # Noise that was estimated from the residual may contain the form errors.
    datasets = tuple(map(_trust_stated_noise, cases, datasets))
    shares: list[dict[str, float]] = [{} for _ in datasets]
    values = space.to_values(solution.u)
    for _ in range(_FORM_ERROR_ROUNDS):
        values = space.to_values(solution.u)
        columns = [_build_columns(*pair, values) for pair in zip(cases, datasets, strict=True)]
        shares = _estimate_shares(datasets, space, solution, columns)
        datasets = tuple(
            set_form_columns(
                dataset,
                np.concatenate([of[id] * own[id] for id in of]),
                [id for id in of for _ in of[id]],
            )
            for dataset, of, own in zip(datasets, columns, shares, strict=True)
        )
        solution = solve_least_squares(datasets, space, solution.u)
        datasets = reweight(datasets, solution)
    sizes = [FormSizes(of, values) for of in shares]
    return datasets, sizes, solve_least_squares(datasets, space, solution.u)


def _trust_stated_noise(case: Case, dataset: Dataset) -> Dataset:
    weights = [
        1.0 if sd else float(weight)
        for sd, weight in zip(get_stated_sds(case), dataset.channel_weights, strict=True)
    ]
    return dataclasses.replace(dataset, channel_weights=jnp.asarray(weights))


def _build_columns(case: Case, dataset: Dataset, values: Float[Array, " p"]) -> dict[str, np.ndarray]:
    return {
        id: build_form_columns(case, dataset, values, id) for id in dataset.mechanisms if has_form_error(id)
    }


def _estimate_shares(
    datasets: tuple[Dataset, ...],
    space: ParameterSpace,
    solution: Solution,
    columns: Sequence[dict[str, np.ndarray]],
) -> list[dict[str, float]]:
    """Return the most likely share of each form error, by mechanism for each dataset."""
    values = space.to_values(solution.u)
    residual = np.concatenate([compute_white_misfit(dataset, values) for dataset in datasets])
    jacobian = np.concatenate(
        [_whiten_derivatives(dataset, space, solution.u)[1] for dataset in datasets], axis=1
    )
    keys = [(k, id) for k, of in enumerate(columns) for id in of]
    ends = np.cumsum([0, *(2 * dataset.rows.pressure.size for dataset in datasets)])
    forms = []
    for k, id in keys:
        form = np.zeros((len(columns[k][id]), residual.size))
        form[:, ends[k] : ends[k + 1]] = whiten_columns(datasets[k], jnp.asarray(columns[k][id]))
        forms.append(form)
    # Beyond its limit, a parameter would explain the residual in place of the form errors.
    at_bound = space.find_names_at_bound(solution.u)
    inside = [k for k, name in enumerate(space.names) if name not in at_bound]
    precision, deviation = (part[inside] for part in _linearise_prior(space, solution.u))
    chosen = choose_shares(FormCost(residual, jacobian[inside].T, precision, deviation, forms))
    out: list[dict[str, float]] = [{} for _ in datasets]
    for (k, id), share in zip(keys, chosen, strict=True):
        out[k][id] = share
    return out


def _linearise_prior(space: ParameterSpace, u: Float[Array, " p"]) -> tuple[np.ndarray, np.ndarray]:
    """Return precision and deviation of the prior of each coordinate, (p,) each."""
    slope = np.asarray(jax.jvp(space.compute_prior_residual, (u,), (jnp.ones_like(u),))[1])
    residual = np.asarray(space.compute_prior_residual(u))
    return slope**2, residual / np.where(slope == 0, 1.0, slope)


def _whiten_derivatives(
    dataset: Dataset, space: ParameterSpace, u: Float[Array, " p"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives of the prediction by the coordinates, SI, (p, 2, n), and whitened, (p, 2n)."""
    derivatives = jnp.nan_to_num(_compute_derivatives(dataset, space, u))
    return np.asarray(derivatives), np.asarray(whiten_columns(dataset, derivatives))


@compile_on_call
def _compute_derivatives(
    dataset: Dataset, space: ParameterSpace, u: Float[Array, " p"]
) -> Float[Array, "p 2 n"]:
    derivatives = jax.jacfwd(lambda v: dataset.predict_channels(space.to_values(v)))(u)
    return jnp.moveaxis(derivatives, -1, 0)


@dataclass(frozen=True, eq=False)
class FormDescription:
    """Form errors of one case.

    Attributes:
        parts: form error of each mechanism.
        prediction_sd: (2, n) sd of the prediction, SI.
        model: form errors for other recordings; None if there are none.
    """

    parts: dict[str, FormErrorPart]
    prediction_sd: np.ndarray
    model: FormErrorModel | None


def describe_form_errors(
    case: Case, dataset: Dataset, space: ParameterSpace, solution: Solution, sizes: FormSizes
) -> FormDescription:
    """Return the form errors of a case, the sd of its prediction, and the form errors for other recordings.

    Args:
        case: the recording and its muscle.toml.
        dataset: its dataset, with form errors.
        space: the free parameters.
        solution: the solution.
        sizes: the sizes of the form errors.
    """
    assert dataset.form_filter is not None
    n, values = case.recording.n, space.to_values(solution.u)
    misfit, parts = compute_white_misfit(dataset, values), {}
    for id, share in sizes.shares.items():
        form = dataset.form_filter.estimate_form(misfit, id)
        effect = compute_raw_effect(dataset, values, id)
        form_white, effect_white = np.asarray(whiten_columns(dataset, jnp.asarray(np.stack([form, effect]))))
        parts[id] = build_form_part(
            share, form[:, :n], effect[:, :n], form_white, effect_white, dataset.rows.weights[:, :n] > 0
        )
    columns = np.asarray(dataset.form_filter.columns)
    derivatives, derivatives_white = _whiten_derivatives(dataset, space, solution.u)
    white = np.asarray(dataset.form_filter.white)
    inflation = 1.0 if dataset.whitening is None else float(dataset.whitening.variance_inflation)
    joint_white = np.concatenate([derivatives_white, white]) / math.sqrt(inflation)
    precision = np.concatenate([_linearise_prior(space, solution.u)[0], np.ones(len(columns))])
    sd = compute_prediction_sd(np.concatenate([derivatives, columns]), joint_white, precision)
    return FormDescription(
        parts,
        sd[:, :n],
        _build_model(
            case,
            dataset,
            values,
            sizes,
            estimate_coefficients(white, misfit),
            compute_joint_covariance(joint_white, precision),
            np.asarray(solution.slope),
        ),
    )


def _build_model(
    case: Case,
    dataset: Dataset,
    values: Float[Array, " p"],
    sizes: FormSizes,
    coefficients: np.ndarray,
    covariance: np.ndarray,
    slope: np.ndarray,
) -> FormErrorModel | None:
    """Return the form errors for other recordings.

    Args:
        case, dataset, values, sizes: recording, dataset, parameter values and sizes of the form errors.
        coefficients: (r,) estimated coefficients of the columns.
        covariance: (p + r, p + r) of the coordinates of the parameters and of the coefficients.
        slope: (p,) derivative of value by coordinate.
    """
    # Form errors of a measured length are no forces, and `validate` and `simulate` predict forces.
    if case.recording.measures_length:
        return None
    assert dataset.form_filter is not None
    indices = [index for _, index in dataset.free_parameters]
    kept = np.concatenate([indices, np.arange(slope.size, len(covariance))]).astype(int)
    unit = np.concatenate([slope[indices], np.ones(coefficients.size)])
    return build_form_error_model(
        dataset.law,
        dataset.mechanisms,
        _collect_numbers(dataset, values),
        _collect_numbers(dataset, sizes.values),
        [name for name, _ in dataset.free_parameters],
        {
            id: build_dataset_form_source(case, dataset, sizes.values, id, share)
            for id, share in sizes.shares.items()
            if is_transferable(id, share)
        },
        dataset.form_filter.owners,
        coefficients,
        covariance[np.ix_(kept, kept)] * np.outer(unit, unit),
    )


def _collect_numbers(dataset: Dataset, values: Float[Array, " p"]) -> dict[str, float]:
    return {name: float(number) for name, number in dataset.collect_parameters(values).items()}
