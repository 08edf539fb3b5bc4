"""Coordinates of the rows of a recording: pressure, contraction, time and motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem

SHORTENING, STILL, LENGTHENING = -1, 0, 1


@dataclass(frozen=True, eq=False)
class RecordingAxes:
    """Coordinates of each row of a recording.

    Attributes:
        pressure: (n,) Pa.
        contraction: (n,) 1 − length / rest length.
        time: (n,) s; row numbers in a static table.
        motion: (n,) −1 shortening, 0 at rest, 1 lengthening.
    """

    pressure: np.ndarray
    contraction: np.ndarray
    time: np.ndarray
    motion: np.ndarray


def build_axes(problem: LibraryProblem) -> RecordingAxes:
    """Return the coordinates by which a misfit is located."""
    recording = problem.case.recording
    rest_length = problem.case.muscle_toml.rest_length.value
    time = recording.time if recording.time is not None else np.arange(problem.n, dtype=float)
    rate = np.asarray(problem.dataset.history.rate(problem.dataset.rows.length))[: problem.n]
    # Noise of the length must not count as motion: the residual contains the same noise.
    rate_noise = np.sqrt(np.sum(np.square(np.asarray(problem.dataset.history.rate_weights)), axis=1))[
        : problem.n
    ]
    sensor = problem.case.muscle_toml.sensors
    noise = (
        0.0
        if sensor.length_per_level
        else problem.settings.min_speed_noise_sd * (sensor.length or 0.0) * rate_noise
    )
    min_speed = np.maximum(
        problem.settings.min_speed_share * float(np.nanquantile(np.abs(rate), 0.95)), noise
    )
    is_moving = np.abs(rate) > min_speed
    motion = np.where(is_moving, np.sign(rate), STILL).astype(int)
    return RecordingAxes(recording.pressure, 1 - recording.length / rest_length, time, motion)
