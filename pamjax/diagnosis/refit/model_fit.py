"""Refit of the baseline with candidate mechanisms, with noise estimated from its own residual."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.errors_in_variables import correct_input_noise_bias
from pamjax.diagnosis.refit.least_squares import MapEstimate, fit_parameters
from pamjax.infer.noise.autocorrelation import compute_variance_inflation
from pamjax.infer.noise.noise_model import NoiseModel

#: Refits, each with the noise of the residual before it.
_NOISE_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class ModelFit:
    """Fit of a model: the baseline with some mechanisms, or the baseline alone.

    Attributes:
        mechanisms: the mechanisms in the model, each in the form that was added, in the order of addition.
        noise: noise model, estimated from the residual of this model.
        estimate: the estimated parameters.
        input_noise_chi2: expected χ² due to input noise that the noise model does not include.
        between_model_covariance: (k, k) what other models that fit equally well, and form errors, add to the
            covariance of the free parameters, SI.
        errors_in_variables_bias: (k,) bias of the free parameters due to input noise, SI.
    """

    mechanisms: tuple[Candidate, ...]
    noise: NoiseModel
    estimate: MapEstimate
    input_noise_chi2: float = 0.0
    between_model_covariance: np.ndarray | float = 0.0
    errors_in_variables_bias: np.ndarray | float = 0.0

    @property
    def ids(self) -> tuple[str, ...]:
        """Return the ids of the mechanisms."""
        return tuple(candidate.id for candidate in self.mechanisms)

    @property
    def corrected_chi2(self) -> float:
        """Return the cost minus the expected χ² of input noise, at least the expected χ² of noise."""
        noise_chi2 = self.noise.weight**2 * self.noise.size - len(self.estimate.free)
        return self.estimate.chi2_with_priors - min(
            self.input_noise_chi2, max(self.estimate.chi2_with_priors - noise_chi2, 0.0)
        )

    @property
    def bic(self) -> float:
        """Return the Bayesian information criterion.

        It is the corrected χ² + ln n for each parameter that is not the baseline's.

        The χ² of stated values in favour of a mechanism is subtracted.
        """
        extra = sum(len(candidate.free_parameters) for candidate in self.mechanisms)
        stated_chi2 = sum(candidate.stated_chi2 for candidate in self.mechanisms)
        return self.corrected_chi2 + extra * np.log(max(self.noise.sample_count, 2)) - stated_chi2

    @property
    def full_bic(self) -> float:
        """Return the BIC with the log-determinant of the noise, to compare different noise models."""
        return self.bic + self.noise.log_determinant

    @property
    def excess_chi2(self) -> float:
        """Return the χ² above its expected value for noise alone."""
        return max(self.estimate.chi2 - self.input_noise_chi2 - self.noise.size, 0.0)

    @property
    def variance_inflation(self) -> float:
        """Return the mean square residual of a sample with systematic misfit; 1 without."""
        return 1 + max(self.estimate.chi2 - self.noise.size, 0.0) / max(self.noise.sample_count, 1.0)

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance of the free parameters, SI, (k, k)."""
        return self.within_model_covariance + self.between_model_covariance

    @property
    def within_model_covariance(self) -> np.ndarray:
        """Return the covariance within this model, SI, (k, k), with exact equations."""
        inflation = compute_variance_inflation(self.estimate.residual, self.noise.is_run_start)
        return self.estimate.compute_covariance(inflation) + np.multiply.outer(
            self.errors_in_variables_bias, self.errors_in_variables_bias
        )

    def sd(self, index: int) -> float:
        """Return the standard deviation of a parameter, SI; NaN if it was not free."""
        if index not in self.estimate.free:
            return float("nan")
        k = self.estimate.free.index(index)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))


def fit_model(
    problem: LibraryProblem,
    training_mask: np.ndarray,
    mechanisms: Sequence[Candidate],
    values: np.ndarray,
    max_noise_ratio: float | None = None,
) -> ModelFit:
    """Return the baseline refitted with some candidates, with noise estimated from its own residual.

    Args:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fit.
        mechanisms: the candidates.
        values: (p,) starting values, SI.
        max_noise_ratio: largest plausible ratio of true and stated noise; the setting if omitted.
    """
    free = get_free_indices(problem, mechanisms)
    ratio = problem.settings.max_noise_ratio if max_noise_ratio is None else max_noise_ratio
    for _ in range(_NOISE_ROUNDS):
        noise = estimate_noise(problem, values, training_mask, ratio)
        estimate = fit_parameters(problem, noise, free, values)
        values = estimate.values
    return build_corrected_fit(problem, tuple(mechanisms), noise, estimate)


def build_corrected_fit(
    problem: LibraryProblem, mechanisms: tuple[Candidate, ...], noise: NoiseModel, estimate: MapEstimate
) -> ModelFit:
    """Return the fit after correction of the bias due to input noise."""
    return ModelFit(mechanisms, noise, *correct_input_noise_bias(problem, noise, estimate))


def get_parameter_indices(problem: LibraryProblem, mechanisms: Sequence[Candidate]) -> list[int]:
    """Return the indices of the free parameters of some candidates."""
    return [problem.index(name) for candidate in mechanisms for name in candidate.free_parameters]


def get_free_indices(problem: LibraryProblem, mechanisms: Sequence[Candidate]) -> list[int]:
    """Return the indices of the free parameters of the baseline and of some candidates."""
    return sorted(
        {*np.flatnonzero(problem.is_baseline).tolist(), *get_parameter_indices(problem, mechanisms)}
    )


def switch_on_candidate(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate, amplitudes: np.ndarray
) -> np.ndarray:
    """Return values with a candidate switched on at some amplitudes, clipped to their limits."""
    out = problem.set_shape(values, candidate.shape)
    for name, value in zip(candidate.amplitudes, amplitudes, strict=True):
        k = problem.index(name)
        # The minimiser is slow if it starts at a limit.
        limit_range = problem.high[k] - problem.low[k]
        out[k] = np.clip(
            value,
            problem.low[k] + 1e-6 * limit_range,
            problem.high[k] - problem.settings.start_limit_distance_share * limit_range,
        )
    return out


def switch_off_candidate(problem: LibraryProblem, values: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Return values with a candidate switched off."""
    out = values.copy()
    for name in candidate.free_parameters:
        k = problem.index(name)
        out[k] = problem.neutral[k]
    return out


def compute_unabsorbed_effect(problem: LibraryProblem, fit: ModelFit, candidate: Candidate) -> np.ndarray:
    """Return the part of a candidate's effect that a refit of the baseline does not absorb, SI, (2, n)."""
    values = fit.estimate.values
    for other in fit.mechanisms:
        values = values if other is candidate else switch_off_candidate(problem, values, other)
    alone = problem.predict(values)
    is_missing = np.isnan(problem.measured)
    as_measured = dataclasses.replace(problem, measured=np.where(is_missing, np.nan, alone))
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    baseline_estimate = fit_parameters(
        as_measured, fit.noise, baseline_indices, switch_off_candidate(problem, values, candidate)
    )
    return alone - problem.predict(baseline_estimate.values)
