"""Sizes of the form errors of a posterior, relative to the effects of the equations."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.result import CaseFit
from pamjax.infer.form_errors.dataset_form import remove_effect, whiten_columns
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.infer.posterior.predictive import draw_coefficients, predict_equations
from pamjax.infer.problem.dataset import Dataset


@dataclass(frozen=True, eq=False)
class FormErrorSize:
    """Size of the form error of one mechanism in a posterior.

    Attributes:
        share: its most likely size before it was estimated, as a share of the effect; zero for an exact
            equation.
        ratio: (draws,) rms of form error over rms of effect, both whitened by the noise of the fit.
        effect_rms: (2,) mean over the draws of the rms of the effect over the measured rows, SI; zero for a
            channel that is not measured.
    """

    share: float
    ratio: np.ndarray
    effect_rms: np.ndarray


def compute_form_sizes(
    density: PosteriorDensity,
    case_fit: CaseFit,
    fit_dataset: Dataset,
    values: np.ndarray,
    index: int,
    seed: int,
) -> dict[str, FormErrorSize]:
    """Return the size of the form error of each mechanism of one case.

    Args:
        density: the posterior density.
        case_fit: the fit of the case.
        fit_dataset: its dataset, with the noise of the fit.
        values: (draws, p) parameters, SI.
        index: index of the dataset.
        seed: seed of the coefficients.

    Neglects: the noise of a draw, which would change the weights of two channels.
    """
    if not case_fit.form_errors:
        return {}
    form, dataset = density.forms[index], density.datasets[index]
    coefficients = draw_coefficients(density, values, index, seed)
    prediction = predict_equations(dataset, values)
    is_measured = np.asarray(dataset.rows.weights) > 0
    sizes = {}
    for id, part in case_fit.form_errors.items():
        neutral_dataset, neutral_values = remove_effect(dataset, jnp.asarray(values), id)
        effect = prediction - predict_equations(neutral_dataset, np.asarray(neutral_values))
        effect = np.where(is_measured, np.nan_to_num(effect), 0.0)
        is_own = np.array([owner == id for owner in form.owners], dtype=float)
        own_form = np.einsum("dr,rcn->dcn", coefficients * is_own, np.asarray(form.columns))
        own_rms, effect_white_rms = (_compute_white_rms(fit_dataset, array) for array in (own_form, effect))
        sizes[id] = FormErrorSize(
            part.share,
            own_rms / np.maximum(effect_white_rms, 1e-12),
            np.sqrt(np.sum(effect**2, axis=2) / np.maximum(is_measured.sum(axis=1), 1)).mean(axis=0),
        )
    return sizes


def _compute_white_rms(dataset: Dataset, arrays: np.ndarray) -> np.ndarray:
    """Return the rms of predictions, (draws, 2, n), SI, whitened by the noise of a dataset, (draws,)."""
    white = np.asarray(whiten_columns(dataset, jnp.asarray(arrays)))
    return np.sqrt(np.mean(white**2, axis=1))
