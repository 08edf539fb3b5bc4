"""Form errors of the mechanisms of a dataset: their columns, and their estimate from a residual."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.infer.form_errors.columns import build_columns_of_effect
from pamjax.infer.form_errors.coordinates import Coordinates, CoordinateScales
from pamjax.infer.form_errors.form_source import FormSource, build_form_source
from pamjax.infer.problem.dataset import Dataset, compute_si_misfit, predict_row_channels
from pamjax.infer.problem.form_filter import FormFilter
from pamjax.jit import compile_on_call
from pamjax.model.registry import find_mechanism
from pamjax.parameter import list_field_meanings
from pamjax.records.case import Case


def has_form_error(id: str) -> bool:
    """Return whether the equation of a mechanism may be inexact."""
    form_error = find_mechanism(id).form_error
    return bool(form_error.terms or form_error.shape_factors)


def compute_raw_effect(dataset: Dataset, values: Float[Array, " p"], id: str) -> np.ndarray:
    """Return what a mechanism changes in the prediction, (2, n), SI; zero where a state has no answer."""
    without = predict_row_channels(*remove_effect(dataset, values, id))
    return np.nan_to_num(predict_row_channels(dataset, values) - without)


def remove_effect(
    dataset: Dataset, values: Float[Array, "*draws p"], id: str
) -> tuple[Dataset, Float[Array, "*draws p"]]:
    """Return dataset and values, SI, with the parameters of a mechanism at their neutral values."""
    neutral = {
        field: meaning.neutral
        for field, meaning in list_field_meanings(find_mechanism(id)).items()
        if meaning.neutral is not None
    }
    return _replace_parameters(dataset, values, id, neutral)


def build_form_columns(case: Case, dataset: Dataset, values: Float[Array, " p"], id: str) -> np.ndarray:
    """Return the columns of a mechanism's form error, (r, 2, n), SI, each of the rms of the effect / √r.

    Args:
        case: the recording and its muscle.toml.
        dataset: its dataset; the columns of its padded rows are zero.
        values: (p,) parameter values, SI.
        id: the mechanism.
    """
    form_error = find_mechanism(id).form_error
    effect, reshaped_effects, _ = _compute_effects(case, dataset, values, id)
    columns = build_columns_of_effect(form_error, build_coordinates(case, dataset), effect, reshaped_effects)
    return np.pad(columns, ((0, 0), (0, 0), (0, dataset.rows.pressure.size - case.recording.n)))


def build_dataset_form_source(
    case: Case, dataset: Dataset, values: Float[Array, " p"], id: str, share: float
) -> FormSource:
    """Return the constants of the columns of a mechanism's form error; arguments as of `build_form_columns`.

    Args:
        case, dataset, values, id: as of `build_form_columns`.
        share: size of the form error, as a share of the effect.
    """
    effect, reshaped_effects, reshaped_values = _compute_effects(case, dataset, values, id)
    limits = CoordinateScales.from_recording(case.recording, *_find_compared_rows(case, dataset))
    return build_form_source(
        find_mechanism(id).form_error,
        case.recording,
        limits,
        build_coordinates(case, dataset),
        effect,
        reshaped_effects,
        reshaped_values,
        share,
    )


def build_coordinates(case: Case, dataset: Dataset) -> Coordinates:
    """Return the variables of the form errors at each row of the recording."""
    return Coordinates.from_recording(case.recording, *_find_compared_rows(case, dataset))


def _find_compared_rows(case: Case, dataset: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return whether a row has a compared sample, and its rate of change of the length (m/s), (n,) each."""
    rows, n = dataset.rows, case.recording.n
    is_compared = np.asarray((rows.force_weight > 0) | (rows.diameter_weight > 0))[:n]
    return is_compared, np.asarray(dataset.history.rate(rows.length))[:n]


def _compute_effects(
    case: Case, dataset: Dataset, values, id: str
) -> tuple[np.ndarray, list[np.ndarray], list[dict[str, float]]]:
    """Return the effect of a mechanism, (2, n), those with other shapes, and their shape parameters, SI."""
    n = case.recording.n
    reshaped_values = [
        _scale_shape(dataset, values, id, factors) for factors in find_mechanism(id).form_error.shape_factors
    ]
    reshaped_effects = [
        compute_raw_effect(*_replace_parameters(dataset, values, id, shape), id)[:, :n]
        for shape in reshaped_values
    ]
    return compute_raw_effect(dataset, values, id)[:, :n], reshaped_effects, reshaped_values


def _scale_shape(dataset: Dataset, values, id: str, factors: Mapping[str, float]) -> dict[str, float]:
    """Return some parameters of a mechanism, multiplied within their limits, by field, SI."""
    numbers, meanings = dataset.collect_parameters(values), list_field_meanings(find_mechanism(id))
    return {
        field: float(
            np.clip(float(numbers[f"{id}.{field}"]) * factor, meanings[field].low, meanings[field].high)
        )
        for field, factor in factors.items()
    }


def _replace_parameters(dataset: Dataset, values, id: str, new: Mapping[str, float]):
    """Return dataset and values with other parameters of a mechanism, by field."""
    indices, fixed_values = dict(dataset.free_parameters), dict(dataset.fixed_values)
    for field, value in new.items():
        name = f"{id}.{field}"
        if name in indices:
            values = values.at[..., indices[name]].set(value)
        else:
            fixed_values[name] = jnp.asarray(value)
    return dataclasses.replace(dataset, fixed_values=fixed_values), values


@compile_on_call
def whiten_columns(dataset: Dataset, columns: Float[Array, "k 2 n"]) -> Float[Array, "k m"]:
    """Return columns, SI, whitened by the noise of a dataset; zero where not measured."""
    rows = dataset.rows

    def whiten(column):
        white = dataset.whiten_channels(column[0] * rows.force_weight, column[1] * rows.diameter_weight)
        return jnp.concatenate([w * c for w, c in zip(white, dataset.channel_weights, strict=True)])

    return jax.vmap(whiten)(columns)


def set_form_columns(dataset: Dataset, columns: np.ndarray, owners: Sequence[str]) -> Dataset:
    """Return the dataset with form errors.

    Args:
        dataset: the dataset.
        columns: (r, 2, n) shapes, multiplied by their standard deviations, SI.
        owners: for each column, the id of its mechanism.
    """
    white = np.asarray(whiten_columns(dataset, jnp.asarray(columns)))
    return dataclasses.replace(dataset, form_filter=FormFilter.from_columns(columns, white, owners))


def whiten_form_again(dataset: Dataset) -> Dataset:
    """Return the dataset with the same form errors, whitened by its present noise and rows."""
    if dataset.form_filter is None:
        return dataset
    return set_form_columns(dataset, np.asarray(dataset.form_filter.columns), dataset.form_filter.owners)


def compute_white_misfit(dataset: Dataset, values: Float[Array, " p"]) -> np.ndarray:
    """Return measured − model, whitened by the noise alone, (2n,); zero where not measured."""
    misfit = np.nan_to_num(compute_si_misfit(dataset, values))
    return np.asarray(whiten_columns(dataset, jnp.asarray(misfit)[None]))[0]


def estimate_form(dataset: Dataset, values: Float[Array, " p"]) -> np.ndarray:
    """Return the posterior mean of the form errors, (2, n), SI; zero for a dataset without."""
    if dataset.form_filter is None:
        return np.zeros((2, dataset.rows.pressure.size))
    return dataset.form_filter.estimate_form(compute_white_misfit(dataset, values))
