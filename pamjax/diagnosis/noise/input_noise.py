"""χ² due to input noise (of pressure and length) for models with memory.

The noise model assumes that input noise propagates sample by sample. A delay between samples averages
neighbours, and a rate is their difference. The predicted noise is then smaller or larger, and so is the
χ² of a residual that is only noise:

    E χ²(m) − E χ²(0) = E |W [f_m(x + u) − f_m(x)]|² − E |W (∂f_0/∂x) u|²,

f_m the model, f_0 its muscle without memory, W the weights, x the measured inputs (pressure and length), u
their noise. Two models are compared after this difference is subtracted from each χ². Without the
correction, a delay of half a sample can have a lower χ² than the true model.

The mean over u uses random signs, ±sd, the same for every model. Four draws have the signs of the rows of
a Hadamard matrix: products of neighbours, and of pressure and length, then average to zero.

A setting limits the correction. If a model amplifies noise strongly, noise added to an already noisy path is
no good estimate of noise on the true path.
Source: derived here; signs as M. F. Hutchinson, Commun. Stat. Simul. 18, 1059 (1989); Hadamard's rows as
C. Bekas, E. Kokiopoulou, Y. Saad, Appl. Numer. Math. 57, 1214 (2007).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from weakref import WeakKeyDictionary

import jax.numpy as jnp
import numpy as np
from scipy.linalg import hadamard

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.infer.noise.sensor_noise import compute_sensitivities
from pamjax.model.registry import MECHANISMS

#: Number of draws, a power of two, and their seed. All models use the same draws.
_INPUT_NOISE_DRAWS, _INPUT_NOISE_SEED = 4, 7


#: The problem with each draw of input noise. Cached, because each has a cache of evaluations.
_perturbed_problems: WeakKeyDictionary[LibraryProblem, list[LibraryProblem]] = WeakKeyDictionary()

#: Mechanisms whose effect depends on the inputs of other samples.
_MECHANISMS_MIXING_SAMPLES = {kind.id for kind in MECHANISMS if kind.mixes_samples}


def compute_input_noise_chi2(
    problem: LibraryProblem, whiten: Callable[[np.ndarray], np.ndarray], values: np.ndarray
) -> float:
    """Return the expected χ² of a model due to input noise, minus that of its muscle without memory.

    Args:
        problem: the recording and the library.
        whiten: whitening filter, `NoiseModel.whiten`.
        values: (p,) parameter values, SI.

    Returns:
        zero without an active mechanism with memory or without stated input noise; negative for a model that
        averages; at most `problem.settings.max_input_noise_chi2_share` of the samples.
    """
    return compute_input_noise_chi2_and_gradient(problem, whiten, values, ())[0]


def compute_input_noise_chi2_and_gradient(
    problem: LibraryProblem, whiten: Callable[[np.ndarray], np.ndarray], values: np.ndarray, indices
) -> tuple[float, np.ndarray]:
    """Return `compute_input_noise_chi2` and its gradient by some parameters, (k,), SI.

    The gradient neglects the limit of the value. It is zero for parameters of mechanisms without memory: they
    change both terms by nearly the same amount.
    """
    gradient = np.zeros(len(indices))
    perturbed_problems = build_perturbed_problems(problem, values)
    if not perturbed_problems:
        return 0.0, gradient
    positions = np.flatnonzero([_mixes_samples(problem.names[k]) for k in indices])
    own_indices = [indices[position] for position in positions]
    prediction, jacobian = problem.predict_with_jacobian(values, own_indices)
    total, size = 0.0, 0
    statics = _propagate_without_memory(problem, values)
    for perturbed_problem, static in zip(perturbed_problems, statics, strict=True):
        perturbed_prediction, perturbed_jacobian = perturbed_problem.predict_with_jacobian(
            values, own_indices
        )
        with_memory = whiten(np.nan_to_num(perturbed_prediction - prediction))
        without_memory = whiten(np.nan_to_num(static))
        total += float(with_memory @ with_memory - without_memory @ without_memory)
        size = with_memory.size
        if own_indices:
            slope = whiten(np.nan_to_num(perturbed_jacobian - jacobian))
            gradient[positions] += 2 * slope @ with_memory / _INPUT_NOISE_DRAWS
    limit = problem.settings.max_input_noise_chi2_share * size
    return min(total / _INPUT_NOISE_DRAWS, limit), gradient


def _propagate_without_memory(problem: LibraryProblem, values: np.ndarray) -> list[np.ndarray]:
    """Return the change of the prediction of the muscle without memory by each draw, (2, n), SI."""
    if problem.case.recording.measures_length:
        # The length at a set force depends on its input through the memories only.
        has_memory = np.array([_mixes_samples(name) for name in problem.names])
        static_values = np.where(has_memory & problem.is_switch, problem.neutral, values)
        prediction = problem.predict(static_values)
        return [
            perturbed_problem.predict(static_values) - prediction
            for perturbed_problem in _get_perturbed_problems(problem)
        ]
    by_pressure, by_length = (
        np.asarray(s)[:, : problem.n] for s in compute_sensitivities(problem.dataset, jnp.asarray(values))
    )
    return [by_pressure * pressure + by_length * length for pressure, length in _sample_input_noise(problem)]


def propagate_input_noise(problem: LibraryProblem, values: np.ndarray) -> np.ndarray | None:
    """Return the change of the prediction by each draw, (draws, 2, n), SI; None without memory or noise."""
    perturbed_problems = build_perturbed_problems(problem, values)
    if not perturbed_problems:
        return None
    prediction = problem.predict(values)
    return np.nan_to_num(
        np.stack([perturbed_problem.predict(values) - prediction for perturbed_problem in perturbed_problems])
    )


def build_perturbed_problems(problem: LibraryProblem, values: np.ndarray) -> list[LibraryProblem]:
    """Return the problem with each draw of input noise added; empty without memory or input noise."""
    if not _has_memory(problem, values) or not any(_get_input_noise_sd(problem)):
        return []
    return _get_perturbed_problems(problem)


def clear_evaluations(problem: LibraryProblem) -> None:
    """Drop the cached evaluations of a problem, and of the problem with input noise."""
    problem.evaluations.clear()
    _perturbed_problems.pop(problem, None)


def _get_perturbed_problems(problem: LibraryProblem) -> list[LibraryProblem]:
    if problem not in _perturbed_problems:
        perturbed_problems = [_perturb_problem(problem, *draw) for draw in _sample_input_noise(problem)]
        # All threads use the problems of the first.
        return _perturbed_problems.setdefault(problem, perturbed_problems)
    return _perturbed_problems[problem]


def _sample_input_noise(problem: LibraryProblem) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the draws of pressure and length noise, (n,) each, SI."""
    pressure, length = (
        sd * ratios for sd, ratios in zip(_get_input_noise_sd(problem), _get_ratios(problem), strict=True)
    )
    signs = np.random.default_rng(_INPUT_NOISE_SEED).choice([-1.0, 1.0], (2, problem.n))
    position = np.arange(problem.n) % (_INPUT_NOISE_DRAWS // 2)
    return [
        (pressure * signs[0] * row[position], length * signs[1] * row[_INPUT_NOISE_DRAWS // 2 + position])
        for row in hadamard(_INPUT_NOISE_DRAWS)
    ]


def _get_input_noise_sd(problem: LibraryProblem) -> tuple[float, float]:
    """Return the sd of pressure and length noise that is independent between samples, SI."""
    sensors = problem.case.muscle_toml.sensors
    return sensors.pressure or 0.0, 0.0 if sensors.length_per_level else sensors.length or 0.0


def _get_ratios(problem: LibraryProblem) -> tuple[np.ndarray | float, np.ndarray | float]:
    """Return the noise of pressure and length in each row over the stated one: a mean has less noise."""
    if problem.samples is None:
        return 1.0, 1.0
    averages = problem.samples.averages
    return averages.compute_noise_ratios("pressure"), averages.compute_noise_ratios("length")


def _mixes_samples(parameter: str) -> bool:
    """Return whether a parameter belongs to a mechanism that depends on the inputs of other samples."""
    return parameter.partition(".")[0] in _MECHANISMS_MIXING_SAMPLES


def _has_memory(problem: LibraryProblem, values: np.ndarray) -> bool:
    """Return whether a mechanism that depends on the inputs of other samples is switched on."""
    return (
        bool(_MECHANISMS_MIXING_SAMPLES & problem.find_active_mechanisms(values))
        and problem.case.recording.has_time
    )


def _perturb_problem(problem: LibraryProblem, pressure: np.ndarray, length: np.ndarray) -> LibraryProblem:
    """Return the problem with noise added to pressure and length."""
    n, rows = problem.n, problem.dataset.rows
    rows = dataclasses.replace(
        rows, pressure=rows.pressure.at[:n].add(pressure), length=rows.length.at[:n].add(length)
    )
    return dataclasses.replace(problem, dataset=dataclasses.replace(problem.dataset, rows=rows))
