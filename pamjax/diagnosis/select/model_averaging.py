"""How far a number moves among models that a recording tells apart no better than by chance.

A standard deviation at a minimum knows of that minimum alone. Relaxing rubber of two branches fits a
recording nearly alike in several ways (a tenth in 3 s, or a half in 40 s), and where one name can stand for
another the numbers of all others depend on which of them is there. Nor does it know that noise of pressure
and length, passed on by a memory, pulls the numbers. So the model is refitted from the other forms in which
the same numbers of a name move, the best of these fits is kept, and of every model m that is about as good,
weighed by p_m, the numbers get the covariance

    C = C_0 + Σ p_m (v_m − v_0) (v_m − v_0)ᵀ + δ δᵀ,        p_m = e^(−Δχ²_m / 2 s) / Σ,

v_0 the numbers that are told, s the mean square that the model leaves and δ that pull
(`correct_input_noise_bias`). A tie has
the chance that it has beside the name whose place it takes, and says nothing of that name's own numbers.

What it leaves out: moments of a slip, which are many and which the search has tried.
Source: moments of a mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.library.candidates import Candidate, build_candidates
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2
from pamjax.diagnosis.refit.candidate_fit import (
    CandidateFit,
    build_corrected_fit,
    get_free_indices,
    get_parameter_indices,
    switch_off_candidate,
)
from pamjax.diagnosis.refit.errors_in_variables import estimate_input_noise_bias
from pamjax.diagnosis.refit.least_squares import MAX_REFIT_EVALUATIONS as TO_THE_END
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.select.selection import NamedMechanism

#: Most other forms of a name to begin from.
MAX_STARTING_CANDIDATES = 9
#: Evaluations of a refit from another form.
ALTERNATIVE_FIT_EVALUATIONS = 10
#: χ² by which a fit may be worse and still count as about as good.
MAX_ALTERNATIVE_CHI2 = 20.0
#: χ² by which another minimum must be lower to be gone to.
MIN_CHI2_IMPROVEMENT = 0.5
#: What a model's own standard deviations say of a distance, χ², is off by so much by chance.
DISTANCE_CHI2_TOLERANCE = 4.0


def average_models(
    problem: LibraryProblem, fit: CandidateFit, named_mechanisms: Sequence[NamedMechanism]
) -> CandidateFit:
    """The model at the best of its minima, with what the others and its ties disagree about.

    Args:
        problem: the recording before the library.
        fit: with names, refitted.
        named_mechanisms: what each of them is worth beside its rivals.
    """
    ends = parallel_map(partial(_refit_from, problem, fit), _build_starts(problem, fit))
    near = [end for end in ends if end.estimate.cost < fit.estimate.cost + MAX_ALTERNATIVE_CHI2]
    minima = sorted(
        parallel_map(partial(_add_input_noise_chi2, problem), near), key=lambda end: end.corrected_chi2
    )
    if minima and minima[0].corrected_chi2 < fit.corrected_chi2 - MIN_CHI2_IMPROVEMENT:
        minima.append(fit)
        fit = _correct_bias(problem, _refit_from(problem, fit, minima[0].estimate.values, TO_THE_END))
    moves = _weigh_minima(fit, minima) + [
        move for name in named_mechanisms for move in _weigh_indistinguishable(problem, fit, name)
    ]
    free = list(fit.estimate.free)
    bias = (
        estimate_input_noise_bias(problem, fit.noise, fit.estimate)
        if fit.noise.weight == 1
        else np.zeros(len(free))
    )
    between = sum((p * np.outer(by[free], by[free]) for p, by in moves), np.zeros((len(free),) * 2))
    return replace(fit, between_model_covariance=between, errors_in_variables_bias=bias)


def _build_starts(problem: LibraryProblem, fit: CandidateFit) -> list[np.ndarray]:
    """Values from which to begin: each name in each of its other forms."""
    candidates, starts = build_candidates(problem), []
    for candidate in fit.mechanisms:
        others = [
            other_candidate
            for other_candidate in candidates
            if other_candidate.id == candidate.id
            and set(other_candidate.free_parameters) == set(candidate.free_parameters)
        ]
        for other in others if 1 < len(others) <= MAX_STARTING_CANDIDATES else []:
            start = fit.estimate.values.copy()
            for name, value in other.shape.items():
                k = problem.index(name)
                start[k] = np.clip(value, problem.low[k], problem.high[k])
            starts.append(start)
    return starts


def _refit_from(
    problem: LibraryProblem,
    fit: CandidateFit,
    start: np.ndarray,
    max_evaluations: int = ALTERNATIVE_FIT_EVALUATIONS,
) -> CandidateFit:
    return replace(
        fit, estimate=fit_parameters(problem, fit.noise, fit.estimate.free, start, max_evaluations)
    )


def _add_input_noise_chi2(problem: LibraryProblem, fit: CandidateFit) -> CandidateFit:
    """With what noise alone leaves there; a model that is weighed by its own misfit does not know of it."""
    own = (
        compute_input_noise_chi2(problem, fit.noise.whiten, fit.estimate.values)
        if fit.noise.weight == 1
        else 0.0
    )
    return replace(fit, input_noise_chi2=own)


def _correct_bias(problem: LibraryProblem, fit: CandidateFit) -> CandidateFit:
    """Without the pull of that noise."""
    return (
        build_corrected_fit(problem, fit.mechanisms, fit.noise, fit.estimate)
        if fit.noise.weight == 1
        else fit
    )


def _weigh_minima(fit: CandidateFit, minima: Sequence[CandidateFit]) -> list[tuple[float, np.ndarray]]:
    """Chance of each other minimum, and by how much it moves every number."""
    other = [fit]
    for end in minima:
        if all(_is_other_minimum(other_fit, end) for other_fit in other):
            other.append(end)
    worse = np.array([max(end.corrected_chi2 - fit.corrected_chi2, 0.0) for end in other])
    chances = np.exp(-0.5 * worse / fit.variance_inflation)
    chances /= chances.sum()
    return [
        (float(p), end.estimate.values - fit.estimate.values) for p, end in zip(chances, other, strict=True)
    ][1:]


def _is_other_minimum(fit: CandidateFit, end: CandidateFit) -> bool:
    """Whether a fit is farther from a minimum than the minimum's own standard deviations know."""
    by = (end.estimate.values - fit.estimate.values)[list(fit.estimate.free)] / fit.estimate.scale
    own = float(np.sum((fit.estimate.jacobian @ by) ** 2) + np.sum((by / fit.estimate.prior_sd) ** 2))
    return (
        own / fit.variance_inflation
        > max(end.corrected_chi2 - fit.corrected_chi2, 0.0) / fit.variance_inflation + DISTANCE_CHI2_TOLERANCE
    )


def _weigh_indistinguishable(
    problem: LibraryProblem, fit: CandidateFit, named: NamedMechanism
) -> list[tuple[float, np.ndarray]]:
    """Chance of each of a name's ties, and by how much it moves the numbers of the others."""
    own_candidate = next((candidate for candidate in fit.mechanisms if candidate.id == named.id), None)
    if own_candidate is None:
        return []

    def compute_change(alternative: tuple[float, Candidate, np.ndarray]) -> tuple[float, np.ndarray]:
        chance, candidate, values = alternative
        start = switch_off_candidate(problem, fit.estimate.values, own_candidate)
        start[get_parameter_indices(problem, [candidate])] = values[
            get_parameter_indices(problem, [candidate])
        ]
        others = [
            other_candidate for other_candidate in fit.mechanisms if other_candidate is not own_candidate
        ]
        free = get_free_indices(problem, [*others, candidate])
        by = (
            fit_parameters(problem, fit.noise, free, start, ALTERNATIVE_FIT_EVALUATIONS).values
            - fit.estimate.values
        )
        by[get_parameter_indices(problem, [own_candidate])] = 0.0
        return chance, by

    return parallel_map(compute_change, named.alternatives)
