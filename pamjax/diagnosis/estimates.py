"""Estimates of parameters in a diagnosis, and their shifts from the baseline to the improved model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.fitting.determination import NOT_DETERMINED, classify_sd_ratio, compute_prior_scale
from pamjax.parameter import Meaning


@dataclass(frozen=True)
class ParameterEstimate:
    """Estimate of a parameter with its standard deviation, SI; NaN if that is not defined."""

    value: float
    sd: float
    meaning: Meaning
    at_limit: bool = False

    @property
    def is_determined(self) -> bool:
        """Return whether its sd is clearly below that of its range; a value at a limit needs none."""
        if self.at_limit:
            return True
        scale = compute_prior_scale(math.inf, self.value, self.meaning)
        ratio = self.sd / scale if scale > 0 else math.inf
        return classify_sd_ratio(ratio) != NOT_DETERMINED

    @property
    def is_above_sd(self) -> bool:
        """Return whether the value is larger than its sd."""
        return abs(self.value) > self.sd


def order_estimates(estimates: Mapping[str, ParameterEstimate]) -> list[tuple[str, ParameterEstimate]]:
    """Return the estimates of a mechanism: values above their sd first, undetermined ones last."""
    return sorted(estimates.items(), key=lambda item: (not item[1].is_determined, not item[1].is_above_sd))


@dataclass(frozen=True)
class ParameterShift:
    """Shift of a baseline parameter that the mechanisms cause.

    Attributes:
        baseline_value, model_value: estimates without and with the mechanisms, SI.
        shift_in_sd: their difference, in sd of the estimate without the mechanisms.
        meaning: unit, limits and meaning of the parameter.
    """

    baseline_value: float
    model_value: float
    shift_in_sd: float
    meaning: Meaning


def build_parameter_estimate(problem: LibraryProblem, fit: ModelFit, index: int) -> ParameterEstimate:
    """Return the estimate of a parameter, and whether it is at a limit that is not its neutral value."""
    value, meaning = float(fit.estimate.values[index]), problem.meanings[index]
    at_limit = {fit.estimate.free[j] for j in find_parameters_at_limit(problem, fit.estimate)}
    limit_tolerance = problem.settings.at_limit_range_share * (problem.high[index] - problem.low[index])
    is_neutral = meaning.neutral is not None and abs(value - meaning.neutral) < limit_tolerance
    return ParameterEstimate(value, fit.sd(index), meaning, index in at_limit and not is_neutral)


def collect_mechanism_estimates(
    problem: LibraryProblem, fit: ModelFit
) -> dict[str, dict[str, ParameterEstimate]]:
    """Return the estimates of a model by mechanism id and parameter name."""
    return {
        candidate.id: {
            name.rpartition(".")[2]: build_parameter_estimate(problem, fit, problem.index(name))
            for name in candidate.free_parameters
        }
        for candidate in fit.mechanisms
    }


def compute_parameter_shifts(
    problem: LibraryProblem, baseline: ModelFit, fit: ModelFit
) -> dict[str, ParameterShift]:
    """Return the shifts of the baseline parameters by name, from a baseline to a model."""
    shifts = {}
    for k in baseline.estimate.free:
        baseline_value, model_value = baseline.estimate.values[k], fit.estimate.values[k]
        sd = baseline.sd(k)
        shift_in_sd = (model_value - baseline_value) / sd if sd > 0 else 0.0
        shifts[problem.names[k]] = ParameterShift(
            float(baseline_value), float(model_value), float(shift_in_sd), problem.meanings[k]
        )
    return shifts
