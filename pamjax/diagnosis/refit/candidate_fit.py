"""A baseline with some forms of the library, refitted under the noise that its own residual shows."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import NoiseModel, estimate_noise
from pamjax.diagnosis.refit.errors_in_variables import correct_input_noise_bias
from pamjax.diagnosis.refit.least_squares import START_LIMIT_DISTANCE_SHARE, MapEstimate, fit_parameters


@dataclass(frozen=True, eq=False)
class CandidateFit:
    """A baseline with names, refitted.

    Attributes:
        mechanisms: the forms that are in, in the order in which they came.
        noise: the noise, as read off this model's residual.
        estimate: the refit.
        input_noise_chi2: χ² that noise of what was set is expected to leave beyond what the weights know of.
        between_model_covariance: (k, k) covariance of the numbers that moved, SI, among models that are told
            apart no better.
        errors_in_variables_bias: (k,) how far noise of what was set moves them, SI.
    """

    mechanisms: tuple[Candidate, ...]
    noise: NoiseModel
    estimate: MapEstimate
    input_noise_chi2: float = 0.0
    between_model_covariance: np.ndarray | float = 0.0
    errors_in_variables_bias: np.ndarray | float = 0.0

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(candidate.id for candidate in self.mechanisms)

    @property
    def corrected_chi2(self) -> float:
        """χ² freed of what the model makes of noise: averaging neighbours explains nothing.

        Forgiven is only what is there: no model's χ² falls below what noise leaves by that.
        """
        noise_chi2 = self.noise.weight**2 * self.noise.size - len(self.estimate.free)
        return self.estimate.cost - min(self.input_noise_chi2, max(self.estimate.cost - noise_chi2, 0.0))

    @property
    def bic(self) -> float:
        """χ² with the price of its numbers: ln n for each beyond the baseline's (Schwarz).

        What the lab's own statement of its muscle asks for is not paid twice.
        """
        extra = sum(len(candidate.free_parameters) for candidate in self.mechanisms)
        stated_chi2 = sum(candidate.stated_chi2 for candidate in self.mechanisms)
        return self.corrected_chi2 + extra * np.log(max(self.noise.size, 2)) - stated_chi2

    @property
    def full_bic(self) -> float:
        """The score of a model among others that see other noise: minus twice its log-likelihood, priced."""
        return self.bic + self.noise.log_determinant

    @property
    def excess_chi2(self) -> float:
        """χ² beyond what noise leaves."""
        return max(self.estimate.chi2 - self.input_noise_chi2 - self.noise.size, 0.0)

    @property
    def variance_inflation(self) -> float:
        """Factor on a variance where the model leaves more than noise."""
        return max(self.estimate.chi2 / max(self.noise.size, 1), 1.0)

    @property
    def covariance(self) -> np.ndarray:
        """Of the numbers that moved, SI, (k, k)."""
        return self.within_model_covariance + self.between_model_covariance

    @property
    def within_model_covariance(self) -> np.ndarray:
        """The same, of this one model: what others as good disagree about is left out."""
        return self.variance_inflation * self.estimate.covariance + np.multiply.outer(
            self.errors_in_variables_bias, self.errors_in_variables_bias
        )

    def sd(self, index: int) -> float:
        """Standard deviation of a number, SI; NaN where it did not move."""
        if index not in self.estimate.free:
            return float("nan")
        k = self.estimate.free.index(index)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))


def fit_candidate(
    problem: LibraryProblem,
    training_rows: np.ndarray,
    mechanisms: Sequence[Candidate],
    values: np.ndarray,
    rounds: int = 2,
) -> CandidateFit:
    """Refit the baseline with some forms, with the noise that its own residual shows."""
    free = get_free_indices(problem, mechanisms)
    for _ in range(rounds):
        noise = estimate_noise(problem, values, training_rows)
        estimate = fit_parameters(problem, noise, free, values)
        values = estimate.values
    return build_corrected_fit(problem, tuple(mechanisms), noise, estimate)


def build_corrected_fit(
    problem: LibraryProblem, mechanisms: tuple[Candidate, ...], noise: NoiseModel, estimate: MapEstimate
) -> CandidateFit:
    """A refitted model, without what it makes of noise."""
    return CandidateFit(mechanisms, noise, *correct_input_noise_bias(problem, noise, estimate))


def get_parameter_indices(problem: LibraryProblem, mechanisms: Sequence[Candidate]) -> list[int]:
    """Indices of the numbers that some forms move."""
    return [problem.index(name) for candidate in mechanisms for name in candidate.free_parameters]


def get_free_indices(problem: LibraryProblem, mechanisms: Sequence[Candidate]) -> list[int]:
    """Indices of the numbers that a refit with some forms moves: the baseline's own and theirs."""
    return sorted(
        {*np.flatnonzero(problem.is_baseline).tolist(), *get_parameter_indices(problem, mechanisms)}
    )


def switch_on_candidate(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate, amplitudes: np.ndarray
) -> np.ndarray:
    """Values with a form switched on at its best amplitudes in the linear limit, within its limits."""
    out = values.copy()
    for name, value in candidate.shape.items():
        k = problem.index(name)
        out[k] = np.clip(value, problem.low[k], problem.high[k])
    for name, value in zip(candidate.amplitudes, amplitudes, strict=True):
        k = problem.index(name)
        # The minimiser creeps away from a limit at which it starts.
        limit_range = problem.high[k] - problem.low[k]
        out[k] = np.clip(
            value,
            problem.low[k] + 1e-6 * limit_range,
            problem.high[k] - START_LIMIT_DISTANCE_SHARE * limit_range,
        )
    return out


def switch_off_candidate(problem: LibraryProblem, values: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Values with a form switched off."""
    out = values.copy()
    for name in candidate.free_parameters:
        k = problem.index(name)
        out[k] = problem.neutral[k]
    return out


def compute_effect(problem: LibraryProblem, fit: CandidateFit, candidate: Candidate) -> np.ndarray:
    """What a form alone does to the recording, beyond what a refitted baseline makes up for, SI, (2, n)."""
    values = fit.estimate.values
    for other in fit.mechanisms:
        values = values if other is candidate else switch_off_candidate(problem, values, other)
    alone = problem.predict(values)
    unmeasured = np.isnan(problem.measured)
    as_measured = dataclasses.replace(problem, measured=np.where(unmeasured, np.nan, alone))
    baseline_indices = np.flatnonzero(problem.is_baseline).tolist()
    baseline_estimate = fit_parameters(
        as_measured, fit.noise, baseline_indices, switch_off_candidate(problem, values, candidate)
    )
    return alone - problem.predict(baseline_estimate.values)
