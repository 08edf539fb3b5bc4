"""The part of the form errors in a prediction: its estimate, its size and its uncertainty.

The prediction at a row is linear in parameters δ and coefficients c: B (δ, c). With the whitened columns A of
both and the precision Λ of their priors, their covariance is (AᵀA + Λ)⁻¹. The variance of the prediction is
the diagonal of B (AᵀA + Λ)⁻¹ Bᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.infer.problem.rms import compute_rms
from pamjax.infer.problem.unit_diagonal import invert_scaled

#: Smallest effect that is shown, as a share of the noise of a row.
MIN_SHOWN_EFFECT = 0.05


@dataclass(frozen=True, eq=False)
class FormErrorPart:
    """Form error of one mechanism in a recording.

    Attributes:
        share: its most likely size before it was estimated, as a share of the effect.
        ratio: rms of the estimated form error over the rms of the effect, both whitened.
        form: (2, n) estimated form error, SI.
        form_rms, effect_rms: (2,) rms of form error and effect over the measured rows, SI; NaN for a channel
            that is not measured.
    """

    share: float
    ratio: float
    form: np.ndarray
    form_rms: np.ndarray
    effect_rms: np.ndarray


def build_form_part(
    share: float,
    form: np.ndarray,
    effect: np.ndarray,
    form_white: np.ndarray,
    effect_white: np.ndarray,
    is_measured: np.ndarray,
) -> FormErrorPart:
    """Return the form error of one mechanism.

    Args:
        share: its size, as a share of the effect.
        form, effect: (2, n) estimated form error, and effect of the equation, SI.
        form_white, effect_white: (size,) the same, whitened by the noise.
        is_measured: (2, n) whether a sample is compared with the model.
    """
    return FormErrorPart(
        share,
        compute_rms(form_white, 0.0) / max(compute_rms(effect_white, 0.0), 1e-12),
        form,
        _compute_channel_rms(form, is_measured),
        _compute_channel_rms(effect, is_measured),
    )


def _compute_channel_rms(values: np.ndarray, is_measured: np.ndarray) -> np.ndarray:
    return np.array(
        [compute_rms(channel[measured]) for channel, measured in zip(values, is_measured, strict=True)]
    )


def compute_prediction_sd(columns: np.ndarray, white: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the standard deviation of a prediction, (2, n), SI.

    Args:
        columns: (k, 2, n) derivatives of the prediction by parameters and coefficients, SI.
        white: (k, size) the same, whitened by the noise.
        precision: (k,) 1 / variance of their priors.
    """
    inverse, unit = invert_scaled(white @ white.T + np.diag(precision))
    scaled = columns / unit[:, None, None]
    return np.sqrt(np.maximum(np.einsum("kcn,kl,lcn->cn", scaled, inverse, scaled, optimize=True), 0.0))


def compute_joint_covariance(white: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the covariance of parameters and coefficients, (k, k); arguments as above."""
    inverse, unit = invert_scaled(white @ white.T + np.diag(precision))
    return inverse / np.outer(unit, unit)
