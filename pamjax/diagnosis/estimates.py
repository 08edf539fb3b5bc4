"""Estimates of parameters in a diagnosis, and their shifts from the baseline to the improved model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import find_parameters_at_limit
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.fitting.determination import NOT_DETERMINED, classify_sd_ratio, compute_prior_scale
from pamjax.parameter import Meaning, get_display_unit
from pamjax.units import format_estimate, format_quantity


@dataclass(frozen=True)
class ParameterEstimate:
    """Estimate of a parameter with its standard deviation, SI; NaN if that is not defined, as at a limit."""

    value: float
    sd: float
    meaning: Meaning
    at_limit: bool = False
    limit_name: str = "limit"

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
        """Return whether the value is larger than its sd; a value at a limit has none."""
        return self.at_limit or abs(self.value) > self.sd

    def __str__(self) -> str:
        """Return value ± sd with its unit; a value at a limit has no sd."""
        unit = get_display_unit(self.meaning)[1]
        if self.at_limit:
            return f"{format_quantity(self.value, unit, 4)} (at its {self.limit_name})"
        return format_estimate(self.value, self.sd, unit)


def order_estimates(estimates: Mapping[str, ParameterEstimate]) -> list[tuple[str, ParameterEstimate]]:
    """Return the estimates of a mechanism: values above their sd first, undetermined ones last."""
    return sorted(estimates.items(), key=lambda item: (not item[1].is_determined, not item[1].is_above_sd))


@dataclass(frozen=True)
class ParameterShift:
    """Shift of a baseline parameter that the mechanisms cause.

    Attributes:
        baseline_value, model_value: estimates without and with the mechanisms, SI.
        shift_in_sd: their difference, in sd of the estimate without the mechanisms; NaN at a limit.
        meaning: unit, limits and meaning of the parameter.
    """

    baseline_value: float
    model_value: float
    shift_in_sd: float
    meaning: Meaning

    @property
    def order(self) -> float:
        """Return the absolute shift in sd, to sort by; a parameter without sd comes first."""
        return abs(self.shift_in_sd) if math.isfinite(self.shift_in_sd) else math.inf


def build_parameter_estimate(problem: LibraryProblem, fit: ModelFit, index: int) -> ParameterEstimate:
    """Return the estimate of a parameter, and whether it is at a limit that is not its neutral value.

    A parameter at such a limit has no standard deviation.
    """
    value, meaning = float(fit.estimate.values[index]), problem.meanings[index]
    at_limit = {fit.estimate.free[j] for j in find_parameters_at_limit(problem, fit.estimate)}
    limit_tolerance = problem.settings.at_limit_range_share * (problem.high[index] - problem.low[index])
    is_neutral = meaning.neutral is not None and abs(value - meaning.neutral) < limit_tolerance
    if index not in at_limit or is_neutral:
        return ParameterEstimate(value, fit.sd(index), meaning)
    is_lower = value - problem.low[index] < problem.high[index] - value
    return ParameterEstimate(value, math.nan, meaning, True, "lower limit" if is_lower else "upper limit")


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
        estimate = build_parameter_estimate(problem, baseline, k)
        shift_in_sd = (model_value - baseline_value) / estimate.sd if estimate.sd > 0 else 0.0
        if estimate.at_limit:
            shift_in_sd = math.nan
        shifts[problem.names[k]] = ParameterShift(
            float(baseline_value), float(model_value), float(shift_in_sd), problem.meanings[k]
        )
    return shifts
