"""Noise models, estimates and fits of plain arrays, for tests of functions that only read them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.refit.least_squares import MapEstimate
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel


def build_noise(force: Ar1Noise, diameter: Ar1Noise | None = None, weight: float = 1.0) -> NoiseModel:
    """Return the noise of channels that were read in every row, in one run; None without readings."""
    channels = (force, diameter)
    n = force.sd.size
    rows = tuple(np.arange(0 if channel is None else n) for channel in channels)
    runs = tuple(np.zeros((0, 2), int) if channel is None else np.array([[0, n]]) for channel in channels)
    return NoiseModel(channels, rows, runs, weight)


def build_white_noise(n: int, weight: float = 1.0) -> NoiseModel:
    """Return white noise of the force of 1 N in n rows; the diameter was not read."""
    return build_noise(Ar1Noise(np.ones(n), 1.0, 0.0, True), weight=weight)


def build_estimate(
    values: Sequence[float] | np.ndarray,
    free: Sequence[int] = (),
    *,
    chi2: float = 0.0,
    residual: np.ndarray | None = None,
    jacobian: np.ndarray | None = None,
    prior_sd: np.ndarray | None = None,
) -> MapEstimate:
    """Return an estimate; its χ² has no part of the priors, and its coordinates are the values themselves."""
    residual = np.zeros(1) if residual is None else residual
    return MapEstimate(
        free=tuple(free),
        values=np.asarray(values, float),
        chi2_with_priors=chi2,
        chi2=chi2,
        residual=residual,
        evaluate_jacobian=lambda: np.zeros((residual.size, len(free))) if jacobian is None else jacobian,
        prior_sd=np.ones(len(free)) if prior_sd is None else prior_sd,
        scale=np.ones(len(free)),
    )


def build_fit(
    values: Sequence[float] | np.ndarray = (),
    free: Sequence[int] = (),
    *,
    mechanisms: tuple[Candidate, ...] = (),
    n: int = 1,
    input_noise_chi2: float = 0.0,
    weight: float = 1.0,
    **estimate,
) -> ModelFit:
    """Return a fit of n forces with white noise; see `build_estimate`."""
    return ModelFit(
        mechanisms, build_white_noise(n, weight), build_estimate(values, free, **estimate), input_noise_chi2
    )
