"""Control command for one wanted force: value, standard deviation and derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.control.command_uncertainty import (
    compute_force_sd,
    describe_fit_problems,
    find_uncertainty_source,
    list_parameters_at_limit,
    read_unexplained_force,
)
from pamjax.control.evaluate_command import evaluate_command
from pamjax.control.inverse import CommandLimit, Inverse
from pamjax.control.neglected import list_neglected
from pamjax.control.posterior_draws import INTERVAL_SHARE, CommandDistribution, PosteriorDraws
from pamjax.control.standalone import UNCERTAINTY_TEXTS
from pamjax.text import join_words
from pamjax.units import format_quantity

#: Share of the largest value below which a number is a rounding error, and tolerance of the calibrated range.
_ZERO_SHARE, _RANGE_TOLERANCE = 1e-9, 1e-3


@dataclass(frozen=True)
class CommandResult:
    """A control command with its uncertainty, SI.

    Attributes:
        quantity: the commanded quantity, "pressure" or "length".
        value: Pa or m; the nearest possible value if the limit is not OK.
        sd: standard deviation of the value; NaN if the uncertainty is unknown.
        force: wanted force, N.
        given_value: the given length, m, or pressure, Pa.
        slope_by_force, slope_by_given: derivatives of the value.
        stiffness: ∂F/∂L, N/m.
        stiffness_by_pressure, stiffness_by_length: derivatives of the stiffness, N/(m Pa) and N/m².
        limit: the active limit, or OK.
        distribution: distribution of the command over posterior draws; None without draws.
        unexplained_force: force error on held-out blocks beyond noise, N, part of `sd`; 0 if unknown.
        reached_force: force at the value, N.
        friction: half width of the friction loop at the value, N; not part of `sd`; 0 without friction.
        given_range: lowest and highest allowed value of the given length, m, or pressure, Pa.
        extrapolations: a sentence for pressure and for length outside the calibrated range.
        neglected_history: ids of neglected mechanisms of memory and speed.
        neglected_rig: ids of neglected mechanisms of sensors and rig.
        uncertainty: source of `sd`, a key of `standalone.UNCERTAINTY_TEXTS`.
        parameters_at_limit: names of the fitted parameters at their limits, which have no sd.
        fit_problems: a sentence on a large misfit of the fit and on these parameters, or None.
    """

    quantity: str
    value: float
    sd: float
    force: float
    given_value: float
    slope_by_force: float
    slope_by_given: float
    stiffness: float
    stiffness_by_pressure: float
    stiffness_by_length: float
    limit: CommandLimit
    distribution: CommandDistribution | None = None
    unexplained_force: float = 0.0
    reached_force: float = math.nan
    friction: float = 0.0
    given_range: tuple[float, float] = (-math.inf, math.inf)
    extrapolations: tuple[str, ...] = ()
    neglected_history: tuple[str, ...] = ()
    neglected_rig: tuple[str, ...] = ()
    uncertainty: str = "unknown"
    parameters_at_limit: tuple[str, ...] = ()
    fit_problems: str | None = None

    @property
    def friction_shift(self) -> float:
        """Return the largest change of the value by friction, Pa or m."""
        return abs(self.slope_by_force) * self.friction

    @property
    def reason(self) -> str:
        """Return the active limit as text, with the force at this limit."""
        ends = {
            CommandLimit.TOO_STRONG: ("above the maximum", "highest", "longest"),
            CommandLimit.TOO_WEAK: ("below the minimum", "lowest", "shortest"),
        }
        if self.limit == CommandLimit.OUTSIDE:
            given_name = "length" if self.quantity == "pressure" else "pressure"
            low, high = (format_quantity(end, self._units[1]) for end in self.given_range)
            given_text = format_quantity(self.given_value, self._units[1])
            return f"the {given_name} {given_text} is outside {low} to {high}"
        if self.limit not in ends:
            return self.limit.message
        comparison, pressure, length = ends[self.limit]
        end_text = f"{pressure} pressure, " if self.quantity == "pressure" else f"{length} length, "
        end_text += format_quantity(self.value, "kPa" if self.quantity == "pressure" else "mm")
        reached_force = format_quantity(self.reached_force, "N")
        return f"the force is {comparison} of {reached_force}, at the {end_text}"

    def as_dict(self) -> dict[str, Any]:
        """Return the command as a JSON document in SI units; a value that is not finite is None."""
        numbers = {
            "value": self.value,
            "sd": self.sd,
            "force": self.force,
            "given_value": self.given_value,
            "slope_by_force": self.slope_by_force,
            "slope_by_given": self.slope_by_given,
            "stiffness": self.stiffness,
            "stiffness_by_pressure": self.stiffness_by_pressure,
            "stiffness_by_length": self.stiffness_by_length,
            "unexplained_force": self.unexplained_force,
            "friction_force": self.friction,
            "friction_command": self.friction_shift,
        }
        document: dict[str, Any] = {"command": self.quantity} | {
            n: _finite_or_none(x) for n, x in numbers.items()
        }
        document |= {
            "limit": self.limit.name,
            "says": self.reason,
            "reached_force": _finite_or_none(self.reached_force),
        }
        document["uncertainty"] = self.uncertainty
        document["left_out"], document["beyond"] = (
            [*self.neglected_history, *self.neglected_rig],
            list(self.extrapolations),
        )
        document["fit_problems"] = self.fit_problems
        if self.distribution is not None:
            ends = {
                "low": _finite_or_none(self.distribution.low),
                "high": _finite_or_none(self.distribution.high),
            }
            document["draws"] = ends | {
                "interval_share": INTERVAL_SHARE,
                "feasible_share": self.distribution.feasible_share,
            }
        return document

    def __str__(self) -> str:
        lines = self._format_value() if self.limit == CommandLimit.OK else self._format_nearest()
        if self.distribution is not None and self.distribution.feasible_share < 1:
            lines.append(f"possible for {self.distribution.feasible_share:.0%} of the posterior draws")
        lines.append(f"stiffness {self.stiffness / 1e3:.4g} N/mm")
        if math.isfinite(self.stiffness_by_pressure) and math.isfinite(self.stiffness_by_length):
            slopes = (
                f"{self.stiffness_by_pressure:+.4g} N/mm per kPa,"
                f" {1e-6 * self.stiffness_by_length:+.4g} N/mm per mm"
            )
            lines[-1] += f", with derivatives {slopes}"
        return "\n  ".join(lines + self._format_neglected())

    @property
    def _units(self) -> tuple[str, str]:
        """Return the display units of the value and of the given quantity."""
        return ("kPa", "mm") if self.quantity == "pressure" else ("mm", "kPa")

    def _format_nearest(self) -> list[str]:
        nearest = f"nearest possible {self.quantity} {format_quantity(self.value, self._units[0])}"
        if self.limit == CommandLimit.OUTSIDE:
            low, high = self.given_range
            nearest += f", at {format_quantity(min(max(self.given_value, low), high), self._units[1])}"
        return [f"not possible: {self.reason}", nearest]

    def _format_value(self) -> list[str]:
        """Return lines with the value, its uncertainty and its derivatives."""
        unit, given_unit = self._units
        given_name = "length" if self.quantity == "pressure" else "pressure"
        uncertainty = f" ± {format_quantity(self.sd, unit, 2)}" if math.isfinite(self.sd) else ""
        if self.distribution is not None and math.isfinite(self.distribution.low):
            low, high = (
                format_quantity(self.distribution.low, unit).partition(" ")[0],
                format_quantity(self.distribution.high, unit),
            )
            uncertainty += f" ({INTERVAL_SHARE:.0%} of the posterior draws: {low} to {high})"
        if self.friction:
            uncertainty += f", and up to ± {format_quantity(self.friction_shift, unit, 2)} by friction"
        force_scale, given_scale = (1e-3, 1e3) if self.quantity == "pressure" else (1e3, 1e-3)
        lines = [
            f"{self.quantity} {format_quantity(self.value, unit)}{uncertainty}",
            f"{force_scale * self.slope_by_force:+.4g} {unit} per N of force",
            f"{self.slope_by_given * force_scale / given_scale:+.4g} {unit} per {given_unit} of {given_name}",
        ]
        if self.unexplained_force and math.isfinite(self.sd):
            error_text, unexplained_text = (
                format_quantity(abs(self.slope_by_force) * self.unexplained_force, unit, 2),
                format_quantity(self.unexplained_force, "N", 2),
            )
            lines.append(
                f"the ± includes {error_text} for a force error of {unexplained_text} beyond noise"
                " on held-out blocks"
            )
        if self.uncertainty != "calibration" or not self.unexplained_force:
            lines.append(self._format_source())
        return lines

    def _format_source(self) -> str:
        """Return a sentence on the source of the standard deviation, or that none is known."""
        text = UNCERTAINTY_TEXTS[self.uncertainty]
        if self.uncertainty == "unknown" and self.parameters_at_limit:
            names = self.parameters_at_limit
            reason = "is at its limit and has" if len(names) == 1 else "are at their limits and have"
            return f"no standard deviation is known, because {join_words(names)} {reason} none"
        if self.uncertainty == "unknown":
            return text
        if not self.unexplained_force:
            text = text.removesuffix(", and the force error on held-out blocks")
        return f"the ± is one standard deviation, from {text}"

    def _format_neglected(self) -> list[str]:
        """Return a line for each neglected effect and each extrapolation."""
        lines = [*([self.fit_problems] if self.fit_problems else []), *self.extrapolations]
        if self.neglected_history:
            lines.append(
                f"the command assumes a muscle at rest and neglects {join_words(self.neglected_history)}"
            )
        if self.friction:
            lines.append(
                f"braid_friction adds up to {format_quantity(self.friction, 'N', 2)} to the force after"
                " lengthening, and subtracts the same after shortening"
                + ("; the ± excludes it" if math.isfinite(self.sd) else "")
            )
        if self.neglected_rig:
            lines.append(
                "the command assumes exact sensors and a rigid rig and neglects"
                f" {join_words(self.neglected_rig)}"
            )
        return lines


def _list_extrapolations(
    calibrated_range: Mapping[str, tuple[float, float]], point: Mapping[str, float]
) -> tuple[str, ...]:
    """Return a sentence for each quantity outside the calibrated range."""
    sentences = []
    for name, (low, high) in calibrated_range.items():
        unit, value = DISPLAY_UNIT[name], point[name]
        if not low - _RANGE_TOLERANCE * abs(low) <= value <= high * (1 + _RANGE_TOLERANCE):
            range_text = (
                format_quantity(low, unit)
                if low == high
                else f"{format_quantity(low, unit)} to {format_quantity(high, unit)}"
            )
            sentences.append(
                f"extrapolation: {name} {format_quantity(value, unit)}, calibrated at {range_text};"
                " the ± excludes the error of extrapolation"
            )
    return tuple(sentences)


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def solve_command(
    inverse: Inverse, force: float, *, length: float | None = None, pressure: float | None = None,
    file: Path | None = None, case: str | None = None, draws: PosteriorDraws | None = None,
    calibrated_range: Mapping[str, tuple[float, float]] | None = None,
) -> CommandResult:  # fmt: skip
    """Return the command for a wanted force at one length or pressure.

    Args:
        inverse: the inverse model.
        force: wanted force, N.
        length: given length, m, for a commanded pressure; or
        pressure: given pressure, Pa, for a commanded length.
        file: the fit.json or model.json with the covariance of the parameters.
        case: name of its case. Default: the first.
        draws: posterior draws, used instead of the covariance.
        calibrated_range: lowest and highest calibrated "pressure" and "length", SI.
    """
    quantity, given_value = ("pressure", length) if length is not None else ("length", pressure)
    assert given_value is not None
    numbers = evaluate_command(inverse, force, given_value, by_length=length is not None)
    command = numbers.command
    value, slope_by_force, slope_by_given, stiffness = (
        float(np.asarray(x)[0])
        for x in (command.value, command.slope_by_force, command.slope_by_given, command.stiffness)
    )
    given_range, value_range = (
        (inverse.lengths, inverse.pressures) if length is not None else (inverse.pressures, inverse.lengths)
    )
    # A value that is only the rounding error of the root is zero.
    value = value if abs(value) > _ZERO_SHARE * value_range[1] else 0.0
    p, l = (value, given_value) if length is not None else (given_value, value)
    distribution = (
        draws.compute_distribution(inverse, force, length=length, pressure=pressure) if draws else None
    )
    reached_force = float(numbers.reached_force)
    reached_force = reached_force if abs(reached_force) > _ZERO_SHARE * abs(force) else 0.0
    unexplained_force = (read_unexplained_force(file, case) if file else None) or 0.0
    if distribution is not None:
        sd = math.hypot(distribution.sd, slope_by_force * unexplained_force)
    else:
        force_error = compute_force_sd(file, np.array([p]), np.array([l]), case)[0] if file else math.nan
        sd = abs(slope_by_force) * math.hypot(float(force_error), unexplained_force)
    limit = CommandLimit(int(np.asarray(command.status)[0]))
    by_pressure, by_length = numbers.stiffness_slopes
    neglected_history, neglected_rig = list_neglected(inverse.muscle)
    return CommandResult(
        quantity,
        value,
        sd,
        force,
        given_value,
        slope_by_force,
        slope_by_given,
        stiffness,
        float(by_pressure),
        float(by_length),
        limit,
        distribution,
        unexplained_force,
        reached_force,
        float(numbers.half_loop),
        given_range,
        _list_extrapolations(calibrated_range or {}, {"pressure": p, "length": l}),
        neglected_history,
        neglected_rig,
        find_uncertainty_source(file, draws is not None) if math.isfinite(sd) else "unknown",
        tuple(list_parameters_at_limit(file, case)),
        describe_fit_problems(file, case),
    )
