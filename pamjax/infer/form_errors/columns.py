"""Columns of the linear model for the form error of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.infer.form_errors.coordinates import Coordinates
from pamjax.model.form_error import FormError

#: Largest factor on a column: a Legendre polynomial of degree four has a third of the rms of its limits.
_MAX_GROWTH = 3.0
#: Share of the rms of the effect below which a column counts as zero.
_MIN_COLUMN_RMS = 1e-9


def build_columns_of_effect(
    form_error: FormError,
    coordinates: Coordinates,
    effect: np.ndarray,
    reshaped_effects: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return the columns of the form error of an effect, (2, n), SI; (r, 2, n), each of its rms / √r.

    Args:
        form_error: the terms.
        coordinates: their variables.
        effect: change of the prediction by the mechanism.
        reshaped_effects: the effect with other shape parameters, (2, n) each.
    """
    # Most mechanisms act on force; diameter decides only if the force does not change.
    local = coordinates.rescale(effect[0] if effect[0].any() else effect[1])
    factors = [local.evaluate_term(term) for term in form_error.parse()]
    factors = [factor for factor in factors if factor.any()]
    if form_error.is_additive:
        return _build_course(effect, factors)
    # The amplitude of the mechanism has what is proportional to the effect.
    columns = [
        _remove_parallel(column, effect)
        for column in [*(effect * factor for factor in factors), *reshaped_effects]
    ]
    if not columns:
        return np.zeros((0, *effect.shape))
    return _scale_columns(np.stack(columns), effect)


def _build_course(effect: np.ndarray, factors: Sequence[np.ndarray]) -> np.ndarray:
    """Return the columns of an added course, (r, 2, n), together of the rms of the effect.

    As in a random walk, the k-th harmonic is k times smaller than the first.
    """
    if not factors:
        return np.zeros((0, *effect.shape))
    weights = 1 / np.arange(1, len(factors) + 1)
    weights *= np.sqrt(2 / np.sum(weights**2))
    size = np.sqrt(np.mean(effect**2, axis=1))[:, None]
    return np.stack([size * weight * factor for weight, factor in zip(weights, factors, strict=True)])


def _remove_parallel(column: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return a column without its part that is proportional to the effect, channel by channel."""
    square = np.sum(effect**2, axis=1, keepdims=True)
    share = np.sum(column * effect, axis=1, keepdims=True) / np.where(square > 0, square, 1.0)
    return column - share * effect


def _scale_columns(columns: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return columns that together have the rms of the effect; a small column grows by `_MAX_GROWTH`."""
    scale = np.where(np.mean(effect**2, axis=1) > 0, np.mean(effect**2, axis=1), np.inf)
    size = np.sqrt(np.mean(columns**2 / scale[:, None], axis=(1, 2)) * 2 / np.isfinite(scale).sum().clip(1))
    count = max(int(np.count_nonzero(size > _MIN_COLUMN_RMS)), 1)
    growth = np.where(size > _MIN_COLUMN_RMS, 1 / np.maximum(size, 1 / _MAX_GROWTH), 0.0)
    return columns * (growth / np.sqrt(count))[:, None, None]
