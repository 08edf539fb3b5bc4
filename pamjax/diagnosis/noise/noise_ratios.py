"""Ratio of the noise that a recording shows to the noise that follows from the stated sensors.

A sensor that is noisier than stated is no missing physics. Differences of neighbouring samples show its
noise, if the misfit of the model is smooth from sample to sample. The ratio is that of effective standard
deviations: of the sensor, with the noise of pressure and length propagated through the model.
Neglects: recordings in a static table, and channels with few samples; their ratio is 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.infer.problem.informative_samples import get_stated_sds
from pamjax.records.case import Case
from pamjax.text import join_words


def compute_noise_ratios(problem: LibraryProblem, values: np.ndarray) -> dict[str, float | None]:
    """Return by measured channel the estimated over the stated noise sd; None if no noise is stated.

    Args:
        problem: the recording and the library.
        values: (p,) estimate of the final model, SI.
    """
    rows = np.ones(problem.n, dtype=bool)
    stated_noise, estimated_noise = (
        estimate_noise(problem, values, rows, max_noise_ratio=ratio) for ratio in (1.0, math.inf)
    )
    return {
        channel: None
        if stated is None
        else estimated_noise.compute_rms_sd(c) / stated_noise.compute_rms_sd(c)
        for c, (channel, stated) in enumerate(
            zip(problem.channels, get_stated_sds(problem.case), strict=True)
        )
        if stated_noise.by_channel[c] is not None
    }


def list_unstated_inputs(case: Case) -> list[str]:
    """Return the inputs of the model whose sensors have no stated noise."""
    sensors = case.muscle_toml.sensors
    inputs = {"pressure": sensors.pressure}
    inputs |= {"force": sensors.force} if case.recording.measures_length else {"length": sensors.length}
    return [name for name, sd in inputs.items() if sd is None]


def format_noise_notes(
    ratios: dict[str, float | None], limit: float, unstated_inputs: Sequence[str] = ()
) -> list[str]:
    """Return a note for each channel whose noise differs from the stated noise.

    Args:
        ratios: by channel, the estimated over the stated noise sd.
        limit: a ratio above it, or below its inverse, is reported.
        unstated_inputs: inputs of the model without a stated noise, which can increase the ratio.
    """
    cause = ""
    if unstated_inputs:
        cause = f" The noise of {join_words(list(unstated_inputs))} adds to it, and is not stated there."
    return [
        f"The noise of {channel} is {ratio:.2f} times the stated noise (from neighbouring samples): check"
        f" `[sensors]`.{cause if ratio > 1 else ''}"
        for channel, ratio in ratios.items()
        if ratio is not None and not 1 / limit < ratio < limit
    ]
