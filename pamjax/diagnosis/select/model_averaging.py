"""Model averaging: parameter covariance including other minima and indistinguishable mechanisms.

The covariance at one minimum does not include other minima. Viscoelastic relaxation with two branches can
fit a recording almost equally well with different parameters (10 % in 3 s, or 50 % in 40 s). If two
mechanisms are indistinguishable, the estimates of all other parameters depend on the choice. In addition,
input noise biases parameters of mechanisms with memory. Therefore the model is refitted from other starting
values of its mechanisms, and the best minimum is kept. With all models m that fit about as well, the
covariance is

    C = C_0 + Σ p_m (v_m − v_0) (v_m − v_0)ᵀ + δ δᵀ,        p_m = e^(−Δχ²_m / 2 s) / Σ,

v_0 the reported values, s the mean squared residual of a sample, at least 1, and δ the bias due to input
noise (`estimate_input_noise_bias`). An indistinguishable mechanism has the probability from its comparison.
It does not contribute to the covariance of the parameters of the mechanism that it replaces.

Neglects: the starting times of a slip; these are many, and the search has tested them.
Source: moments of a mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2
from pamjax.diagnosis.refit.errors_in_variables import estimate_input_noise_bias
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import (
    ModelFit,
    build_corrected_fit,
    get_free_indices,
    get_parameter_indices,
    switch_off_candidate,
)
from pamjax.diagnosis.select.rivals import NamedMechanism, RivalFit


def average_models(
    problem: LibraryProblem, fit: ModelFit, named_mechanisms: Sequence[NamedMechanism]
) -> ModelFit:
    """Return the model at its best minimum, with the covariance between models.

    Args:
        problem: the recording and the library.
        fit: the refitted model with mechanisms.
        named_mechanisms: its mechanisms with their rivals.
    """
    settings = problem.settings
    refits = parallel_map(
        lambda start: _refit_from(problem, fit, start, settings.alternative_fit_evaluations),
        _build_starts(problem, fit),
    )
    close_refits = [
        refit
        for refit in refits
        if refit.estimate.chi2_with_priors < fit.estimate.chi2_with_priors + settings.max_alternative_chi2
    ]
    minima = sorted(
        parallel_map(partial(_add_input_noise_chi2, problem), close_refits),
        key=lambda refit: refit.corrected_chi2,
    )
    if minima and minima[0].corrected_chi2 < fit.corrected_chi2 - settings.min_chi2_improvement:
        minima.append(fit)
        fit = refit_from(problem, fit, minima[0].estimate.values)
    shifts = _weigh_minima(fit, minima, settings.distance_chi2_tolerance) + [
        shift for mechanism in named_mechanisms for shift in _weigh_indistinguishable(problem, fit, mechanism)
    ]
    free = list(fit.estimate.free)
    between = sum((p * np.outer(shift[free], shift[free]) for p, shift in shifts), np.zeros((len(free),) * 2))
    return replace(fit, between_model_covariance=between)


def add_input_noise_bias(problem: LibraryProblem, fit: ModelFit) -> ModelFit:
    """Return the fit with its bias due to input noise; zero for a fit with misfit weights."""
    bias = (
        estimate_input_noise_bias(problem, fit.noise, fit.estimate)
        if fit.noise.weight == 1
        else np.zeros(len(fit.estimate.free))
    )
    return replace(fit, errors_in_variables_bias=bias)


def _build_starts(problem: LibraryProblem, fit: ModelFit) -> list[np.ndarray]:
    """Return starting values: each mechanism with each set of its other starting values."""
    candidates, starts = build_candidates(problem), []
    for candidate in fit.mechanisms:
        others = [
            other_candidate
            for other_candidate in candidates
            if other_candidate.id == candidate.id
            and set(other_candidate.free_parameters) == set(candidate.free_parameters)
        ]
        for other in others if 1 < len(others) <= problem.settings.max_starting_candidates else []:
            starts.append(problem.set_shape(fit.estimate.values, other.shape))
    return starts


def _refit_from(
    problem: LibraryProblem,
    fit: ModelFit,
    start: np.ndarray,
    max_evaluations: int,
) -> ModelFit:
    return replace(
        fit, estimate=fit_parameters(problem, fit.noise, fit.estimate.free, start, max_evaluations)
    )


def _add_input_noise_chi2(problem: LibraryProblem, fit: ModelFit) -> ModelFit:
    """Return the fit with its χ² due to input noise; zero for a fit with misfit weights."""
    input_noise_chi2 = (
        compute_input_noise_chi2(problem, fit.noise.whiten, fit.estimate.values)
        if fit.noise.weight == 1
        else 0.0
    )
    return replace(fit, input_noise_chi2=input_noise_chi2)


def refit_from(problem: LibraryProblem, fit: ModelFit, start: np.ndarray) -> ModelFit:
    """Return the model of a fit, refitted to the minimum from other values, (p,), with the same noise.

    It is corrected for input noise, unless the fit has misfit weights.
    """
    refit = _refit_from(problem, fit, start, problem.settings.max_refit_evaluations)
    return (
        build_corrected_fit(problem, refit.mechanisms, refit.noise, refit.estimate)
        if refit.noise.weight == 1
        else refit
    )


def _weigh_minima(
    fit: ModelFit, minima: Sequence[ModelFit], tolerance: float
) -> list[tuple[float, np.ndarray]]:
    """Return the probability of each other minimum and the shifts of all parameters to it."""
    distinct = [fit]
    for minimum in minima:
        if all(_is_other_minimum(other_fit, minimum, tolerance) for other_fit in distinct):
            distinct.append(minimum)
    increases = np.array([max(m.corrected_chi2 - fit.corrected_chi2, 0.0) for m in distinct])
    probabilities = np.exp(-0.5 * increases / fit.variance_inflation)
    probabilities /= probabilities.sum()
    return [
        (float(p), m.estimate.values - fit.estimate.values)
        for p, m in zip(probabilities, distinct, strict=True)
    ][1:]


def _is_other_minimum(fit: ModelFit, other: ModelFit, tolerance: float) -> bool:
    """Return whether a fit is farther from a minimum than the covariance of the fit explains."""
    shift = (other.estimate.values - fit.estimate.values)[list(fit.estimate.free)] / fit.estimate.scale
    distance_chi2 = float(
        np.sum((fit.estimate.jacobian @ shift) ** 2) + np.sum((shift / fit.estimate.prior_sd) ** 2)
    )
    return (
        distance_chi2 / fit.variance_inflation
        > max(other.corrected_chi2 - fit.corrected_chi2, 0.0) / fit.variance_inflation + tolerance
    )


def _weigh_indistinguishable(
    problem: LibraryProblem, fit: ModelFit, mechanism: NamedMechanism
) -> list[tuple[float, np.ndarray]]:
    """Return the probability of each indistinguishable mechanism and the shifts of the other parameters."""
    own_candidate = next((candidate for candidate in fit.mechanisms if candidate.id == mechanism.id), None)
    if own_candidate is None:
        return []

    def compute_change(rival: RivalFit) -> tuple[float, np.ndarray]:
        start = switch_off_candidate(problem, fit.estimate.values, own_candidate)
        rival_indices = get_parameter_indices(problem, [rival.candidate])
        start[rival_indices] = rival.values[rival_indices]
        others = [
            other_candidate for other_candidate in fit.mechanisms if other_candidate is not own_candidate
        ]
        free = get_free_indices(problem, [*others, rival.candidate])
        shift = (
            fit_parameters(
                problem, fit.noise, free, start, problem.settings.alternative_fit_evaluations
            ).values
            - fit.estimate.values
        )
        shift[get_parameter_indices(problem, [own_candidate])] = 0.0
        return rival.probability, shift

    return parallel_map(compute_change, mechanism.indistinguishable_fits)
