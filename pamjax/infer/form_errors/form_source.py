"""Constants of the form error of one mechanism, from the rows of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.infer.form_errors.columns import FormShape, choose_scaling_channel, estimate_form_shape
from pamjax.infer.form_errors.coordinates import Coordinates, CoordinateScales
from pamjax.model.form_error import FormError
from pamjax.records.recording import Recording


@dataclass(frozen=True, eq=False)
class FormSource:
    """Constants of the columns of the form error of one mechanism.

    Attributes:
        shape: terms, parts in proportion to the effect, and scales of the columns.
        limits: limits of the variables where the mechanism acts.
        reshaped_values: for each effect with another shape, its parameters by field, SI.
        share: size of the form error, as a share of the effect.
    """

    shape: FormShape
    limits: CoordinateScales
    reshaped_values: tuple[Mapping[str, float], ...]
    share: float


def build_form_source(
    form_error: FormError,
    recording: Recording,
    limits: CoordinateScales,
    coordinates: Coordinates,
    effect: np.ndarray,
    reshaped_effects: Sequence[np.ndarray],
    reshaped_values: Sequence[Mapping[str, float]],
    share: float,
) -> FormSource:
    """Return the constants of the columns that `build_columns_of_effect` builds.

    Args:
        form_error: the terms.
        recording: the recording of the fit.
        limits, coordinates: its limits and variables, for all mechanisms.
        effect: (2, n) effect of the mechanism, SI.
        reshaped_effects: (2, n) each, the effect with other shape parameters.
        reshaped_values: these parameters by field, SI.
        share: size of the form error.
    """
    channel = choose_scaling_channel(effect)
    return FormSource(
        estimate_form_shape(form_error, coordinates.rescale(channel), effect, reshaped_effects),
        limits.restrict(recording.pressure, recording.length, channel),
        tuple(reshaped_values),
        share,
    )
