"""Removal of mechanisms that the form errors of the other mechanisms replace.

A wrong mechanism can fit the difference between another one and its textbook equation. Each mechanism of a
set is therefore removed once, and both models are refitted with the form errors of their mechanisms. The
mechanism stays if the likelihood with it is significantly larger.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.stats import chi2

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_refits import fit_without_mechanism, is_reduction_significant
from pamjax.diagnosis.select.search import MechanismSearch


def remove_redundant_mechanisms(search: MechanismSearch, fit: ModelFit) -> ModelFit:
    """Return the model without mechanisms that form errors of the others replace."""
    while len(fit.mechanisms) > 1:
        cost = compute_cost(search, fit)
        reduced_fits = parallel_map(
            partial(fit_without_mechanism, search.problem, fit), range(len(fit.mechanisms))
        )
        cost_increases = np.array(parallel_map(partial(compute_cost, search), reduced_fits)) - cost
        counts = [len(candidate.free_parameters) for candidate in fit.mechanisms]
        k = int(np.argmax(chi2.logsf(np.maximum(cost_increases, 0.0), counts)))
        if is_reduction_significant(
            float(cost_increases[k]),
            counts[k],
            len(search.candidates),
            search.settings.false_inclusion_probability,
        ):
            break
        fit = search.refit(reduced_fits[k])
    return fit


def compute_cost(search: MechanismSearch, fit: ModelFit) -> float:
    """Return −2 ln L with the priors and the form errors, up to a constant."""
    form_error_fit = add_form_errors(search.problem, fit)
    return form_error_fit.corrected_chi2 + form_error_fit.noise.log_determinant
