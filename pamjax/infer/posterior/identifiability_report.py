"""Identifiability of each parameter, from its posterior and its profile likelihood.

| verdict                        | condition                                                                 |
|--------------------------------|---------------------------------------------------------------------------|
| at a limit                     | `_MIN_DRAWS_AT_LIMIT` of draws are within `_LIMIT_DISTANCE_SD` of a bound |
| determined by the data         | its profile has two ends, and its sd is at most half the prior sd         |
| one-sided                      | its profile has one end                                                   |
| determined only in combination | it would be determined if the other parameters were known                 |
| by its sd over the prior sd    | otherwise: one of the three cases of `fit`, see `determination.py`        |

The priors are those of the posterior, including `--priors`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.infer.fitting.determination import (
    DETERMINED,
    MAX_SD_RATIO_DETERMINED,
    NOT_DETERMINED,
    PARTLY_DETERMINED,
    classify_sd_ratio,
)
from pamjax.infer.fitting.result import Fit
from pamjax.infer.posterior.profile import (
    CHI2_RISE_95,
    LikelihoodProfile,
    ProfileProblem,
    build_profile_problem,
    compute_profile,
)
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.priors import is_length_error
from pamjax.units import format_quantity

#: Verdict for a parameter that the recording determines only together with others.
COMBINATION_KIND = "determined only in combination"
#: Fraction of draws within `_LIMIT_DISTANCE_SD` sds of the bound: 0.24 for half a Gaussian at the bound, 0.39
#: for an exponential, 0.14 for a uniform distribution. An sd above `_MAX_SPREAD_AT_LIMIT` of the range (0.29
#: for a uniform distribution) is not a value at a bound.
_MIN_DRAWS_AT_LIMIT, _LIMIT_DISTANCE_SD, _MAX_SPREAD_AT_LIMIT = 0.2, 0.5, 0.2
#: Parameters with a larger correlation may be determined only in combination.
_MIN_PARTNER_CORRELATION = 0.3
#: A combination is reported as a product if no exponent differs from one by more than this factor.
_MAX_PRODUCT_EXPONENT = 3.0


@dataclass(frozen=True, eq=False)
class Verdict:
    """Identifiability of one parameter.

    Attributes:
        kind: how well it is determined.
        detail: the bound, combination or sd ratio in words; may be empty.
        profile: its profile likelihood.
    """

    kind: str
    detail: str
    profile: LikelihoodProfile

    def __str__(self) -> str:
        return f"{self.kind} ({self.detail})" if self.detail else self.kind


@dataclass(frozen=True, eq=False)
class ParameterSummary:
    """Prior and best fit of one parameter.

    Attributes:
        low, high: bounds, SI.
        log_scale: whether it has a logarithmic scale.
        unit: display unit.
        value: best fit, SI.
        prior_sd: sd of the prior, SI; for a uniform prior, sd of the whole range.
        determined_alone: whether the recording would determine it if all others were known.
    """

    low: float
    high: float
    log_scale: bool
    unit: str
    value: float
    prior_sd: float
    determined_alone: bool

    def compute_range_position(self, draws: np.ndarray) -> np.ndarray:
        """Return positions of draws between the bounds, on the parameter's own scale, in (0, 1)."""
        if self.log_scale:
            return np.log(draws / self.low) / np.log(self.high / self.low)
        return (draws - self.low) / (self.high - self.low)


def _summarise_parameter(problem: ProfileProblem, name: str, unit: str) -> ParameterSummary:
    space, k = problem.space, problem.space.names.index(name)
    low, high, sd, value = (float(a[k]) for a in (space.low, space.high, space.sd, problem.values))
    value_range = value * math.log(high / low) if space.log_scale[k] else high - low
    prior_sd = sd if math.isfinite(sd) else value_range / math.sqrt(12)
    information = max(float(problem.solution.information[k, k]), 1e-300)
    determined_alone = (
        abs(float(problem.solution.slope[k])) / math.sqrt(information) < MAX_SD_RATIO_DETERMINED * prior_sd
    )
    return ParameterSummary(low, high, space.log_scale[k], unit, value, prior_sd, determined_alone)


def build_verdicts(fit: Fit, space: ParameterSpace, draws: np.ndarray) -> dict[str, Verdict]:
    """Return a verdict for each of the muscle's parameters.

    Args:
        fit: the fit from which the posterior started.
        space: the posterior's parameters; the fit's come first.
        draws: (n, p) values, SI.
    """
    problem = build_profile_problem(fit, space)
    names = [n for n in fit.estimates if not is_length_error(n)]
    profiles = {n: compute_profile(problem, n) for n in names}
    summaries = {n: _summarise_parameter(problem, n, fit.estimates[n].meaning.show) for n in names}
    kinds = {n: _classify_parameter(summaries[n], draws[:, space.names.index(n)], profiles[n]) for n in names}
    undetermined = [n for n in names if kinds[n][0] in (NOT_DETERMINED, "one-sided")]
    undetermined_draws = draws[:, [space.names.index(n) for n in undetermined]]
    verdict_by_name = {}
    for name, (kind, detail) in kinds.items():
        if (
            name in undetermined
            and summaries[name].determined_alone
            and (partners := _find_partners(name, undetermined, undetermined_draws))
        ):
            kind, detail = (
                COMBINATION_KIND,
                _describe_combination(summaries, name, partners, undetermined, undetermined_draws),
            )
        elif kind == NOT_DETERMINED:
            kind, detail = _describe_prior_share(draws[:, space.names.index(name)], summaries[name])
        verdict_by_name[name] = Verdict(kind, detail, profiles[name])
    return verdict_by_name


def _classify_parameter(
    summary: ParameterSummary, draws: np.ndarray, profile: LikelihoodProfile
) -> tuple[str, str]:
    position = summary.compute_range_position(draws)
    limit_distance = _LIMIT_DISTANCE_SD * position.std()
    for end, is_near in (
        (summary.low, position < limit_distance),
        (summary.high, position > 1 - limit_distance),
    ):
        if is_near.mean() > _MIN_DRAWS_AT_LIMIT and position.std() < _MAX_SPREAD_AT_LIMIT:
            return "at a limit", format_quantity(end, summary.unit)
    if profile.low is not None and profile.high is not None:
        if (profile.high - profile.low) / (
            2 * math.sqrt(CHI2_RISE_95)
        ) < MAX_SD_RATIO_DETERMINED * summary.prior_sd:
            return DETERMINED, ""
    elif profile.low is not None or profile.high is not None:
        end = profile.low if profile.low is not None else profile.high
        assert end is not None
        return (
            "one-sided",
            f"{'above' if profile.low is not None else 'below'} {format_quantity(end, summary.unit, 3)}",
        )
    return NOT_DETERMINED, ""


def _describe_prior_share(draws: np.ndarray, summary: ParameterSummary) -> tuple[str, str]:
    """Return the verdict by the sd of the draws over that of the prior, as in `fit`, and the reason."""
    sd_ratio = float(draws.std()) / summary.prior_sd
    kind = classify_sd_ratio(sd_ratio)
    details = {
        NOT_DETERMINED: "posterior equals prior",
        PARTLY_DETERMINED: f"sd {100 * sd_ratio:.0f} % of the prior sd",
    }
    return kind, details.get(kind, "")


def _find_partners(name: str, undetermined: Sequence[str], draws: np.ndarray) -> list[int]:
    """Return indices of the undetermined parameters correlated with this one and its own; or none."""
    if len(undetermined) == 1:
        return []
    index = undetermined.index(name)
    correlation = np.abs(np.corrcoef(draws, rowvar=False)[index])
    partners = [k for k in range(len(undetermined)) if correlation[k] > _MIN_PARTNER_CORRELATION]
    return partners if len(partners) > 1 else []


def _describe_combination(
    summaries: Mapping[str, ParameterSummary],
    name: str,
    partners: Sequence[int],
    undetermined: Sequence[str],
    draws: np.ndarray,
) -> str:
    """Return the combination that the recording determines, or the joint change that it does not detect.

    Args:
        summaries: prior and best fit of each parameter.
        name: the parameter.
        partners: indices in `undetermined` of the combined parameters, with its own.
        undetermined: names of parameters that are not determined individually.
        draws: (n, len(undetermined)) values, SI.
    """
    index = undetermined.index(name)
    partner_summaries = [summaries[undetermined[k]] for k in partners]
    x = draws[:, partners]
    if (x > 0).all() and all(t.low > 0 for t in partner_summaries):
        prior_sd = np.array([t.prior_sd / t.value for t in partner_summaries])
        _, axes = np.linalg.eigh(np.cov(np.log(x) / prior_sd, rowvar=False))
        power = axes[:, 0] / prior_sd
        power = power / power[partners.index(index)]
        if np.all((np.abs(power) < _MAX_PRODUCT_EXPONENT) & (np.abs(power) > 1 / _MAX_PRODUCT_EXPONENT)):
            product = np.exp(np.log(x) @ power)
            relative_sd = f"{100 * product.std() / product.mean():.2g} %"
            return (
                f"{_format_product([undetermined[k] for k in partners], power)}, determined to {relative_sd}"
            )
    prior_sd = np.array([t.prior_sd for t in partner_summaries])
    _, axes = np.linalg.eigh(np.cov(x / prior_sd, rowvar=False))
    changes = axes[:, -1] * np.sign(axes[partners.index(index), -1]) * prior_sd
    words = [
        f"{undetermined[k]} {'+' if m > 0 else ''}{format_quantity(m, t.unit, 2)}"
        for k, m, t in zip(partners, changes, partner_summaries, strict=True)
    ]
    return f"the joint change {', '.join(words[:-1])} and {words[-1]} is not detectable"


def _format_product(names: Sequence[str], power: np.ndarray) -> str:
    """Return a product as text, such as "a × b" or "a / b^0.7"."""
    text = ""
    for name, p in zip(names, power, strict=True):
        size = "" if abs(abs(p) - 1) < 0.1 else f"^{abs(p):.2g}"
        text += f"{(' × ' if p > 0 else ' / ') if text else ('' if p > 0 else '1 / ')}{name}{size}"
    return text
