"""Noise model of the recording under diagnosis, from the residual of its model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.average_noise import average_noise
from pamjax.diagnosis.noise.input_noise import propagate_input_noise
from pamjax.diagnosis.noise.turn_variance import estimate_turn_variance
from pamjax.infer.noise.estimate import compute_noise_variances, estimate_noise_model, number_runs
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.static_table import TableVariance, estimate_table_variance
from pamjax.infer.problem.dataset import CHANNELS, Dataset


def estimate_noise(
    problem: LibraryProblem, values: np.ndarray, training_mask: np.ndarray, max_noise_ratio: float = 1.0
) -> NoiseModel:
    """Return the noise model, estimated from the residual at some parameter values.

    The noise of means is computed from that of the samples.

    Args:
        problem: the recording and the library.
        values: (p,) parameter values, SI.
        training_mask: (n,) whether a row is used in the fit.
        max_noise_ratio: largest plausible ratio of true and stated noise of a sensor; 1 if it is exact.
    """
    samples = problem.samples
    if samples is None:
        noise = _estimate_sample_noise(problem, values, training_mask, max_noise_ratio)
    else:
        sample_mask = training_mask[samples.averages.group]
        sample_noise = _estimate_sample_noise(samples.problem, values, sample_mask, max_noise_ratio)
        noise = average_sample_noise(problem, sample_noise, training_mask)
    turn_variance = estimate_turn_variance(problem, values)
    return noise if turn_variance is None else noise.add_row_variance(turn_variance)


def average_sample_noise(
    problem: LibraryProblem, sample_noise: NoiseModel, training_mask: np.ndarray
) -> NoiseModel:
    """Return the noise of the rows of a problem, which are means, from the noise of its samples.

    Args:
        problem: the means, and the library.
        sample_noise: noise of the samples.
        training_mask: (n,) whether a mean is used in the fit.
    """
    assert problem.samples is not None
    return average_noise(
        sample_noise,
        problem.samples.averages,
        problem.channels,
        np.isfinite(problem.measured) & training_mask,
        number_runs(problem.case.recording.is_run_start, training_mask),
    )


def _estimate_sample_noise(
    problem: LibraryProblem, values: np.ndarray, training_mask: np.ndarray, max_noise_ratio: float
) -> NoiseModel:
    return estimate_noise_model(
        problem.case,
        problem.measured - problem.predict(values),
        np.isfinite(problem.measured),
        training_mask,
        compute_noise_variances(
            problem.case, problem.dataset, values, lambda dataset: predict_dataset(problem, dataset, values)
        ),
        tables=_estimate_table_variances(problem, training_mask),
        input_noise=propagate_input_noise(problem, values),
        settings=problem.settings,
        max_noise_ratio=max_noise_ratio,
    )


def predict_dataset(problem: LibraryProblem, dataset: Dataset, values: np.ndarray) -> np.ndarray:
    """Return both predicted channels of the problem with other inputs, (2, rows of the program), SI.

    Args:
        problem: the recording and the library.
        dataset: its dataset with other pressures, lengths or set forces.
        values: (p,) parameter values, SI.
    """
    prediction = replace(problem, dataset=dataset).predict(values)
    padding = dataset.rows.pressure.size - prediction.shape[1]
    return np.pad(prediction, ((0, 0), (0, padding)))


def _estimate_table_variances(
    problem: LibraryProblem, training_mask: np.ndarray
) -> list[TableVariance | None]:
    """Return the noise variance of a static table by channel; None for a recording with time.

    It uses the misfit of the neutral muscle: a model fitted to few rows would underestimate the noise.
    """
    recording = problem.case.recording
    if recording.has_time:
        return [None] * len(CHANNELS)
    misfit = problem.measured - problem.predict(problem.neutral)
    rows_by_channel = [np.isfinite(misfit[c]) & training_mask for c in range(len(CHANNELS))]
    # In an isotonic test the length is a reading: force and pressure are set.
    second_input = recording.force if recording.measures_length else recording.length
    return [
        estimate_table_variance(recording.pressure[rows], second_input[rows], misfit[c, rows])
        for c, rows in enumerate(rows_by_channel)
    ]
