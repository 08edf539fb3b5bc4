"""Runs: what a rig can do in a few minutes, from which a plan is put together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.planning.bench import Means
from pamjax.units import show

#: Levels of pressure and of contraction that are tried.
PRESSURES, CONTRACTIONS = 5, 4

#: Seconds of a ramp up or down, and of a hold.
RAMP, HOLD = 60.0, 60.0

#: Independent readings that a check is worth, and what a reference is: share of a reading, and m.
READINGS, REFERENCE, BLOCK = 10, 1e-3, 2e-5

#: Strokes at each pressure of the paper's protocol.
CYCLES = 3

#: Force with which a steel bar is pulled, N.
PULL = 1000.0


@dataclass(frozen=True, eq=False)
class Run:
    """One thing to do.

    Attributes:
        says: what, in a few words.
        pressure, length: (n,) Pa and m, sample by sample; empty for a check.
        minutes: what it costs, its set-up included.
        direct: numbers that are read directly, with the standard deviation of the reading, SI.
        again: whether doing it twice tells more than once.
    """

    says: str
    pressure: np.ndarray
    length: np.ndarray
    minutes: float
    direct: dict[str, float]
    again: bool = True

    @property
    def still(self) -> bool:
        """Whether the length stays where it is set."""
        return self.length.size > 0 and float(np.ptp(self.length)) == 0.0

    def thinned(self, most: int) -> Run:
        """The same path in so many samples at most, evenly."""
        n = self.pressure.size
        if n <= most:
            return self
        at = ((np.arange(most) + 0.5) * n / most).astype(int)
        return replace(self, pressure=self.pressure[at], length=self.length[at])


def runs(means: Means, rest: float) -> list[Run]:
    """Everything a rig can do with a muscle of this rest length, m."""
    pressures = means.pressure * np.arange(1, PRESSURES + 1) / PRESSURES
    contractions = _contractions(means)
    out = [_stroke(means, rest, p) for p in pressures]
    out += [_ramp(means, rest, c) for c in contractions]
    out += [_hold(means, rest, p, c) for p in pressures[[0, 2, -1]] for c in contractions]
    return out + _checks(means)


def set_lengths(means: Means, rest: float) -> np.ndarray:
    """Return the lengths at which a rig's runs hold the muscle still, m."""
    return rest * (1 - _contractions(means))


def _contractions(means: Means) -> np.ndarray:
    return means.contraction * np.arange(CONTRACTIONS) / CONTRACTIONS


def _run(means: Means, says: str, seconds: float, corners: list[tuple[float, float, float]]) -> Run:
    """Straight lines between corners (share of the time, pressure, length)."""
    n = max(int(seconds * means.rate), 1)
    at, pressure, length = (np.array(x) for x in zip(*corners, strict=True))
    share = (np.arange(n) + 0.5) / n
    minutes = (seconds + means.setup) / 60
    return Run(says, np.interp(share, at, pressure), np.interp(share, at, length), minutes, {})


def _stroke(means: Means, rest: float, pressure: float) -> Run:
    far = rest * (1 - means.contraction)
    says = f"stroke to {means.contraction:.0%} contraction and back at {show(pressure, 'kPa', 3)}"
    corners = [(0.0, pressure, rest), (0.5, pressure, far), (1.0, pressure, rest)]
    return _run(means, says, 2 * rest * means.contraction / means.speed, corners)


def _ramp(means: Means, rest: float, contraction: float) -> Run:
    length, top = rest * (1 - contraction), means.pressure
    where = f"{contraction:.0%} contraction" if contraction else "rest length"
    says = f"pressure ramp to {show(top, 'kPa', 3)} and back at {where}"
    return _run(means, says, 2 * RAMP, [(0.0, 0.0, length), (0.5, top, length), (1.0, 0.0, length)])


def _hold(means: Means, rest: float, pressure: float, contraction: float) -> Run:
    length = rest * (1 - contraction)
    where = f"{contraction:.0%} contraction" if contraction else "rest length"
    says = f"hold of {HOLD:.0f} s at {show(pressure, 'kPa', 3)} and {where}"
    return _run(means, says, HOLD, [(0.0, pressure, length), (1.0, pressure, length)])


def _checks(means: Means) -> list[Run]:
    """What tells a rig's zeros and gains without the muscle."""
    many, none = READINGS**0.5, np.zeros(0)
    force, diameter = means.force or 0.0, means.diameter or 0.0
    # A bar is one length: all its readings have the same error of setting.
    ruler = max(means.ruler / many, means.setting)
    offered = {
        "reading of all channels, vented and unclamped": (
            3.0,
            {"force_offset.offset": force / many, "pressure_offset.offset": means.gauge / many},
        ),
        "reading of a steel bar of known length and width in the grips": (
            15.0,
            {"length_offset.offset": max(ruler, BLOCK),
             "diameter_offset.offset": max(diameter / many, BLOCK),
             "rig_compliance.compliance": ruler / PULL},
        ),
        "reading of dead weights and of a second gauge": (
            20.0,
            {"force_gain.gain": REFERENCE, "pressure_gain.gain": REFERENCE},
        ),
    }  # fmt: skip
    shown = {"pressure", "length", "rig", *means.channels}
    return [
        Run(says, none, none, minutes, direct, again=False)
        for says, (minutes, everything) in offered.items()
        if (direct := {n: sd for n, sd in everything.items() if n.partition("_")[0] in shown})
    ]


def isobars(means: Means, rest: float, many: int = 10) -> list[Run]:
    """The protocol of the paper on this rig: three strokes at each of ten pressures."""
    return [
        _stroke(means, rest, means.pressure * k / many) for k in range(1, many + 1) for _ in range(CYCLES)
    ]
