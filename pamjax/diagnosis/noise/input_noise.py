"""What noise of pressure and length does to a misfit once a mechanism with a memory has passed it on.

Weights are made for a muscle that passes such noise on sample by sample. A delay between samples
averages neighbours, and a rate is their difference: the noise of what they show is less, or more, and
with it the χ² of a misfit that is nothing but noise,

    E χ²(m) − E χ²(0) = E |W [f_m(x + u) − f_m(x)]|² − E |W (∂f_0/∂x) u|²,

f_m the model, f_0 its bare muscle, W the weights, u the sensors' noise in what was set, x. Two models
are told apart by what is left when each is freed of its own. Untold, a delay by half a sample explains
thousands of rows better than the truth.

The mean over u is taken with signs, ±sd, the same for every model. Four draws carry the rows of a
Hadamard matrix, so that no product of neighbours, nor of pressure and length, is left in it.

A model that would make very much of noise is not forgiven more than a tenth of the samples: noise on a path
that has it already then says little of noise on the true one, and a model whose answer hangs on every sample
would be forgiven anything.
Source: derived here; signs as M. F. Hutchinson, Commun. Stat. Simul. 18, 1059 (1989); Hadamard's rows as
C. Bekas, E. Kokiopoulou, Y. Saad, Appl. Numer. Math. 57, 1214 (2007).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.linalg import hadamard

from pamjax.diagnosis.library.candidates import MECHANISMS_NEEDING_TIME
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.infer.noise.sensor_noise import compute_sensitivities

#: Draws, a power of two, and their seed: every model sees the same.
INPUT_NOISE_DRAWS, INPUT_NOISE_SEED = 4, 7
#: Most that is taken off a model's χ², as a share of its samples.
MAX_CHI2_CREDIT_SHARE = 0.1


def compute_input_noise_chi2(
    problem: LibraryProblem, whiten: Callable[[np.ndarray], np.ndarray], values: np.ndarray
) -> float:
    """χ² that a model is expected to leave beyond its bare muscle, by noise of what was set alone.

    Args:
        problem: the recording before the library.
        whiten: the weights, `NoiseModel.whiten`.
        values: (p,) all numbers, SI.

    Returns:
        zero where nothing remembers, or no such noise is stated; negative for a model that averages; at most
        `MAX_CHI2_CREDIT_SHARE` of the samples.
    """
    propagated = propagate_input_noise(problem, values)
    if propagated is None:
        return 0.0
    by_pressure, by_length = (
        np.asarray(s)[:, : problem.n] for s in compute_sensitivities(problem.dataset, jnp.asarray(values))
    )
    total, size = 0.0, 0
    for difference, (pressure, length) in zip(propagated, sample_input_noise(problem), strict=True):
        whitened, bare = (
            whiten(difference),
            whiten(np.nan_to_num(by_pressure * pressure + by_length * length)),
        )
        total, size = total + float(whitened @ whitened - bare @ bare), whitened.size
    return min(total / INPUT_NOISE_DRAWS, MAX_CHI2_CREDIT_SHARE * size)


def propagate_input_noise(problem: LibraryProblem, values: np.ndarray) -> np.ndarray | None:
    """What each draw of noise does to what is shown, (draws, 2, n), SI; None where
    `compute_input_noise_chi2` is zero.
    """
    perturbed = build_perturbed_problems(problem, values)
    if not perturbed:
        return None
    prediction = problem.predict(values)
    return np.nan_to_num(
        np.stack([perturbed_problem.predict(values) - prediction for perturbed_problem in perturbed])
    )


def build_perturbed_problems(problem: LibraryProblem, values: np.ndarray) -> list[LibraryProblem]:
    """The problem with each draw of noise in what was set; none where `compute_input_noise_chi2` is zero."""
    if not _has_memory(problem, values) or not any(_get_input_noise_sd(problem)):
        return []
    return [_perturb_problem(problem, *draw) for draw in sample_input_noise(problem)]


def compute_input_noise_gradient(
    problem: LibraryProblem, whiten: Callable[[np.ndarray], np.ndarray], values, indices
) -> np.ndarray:
    """Derivative of `compute_input_noise_chi2` by some numbers, (k,), SI, but for the bare muscle's share."""
    prediction, jacobian = problem.jacobian(values, indices)
    total = np.zeros(len(indices))
    for draw in sample_input_noise(problem):
        perturbed_prediction, perturbed_jacobian = _perturb_problem(problem, *draw).jacobian(values, indices)
        whitened_difference, whitened_jacobian = (
            whiten(np.nan_to_num(perturbed_prediction - prediction)),
            whiten(np.nan_to_num(perturbed_jacobian - jacobian)),
        )
        total += 2 * whitened_jacobian @ whitened_difference
    return total / INPUT_NOISE_DRAWS


def sample_input_noise(problem: LibraryProblem) -> list[tuple[np.ndarray, np.ndarray]]:
    """What is added to pressure and to length, (n,) each, draw by draw, SI."""
    pressure, length = _get_input_noise_sd(problem)
    signs = np.random.default_rng(INPUT_NOISE_SEED).choice([-1.0, 1.0], (2, problem.n))
    position = np.arange(problem.n) % (INPUT_NOISE_DRAWS // 2)
    return [
        (pressure * signs[0] * row[position], length * signs[1] * row[INPUT_NOISE_DRAWS // 2 + position])
        for row in hadamard(INPUT_NOISE_DRAWS)
    ]


def _get_input_noise_sd(problem: LibraryProblem) -> tuple[float, float]:
    """Noise of pressure and of length from sample to sample, SI."""
    sensors = problem.case.entry.sensors
    return sensors.pressure or 0.0, 0.0 if sensors.length_per_setting else sensors.length or 0.0


def _has_memory(problem: LibraryProblem, values: np.ndarray) -> bool:
    """Whether a mechanism that looks at other samples is switched on."""
    return bool(MECHANISMS_NEEDING_TIME & problem.active(values)) and problem.case.recording.has_time


def _perturb_problem(problem: LibraryProblem, pressure: np.ndarray, length: np.ndarray) -> LibraryProblem:
    """The problem with something added to what was set."""

    def perturb(dataset):
        n, rows = problem.n, dataset.rows
        rows = dataclasses.replace(
            rows, pressure=rows.pressure.at[:n].add(pressure), length=rows.length.at[:n].add(length)
        )
        return dataclasses.replace(dataset, rows=rows)

    return dataclasses.replace(
        problem, dataset=perturb(problem.dataset), reduced_dataset=perturb(problem.reduced_dataset)
    )
