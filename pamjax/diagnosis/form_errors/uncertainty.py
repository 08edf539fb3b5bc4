"""Covariance of parameters that includes form errors.

The equations alone give the reported values v_0. With form errors, the same fit has the values v_f and the
covariance C_f. The mean square deviation from v_0 is then

    C = C_f + (v_f − v_0) (v_f − v_0)ᵀ.

Source: moments of a distribution.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pamjax.diagnosis.form_errors.fit import FormErrorFit
from pamjax.diagnosis.refit.model_fit import ModelFit


def include_form_errors(fit: ModelFit, form_error_fit: ModelFit) -> ModelFit:
    """Return a fit whose covariance between models includes the form errors of its mechanisms.

    Args:
        fit: the fit with exact equations.
        form_error_fit: the same fit with form errors; `fit` itself if its mechanisms have none.
    """
    if not isinstance(form_error_fit, FormErrorFit):
        return fit
    free = list(fit.estimate.free)
    shift = (form_error_fit.estimate.values - fit.estimate.values)[free]
    change = form_error_fit.within_model_covariance - fit.within_model_covariance
    return replace(
        fit, between_model_covariance=fit.between_model_covariance + change + np.outer(shift, shift)
    )
