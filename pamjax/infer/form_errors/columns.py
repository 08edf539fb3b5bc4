"""Columns of the linear model for the form error of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.infer.form_errors.coordinates import Coordinates
from pamjax.model.form_error import FormError, parse_term

#: Largest factor on a column: a Legendre polynomial of degree four has a third of the rms of its limits.
_MAX_GROWTH = 3.0
#: Share of the rms of the effect below which a column counts as zero.
_MIN_COLUMN_RMS = 1e-9


@dataclass(frozen=True, eq=False)
class FormShape:
    """Constants of the columns of a form error, estimated from the rows of a fit.

    In any rows, column k of the effect e with the other shapes e_k is

        g_k (φ_k(x) e − s_k e)   for a term φ_k of the coordinates x,   g_k (e_k − s_k e)   for another shape.

    Attributes:
        terms: the terms φ_k, as "pressure length^2".
        parallel_shares: (r, 2) parts s_k in proportion to the effect, by channel.
        scales: (r,) factors g_k.
    """

    terms: tuple[str, ...]
    parallel_shares: np.ndarray
    scales: np.ndarray

    def build_columns(
        self, coordinates: Coordinates, effect: np.ndarray, reshaped_effects: Sequence[np.ndarray] = ()
    ) -> np.ndarray:
        """Return the columns in any rows, (r, 2, n), SI.

        Args:
            coordinates: variables of the terms, scaled to the rows of the fit in which the effect acts.
            effect: (2, n) effect of the equation.
            reshaped_effects: (2, n) each, the effect with other shape parameters.
        """
        raw = _build_raw_columns(self.terms, coordinates, effect, reshaped_effects)
        if not raw:
            return np.zeros((0, *effect.shape))
        return _remove_parallel(raw, self.parallel_shares, effect) * self.scales[:, None, None]


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
    local = coordinates.rescale(choose_scaling_channel(effect))
    if form_error.is_additive:
        factors = [local.evaluate_term(term) for term in form_error.parse()]
        return _build_course(effect, [factor for factor in factors if factor.any()])
    shape = estimate_form_shape(form_error, local, effect, reshaped_effects)
    return shape.build_columns(local, effect, reshaped_effects)


def choose_scaling_channel(effect: np.ndarray) -> np.ndarray:
    """Return the channel, (n,), of an effect, (2, n), that decides where the mechanism acts."""
    # Most mechanisms act on force; diameter decides only if the force does not change.
    return effect[0] if effect[0].any() else effect[1]


def estimate_form_shape(
    form_error: FormError,
    coordinates: Coordinates,
    effect: np.ndarray,
    reshaped_effects: Sequence[np.ndarray] = (),
) -> FormShape:
    """Return the constants of the columns of a form error that is no course in time.

    The columns have no part in proportion to the effect, channel by channel: the amplitude of the mechanism
    has it. Together they have the rms of the effect.

    Args:
        form_error: the terms.
        coordinates: their variables, scaled to the rows in which the effect acts.
        effect, reshaped_effects: as of `build_columns_of_effect`.
    """
    terms = tuple(term for term in form_error.terms if coordinates.evaluate_term(parse_term(term)).any())
    raw = _build_raw_columns(terms, coordinates, effect, reshaped_effects)
    if not raw:
        return FormShape((), np.zeros((0, 2)), np.zeros(0))
    shares = np.stack([_compute_parallel_share(column, effect) for column in raw])
    return FormShape(terms, shares, _compute_scales(_remove_parallel(raw, shares, effect), effect))


def _build_raw_columns(
    terms: Sequence[str],
    coordinates: Coordinates,
    effect: np.ndarray,
    reshaped_effects: Sequence[np.ndarray],
) -> list[np.ndarray]:
    """Return the effect times each term, and the effects with other shapes, (2, n) each."""
    products = [effect * coordinates.evaluate_term(parse_term(term)) for term in terms]
    return [*products, *reshaped_effects]


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


def _compute_parallel_share(column: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return the part of a column that is proportional to the effect, over the effect, (2,)."""
    square = np.sum(effect**2, axis=1)
    return np.sum(column * effect, axis=1) / np.where(square > 0, square, 1.0)


def _remove_parallel(columns: Sequence[np.ndarray], shares: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return columns without their parts in proportion to the effect, (r, 2, n)."""
    return np.stack([column - share[:, None] * effect for column, share in zip(columns, shares, strict=True)])


def _compute_scales(columns: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return the factors, (r,), that give the columns together the rms of the effect.

    A small column grows by at most `_MAX_GROWTH`.
    """
    scale = np.where(np.mean(effect**2, axis=1) > 0, np.mean(effect**2, axis=1), np.inf)
    size = np.sqrt(np.mean(columns**2 / scale[:, None], axis=(1, 2)) * 2 / np.isfinite(scale).sum().clip(1))
    count = max(int(np.count_nonzero(size > _MIN_COLUMN_RMS)), 1)
    growth = np.where(size > _MIN_COLUMN_RMS, 1 / np.maximum(size, 1 / _MAX_GROWTH), 0.0)
    return growth / np.sqrt(count)
