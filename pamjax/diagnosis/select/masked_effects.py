"""Sensor errors whose effect the form error of a mechanism masks.

A search adds a mechanism only if it explains what the form errors of the others leave. A form error of 10 %
of a large effect can mask a gain error of 1 %. Here the form error of one mechanism at a time is removed, and
the best zero, gain or delay of a sensor takes its place. These have one equation, and it is simple: other
mechanisms would only replace one inexact equation by another. Then all form errors are estimated again. The
candidate stays if it is

worthwhile    without that form error, which leaves more than noise, as a small effect (`search.py`)
more likely   the likelihood with all form errors is significantly larger, see `redundant_mechanisms.py`
complete      the residual is then only noise

Mechanisms whose state depends on earlier samples keep their form errors. What happened before the recording
is unknown, and the difference that it makes can resemble the zero of a sensor.

A wrong candidate rarely passes. It fits the difference between an effect and its textbook equation only
roughly, and the form error fits it closely. In a short recording the difference can be as small as the noise.
Therefore the certainty of such a mechanism is reduced (setting `doubtful_certainty_share`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.form_errors.fit import FormErrorFit, add_form_errors
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.select.mechanism_refits import is_reduction_significant
from pamjax.diagnosis.select.redundant_mechanisms import compute_cost
from pamjax.diagnosis.select.search import MechanismSearch, fit_best_candidate
from pamjax.infer.form_errors.discrepancy import DiscrepancyNoise
from pamjax.model.mechanism import AbstractMemory, AbstractSensor, AbstractSlip
from pamjax.model.registry import MECHANISMS

#: Zeros, gains and delays of sensors. A drift is not among them: it can have any course in time.
_SENSOR_ERROR_IDS = {
    kind.id for kind in MECHANISMS if issubclass(kind, AbstractSensor) and not kind.form_error.is_additive
}

#: Mechanisms of the muscle whose state depends on earlier samples.
_MEMORY_IDS = {kind.id for kind in MECHANISMS if issubclass(kind, AbstractMemory | AbstractSlip)}


def add_masked_effects(search: MechanismSearch, fit: ModelFit) -> ModelFit:
    """Return the model with the sensor errors that form errors of its mechanisms mask."""
    sensor_errors = [candidate for candidate in search.candidates if candidate.id in _SENSOR_ERROR_IDS]
    search = replace(search, candidates=sensor_errors)
    while len(fit.mechanisms) < search.settings.max_mechanisms:
        extended_fits = parallel_map(
            partial(_replace_form_error, search, fit), _remove_form_errors(search, fit)
        )
        better = [extended_fit for extended_fit in extended_fits if extended_fit is not None]
        if not better:
            break
        fit = min(better, key=lambda extended_fit: compute_cost(search, extended_fit))
    return fit


def _remove_form_errors(search: MechanismSearch, fit: ModelFit) -> list[ModelFit]:
    """Return the model without the form error of each mechanism that has one and no memory, refitted."""
    form_error_fit = add_form_errors(search.problem, fit)
    if not isinstance(form_error_fit, FormErrorFit):
        return []
    reduced_fits = [
        _remove_form_error(search, form_error_fit, id)
        for id, share in form_error_fit.shares.items()
        if share > 0 and id not in _MEMORY_IDS
    ]
    return [fit for fit in reduced_fits if not search.is_excess_noise(fit)]


def _remove_form_error(search: MechanismSearch, fit: FormErrorFit, id: str) -> ModelFit:
    assert isinstance(fit.noise, DiscrepancyNoise)
    noise = fit.noise.remove_columns([id])
    estimate = fit_parameters(
        search.problem, noise, fit.estimate.free, fit.estimate.values, search.settings.rough_evaluations
    )
    return ModelFit(fit.mechanisms, noise, estimate, fit.input_noise_chi2)


def _replace_form_error(search: MechanismSearch, fit: ModelFit, reduced_fit: ModelFit) -> ModelFit | None:
    """Return the fit with the best candidate in the place of a form error; None if it is not better."""
    extended_fit = fit_best_candidate(search, reduced_fit)
    if extended_fit is None or not search.is_worthwhile(reduced_fit, extended_fit, may_be_small=True):
        return None
    new_fit = search.refit(extended_fit)
    is_more_likely = is_reduction_significant(
        compute_cost(search, fit) - compute_cost(search, new_fit),
        len(new_fit.mechanisms[-1].free_parameters),
        len(search.candidates),
        search.settings.false_addition_probability,
    )
    return new_fit if is_more_likely and search.leaves_only_noise(new_fit) else None
