"""Fit with the noise that neighbouring samples show, for a test of its residual.

A sensor that is noisier than stated is no missing physics, so it must not be detected as misfit.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.diagnosis.refit.least_squares import evaluate_estimate


def scale_noise(problem: LibraryProblem, fit: CandidateFit) -> CandidateFit:
    """Return a fit whose stated noise is scaled to the noise that neighbouring samples show.

    Args:
        problem: the recording and the library.
        fit: the fit with stated noise; its parameters stay.
    """
    rows = np.zeros(problem.n, dtype=bool)
    rows[np.concatenate(fit.noise.rows)] = True
    values = fit.estimate.values
    channels = estimate_noise(problem, values, rows, free_scale=True).channels
    noise = dataclasses.replace(fit.noise, channels=channels)
    estimate = evaluate_estimate(problem, noise, fit.estimate.free, values)
    return dataclasses.replace(fit, noise=noise, estimate=estimate)
