"""One wish of a controller, answered: what to command, how surely, and how it changes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.design.doubt import force_sd
from pamjax.design.inverse import Inverse, Limit
from pamjax.units import show


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
        limit: what keeps the wish from being met.
    """

    what: str
    value: float
    sd: float
    force: float
    other: float
    by_force: float
    by_other: float
    stiffness: float
    limit: Limit

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers, SI."""
        return {
            "command": self.what, "value": self.value, "sd": self.sd if math.isfinite(self.sd) else None,
            "force": self.force, "given": self.other, "by_force": self.by_force, "by_given": self.by_other,
            "stiffness": self.stiffness, "limit": self.limit.name, "says": self.limit.says,
        }  # fmt: skip

    def __str__(self) -> str:
        unit, given = ("kPa", "mm") if self.what == "pressure" else ("mm", "kPa")
        if self.limit != Limit.OK:
            lines = [f"cannot be met: {self.limit.says}", f"  nearest {self.what} {show(self.value, unit)}"]
        else:
            sure = f" ± {show(self.sd, unit, 2)}" if math.isfinite(self.sd) else ""
            lines = [f"{self.what} {show(self.value, unit)}{sure}"]
            by, other = (1e-3, 1e3) if self.what == "pressure" else (1e3, 1e-3)
            lines.append(f"  {by * self.by_force:+.4g} {unit} for a newton more")
            lines.append(f"  {self.by_other * by / other:+.4g} {unit} for a {given} more")
        lines.append(f"  stiffness there {self.stiffness / 1e3:.4g} N/mm")
        return "\n".join(lines)


def answer(
    of: Inverse, force: float, *, length: float | None = None, pressure: float | None = None,
    file: Path | None = None, case: str | None = None,
) -> Answer:  # fmt: skip
    """Answer one wish.

    Args:
        of: the inverse.
        force: wanted, N.
        length: at which the pressure is sought, m; or
        pressure: at which the length is sought, Pa.
        file: the fit.json that knows how sure the muscle's numbers are.
        case: which case of it.
    """
    what, other = ("pressure", length) if length is not None else ("length", pressure)
    assert other is not None
    command = (of.pressure if length is not None else of.length)(force, other)
    value, by_force, by_other, stiffness = (
        float(np.asarray(x)[0])
        for x in (command.value, command.by_force, command.by_other, command.stiffness)
    )
    p, l = (value, other) if length is not None else (other, value)
    off = float(force_sd(file, np.array([p]), np.array([l]), case)[0]) if file else math.nan
    limit = Limit(int(np.asarray(command.status)[0]))
    return Answer(what, value, abs(by_force) * off, force, other, by_force, by_other, stiffness, limit)
