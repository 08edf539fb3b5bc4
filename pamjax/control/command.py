"""One wish of a controller, answered: what to command, how surely, and how it changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.control.command_uncertainty import force_sd, left_over
from pamjax.control.inverse import Inverse, Limit
from pamjax.control.neglected import half_loop, left_out
from pamjax.control.posterior_draws import MIDDLE, Draws, Spread
from pamjax.units import show

#: Share of the largest below which a number is the rounding of nothing, and by which an end may be passed.
ROUNDED, BEYOND = 1e-9, 1e-3


@dataclass(frozen=True)
class Answer:
    """What to command, SI.

    Attributes:
        what: "pressure" or "length".
        value: Pa or m; where the wish cannot be met, the nearest there is.
        sd: of it, from what the calibration does not know; NaN where no covariance is kept.
        force: wanted, N.
        other: the given length, m, or pressure, Pa.
        by_force, by_other: derivatives of the value.
        stiffness: ∂F/∂L, N/m.
        by_pressure, by_length: derivatives of the stiffness, N/(m Pa) and N/m².
        limit: what keeps the wish from being met.
        spread: what posterior draws make of it, where there are any.
        missed: force that the muscle misses beyond noise on held-out blocks, N, part of `sd`; 0 if unknown.
        there: force at the value, N.
        friction: half the width of the friction's loop in force, N, there; no part of `sd`; 0 for none.
        ends: lowest and highest of the given length, m, or pressure, Pa.
        beyond: what of pressure and length lies beyond where the muscle was calibrated, a sentence each.
        past, lab: ids of mechanisms that take no part: what past and speed leave; sensors and rig.
    """

    what: str
    value: float
    sd: float
    force: float
    other: float
    by_force: float
    by_other: float
    stiffness: float
    by_pressure: float
    by_length: float
    limit: Limit
    spread: Spread | None = None
    missed: float = 0.0
    there: float = math.nan
    friction: float = 0.0
    ends: tuple[float, float] = (-math.inf, math.inf)
    beyond: tuple[str, ...] = ()
    past: tuple[str, ...] = ()
    lab: tuple[str, ...] = ()

    @property
    def rubs(self) -> float:
        """By how much friction moves the value to either side, Pa or m."""
        return abs(self.by_force) * self.friction

    @property
    def why(self) -> str:
        """Which limit binds, with the force that there is at it."""
        ends = {
            Limit.TOO_STRONG: ("more", "highest", "longest"),
            Limit.TOO_WEAK: ("less", "lowest", "shortest"),
        }
        if self.limit == Limit.OUTSIDE:
            given = "length" if self.what == "pressure" else "pressure"
            low, high = (show(end, self._units[1]) for end in self.ends)
            return f"a {given} of {show(self.other, self._units[1])} is outside {low} to {high}"
        if self.limit not in ends:
            return self.limit.says
        than, pressure, length = ends[self.limit]
        at = f"{pressure} pressure, " if self.what == "pressure" else f"{length} length, "
        at += show(self.value, "kPa" if self.what == "pressure" else "mm")
        return f"{than} force than the {show(self.there, 'N')} at the {at}"

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers, SI; None where there is none."""
        numbers = {
            "value": self.value, "sd": self.sd, "force": self.force, "given": self.other,
            "by_force": self.by_force, "by_given": self.by_other, "stiffness": self.stiffness,
            "stiffness_by_pressure": self.by_pressure, "stiffness_by_length": self.by_length,
            "force_missed": self.missed, "friction_force": self.friction, "friction_command": self.rubs,
        }  # fmt: skip
        found: dict[str, Any] = {"command": self.what} | {n: _finite(x) for n, x in numbers.items()}
        found |= {"limit": self.limit.name, "says": self.why, "there": _finite(self.there)}
        found["left_out"], found["beyond"] = [*self.past, *self.lab], list(self.beyond)
        if self.spread is not None:
            ends = {"low": _finite(self.spread.low), "high": _finite(self.spread.high)}
            found["draws"] = ends | {"middle": MIDDLE, "met": self.spread.met}
        return found

    def __str__(self) -> str:
        lines = self._met() if self.limit == Limit.OK else self._nearest()
        if self.spread is not None and self.spread.met < 1:
            lines.append(f"{self.spread.met:.0%} of the draws can meet it")
        lines.append(f"stiffness there {self.stiffness / 1e3:.4g} N/mm")
        if math.isfinite(self.by_pressure) and math.isfinite(self.by_length):
            slopes = (
                f"{self.by_pressure:+.4g} N/mm for a kPa more, {1e-6 * self.by_length:+.4g} N/mm for a mm"
            )
            lines[-1] += f": {slopes} more"
        return "\n  ".join(lines + self._left_out())

    @property
    def _units(self) -> tuple[str, str]:
        """Of the value, and of what is given."""
        return ("kPa", "mm") if self.what == "pressure" else ("mm", "kPa")

    def _nearest(self) -> list[str]:
        nearest = f"nearest {self.what} {show(self.value, self._units[0])}"
        if self.limit == Limit.OUTSIDE:
            nearest += f", at {show(min(max(self.other, self.ends[0]), self.ends[1]), self._units[1])}"
        return [f"cannot be met: {self.why}", nearest]

    def _met(self) -> list[str]:
        """The value with all that it may be off by, and how it changes."""
        unit, given = self._units
        sure = f" ± {show(self.sd, unit, 2)}" if math.isfinite(self.sd) else ""
        if self.spread is not None and math.isfinite(self.spread.low):
            low, high = show(self.spread.low, unit).partition(" ")[0], show(self.spread.high, unit)
            sure += f" ({MIDDLE:.0%} of draws: {low} to {high})"
        if self.friction:
            sure += f", and up to {show(self.rubs, unit, 2)} to either side by friction"
        by, other = (1e-3, 1e3) if self.what == "pressure" else (1e3, 1e-3)
        lines = [
            f"{self.what} {show(self.value, unit)}{sure}",
            f"{by * self.by_force:+.4g} {unit} for a newton more",
            f"{self.by_other * by / other:+.4g} {unit} for a {given} more",
        ]
        if self.missed:
            off, left = show(abs(self.by_force) * self.missed, unit, 2), show(self.missed, "N", 2)
            lines.append(f"{off} of the ± since the muscle misses {left} of held-out blocks beyond noise")
        return lines

    def _left_out(self) -> list[str]:
        """What takes no part, a line each."""
        lines = [*self.beyond]
        if self.past:
            lines.append(f"left out, as for a muscle at rest: {', '.join(self.past)}")
        if self.friction:
            way = "more after lengthening and as much less after shortening"
            lines.append(
                f"braid_friction makes force up to {show(self.friction, 'N', 2)} {way}; no ± counts it"
            )
        if self.lab:
            lines.append(f"left out, as for true sensors and a rigid rig: {', '.join(self.lab)}")
        return lines


def _beyond(calibrated: Mapping[str, tuple[float, float]], at: Mapping[str, float]) -> tuple[str, ...]:
    """What lies beyond where a muscle was calibrated, a sentence each."""
    said = []
    for name, (low, high) in calibrated.items():
        unit, value = DISPLAY_UNIT[name], at[name]
        if not low - BEYOND * abs(low) <= value <= high * (1 + BEYOND):
            known = show(low, unit) if low == high else f"{show(low, unit)} to {show(high, unit)}"
            said.append(f"extrapolated: {name} {show(value, unit)}, calibrated at {known}; no ± counts it")
    return tuple(said)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def answer(
    of: Inverse, force: float, *, length: float | None = None, pressure: float | None = None,
    file: Path | None = None, case: str | None = None, draws: Draws | None = None,
    calibrated: Mapping[str, tuple[float, float]] | None = None,
) -> Answer:  # fmt: skip
    """Answer one wish.

    Args:
        of: the inverse.
        force: wanted, N.
        length: at which the pressure is sought, m; or
        pressure: at which the length is sought, Pa.
        file: the fit.json that knows how sure the muscle's numbers are.
        case: which case of it.
        draws: what a posterior knows of the muscle, instead of that file.
        calibrated: lowest and highest "pressure" and "length" that the muscle was calibrated on, SI.
    """
    what, other = ("pressure", length) if length is not None else ("length", pressure)
    assert other is not None
    command = (of.pressure if length is not None else of.length)(force, other)
    value, by_force, by_other, stiffness = (
        float(np.asarray(x)[0])
        for x in (command.value, command.by_force, command.by_other, command.stiffness)
    )
    ends, into = (of.lengths, of.pressures) if length is not None else (of.pressures, of.lengths)
    # What a root leaves of nothing is nothing.
    value = value if abs(value) > ROUNDED * into[1] else 0.0
    p, l = (value, other) if length is not None else (other, value)
    spread = draws.spread(of, force, length=length, pressure=pressure) if draws else None
    there = float(of.force(p, l)[0][0])
    there = there if abs(there) > ROUNDED * abs(force) else 0.0
    missed = (left_over(file) if file else None) or 0.0
    if spread is not None:
        sd = math.hypot(spread.sd, by_force * missed)
    else:
        off = force_sd(file, np.array([p]), np.array([l]), case)[0] if file else math.nan
        sd = abs(by_force) * math.hypot(float(off), missed)
    limit = Limit(int(np.asarray(command.status)[0]))
    by_pressure, by_length = of.stiffening(p, l)[0]
    past, lab = left_out(of.muscle)
    return Answer(
        what, value, sd, force, other, by_force, by_other, stiffness, float(by_pressure), float(by_length),
        limit, spread, missed, there, float(half_loop(of.muscle, p, l)[0]), ends,
        _beyond(calibrated or {}, {"pressure": p, "length": l}), past, lab,
    )  # fmt: skip
