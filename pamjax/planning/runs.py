"""Runs: what a rig can do in a few minutes, from which a plan is put together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.planning.bench import RigCapabilities
from pamjax.units import format_quantity

#: Levels of pressure and of contraction that are tried.
PRESSURE_LEVELS, CONTRACTION_LEVELS = 5, 4

#: Seconds of a ramp up or down, and of a hold.
RAMP_SECONDS, HOLD_SECONDS = 60.0, 60.0

#: Independent readings that a check is worth, and what a reference is: share of a reading, and m.
CHECK_READINGS, REFERENCE_SHARE, GAUGE_BLOCK_SD = 10, 1e-3, 2e-5

#: Strokes at each pressure of the paper's protocol.
ISOBAR_CYCLES = 3

#: Force with which a steel bar is pulled, N.
CHECK_FORCE = 1000.0


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """One thing to do.

    Attributes:
        description: what, in a few words.
        pressure, length: (n,) Pa and m, sample by sample; empty for a check.
        minutes: what it costs, its set-up included.
        direct_sds: numbers that are read directly, with the standard deviation of the reading, SI.
        is_repeatable: whether doing it twice tells more than once.
    """

    description: str
    pressure: np.ndarray
    length: np.ndarray
    minutes: float
    direct_sds: dict[str, float]
    is_repeatable: bool = True

    @property
    def still(self) -> bool:
        """Whether the length stays where it is set."""
        return self.length.size > 0 and float(np.ptp(self.length)) == 0.0

    def thin(self, max_samples: int) -> PlannedRun:
        """The same path in so many samples at most, evenly."""
        n = self.pressure.size
        if n <= max_samples:
            return self
        kept_samples = ((np.arange(max_samples) + 0.5) * n / max_samples).astype(int)
        return replace(self, pressure=self.pressure[kept_samples], length=self.length[kept_samples])


def list_runs(capabilities: RigCapabilities, rest_length: float) -> list[PlannedRun]:
    """Everything a rig can do with a muscle of this rest length, m."""
    pressures = capabilities.pressure * np.arange(1, PRESSURE_LEVELS + 1) / PRESSURE_LEVELS
    contractions = _contractions(capabilities)
    all_runs = [_build_stroke(capabilities, rest_length, p) for p in pressures]
    all_runs += [_build_ramp(capabilities, rest_length, c) for c in contractions]
    all_runs += [
        _build_hold(capabilities, rest_length, p, c) for p in pressures[[0, 2, -1]] for c in contractions
    ]
    return all_runs + _list_checks(capabilities)


def set_lengths(means: RigCapabilities, rest: float) -> np.ndarray:
    """Return the lengths at which a rig's runs hold the muscle still, m."""
    return rest * (1 - _contractions(means))


def _contractions(means: RigCapabilities) -> np.ndarray:
    return means.contraction * np.arange(CONTRACTION_LEVELS) / CONTRACTION_LEVELS


def _build_run(
    capabilities: RigCapabilities, description: str, seconds: float, corners: list[tuple[float, float, float]]
) -> PlannedRun:
    """Straight lines between corners (share of the time, pressure, length)."""
    n = max(int(seconds * capabilities.rate), 1)
    corner_times, pressure, length = (np.array(x) for x in zip(*corners, strict=True))
    share = (np.arange(n) + 0.5) / n
    minutes = (seconds + capabilities.setup) / 60
    return PlannedRun(
        description,
        np.interp(share, corner_times, pressure),
        np.interp(share, corner_times, length),
        minutes,
        {},
    )


def _build_stroke(capabilities: RigCapabilities, rest_length: float, pressure: float) -> PlannedRun:
    shortest = rest_length * (1 - capabilities.contraction)
    description = (
        f"stroke to {capabilities.contraction:.0%} contraction and back at"
        f" {format_quantity(pressure, 'kPa', 3)}"
    )
    corners = [(0.0, pressure, rest_length), (0.5, pressure, shortest), (1.0, pressure, rest_length)]
    return _build_run(
        capabilities, description, 2 * rest_length * capabilities.contraction / capabilities.speed, corners
    )


def _build_ramp(capabilities: RigCapabilities, rest_length: float, contraction: float) -> PlannedRun:
    length, max_pressure = rest_length * (1 - contraction), capabilities.pressure
    place = f"{contraction:.0%} contraction" if contraction else "rest length"
    description = f"pressure ramp to {format_quantity(max_pressure, 'kPa', 3)} and back at {place}"
    return _build_run(
        capabilities,
        description,
        2 * RAMP_SECONDS,
        [(0.0, 0.0, length), (0.5, max_pressure, length), (1.0, 0.0, length)],
    )


def _build_hold(
    capabilities: RigCapabilities, rest_length: float, pressure: float, contraction: float
) -> PlannedRun:
    length = rest_length * (1 - contraction)
    place = f"{contraction:.0%} contraction" if contraction else "rest length"
    description = f"hold of {HOLD_SECONDS:.0f} s at {format_quantity(pressure, 'kPa', 3)} and {place}"
    return _build_run(
        capabilities, description, HOLD_SECONDS, [(0.0, pressure, length), (1.0, pressure, length)]
    )


def _list_checks(capabilities: RigCapabilities) -> list[PlannedRun]:
    """What tells a rig's zeros and gains without the muscle."""
    averaging, no_samples = CHECK_READINGS**0.5, np.zeros(0)
    force, diameter = capabilities.force or 0.0, capabilities.diameter or 0.0
    # A bar is one length: all its readings have the same error of setting.
    ruler = max(capabilities.ruler / averaging, capabilities.setting)
    checks = {
        "reading of all channels, vented and unclamped": (
            3.0,
            {
                "force_offset.offset": force / averaging,
                "pressure_offset.offset": capabilities.gauge / averaging,
            },
        ),
        "reading of a steel bar of known length and width in the grips": (
            15.0,
            {
                "length_offset.offset": max(ruler, GAUGE_BLOCK_SD),
                "diameter_offset.offset": max(diameter / averaging, GAUGE_BLOCK_SD),
                "rig_compliance.compliance": ruler / CHECK_FORCE,
            },
        ),
        "reading of dead weights and of a second gauge": (
            20.0,
            {"force_gain.gain": REFERENCE_SHARE, "pressure_gain.gain": REFERENCE_SHARE},
        ),
    }
    measured = {"pressure", "length", "rig", *capabilities.channels}
    return [
        PlannedRun(description, no_samples, no_samples, minutes, direct_sds, is_repeatable=False)
        for description, (minutes, all_sds) in checks.items()
        if (direct_sds := {n: sd for n, sd in all_sds.items() if n.partition("_")[0] in measured})
    ]


def list_isobars(capabilities: RigCapabilities, rest_length: float, count: int = 10) -> list[PlannedRun]:
    """The protocol of the paper on this rig: three strokes at each of ten pressures."""
    return [
        _build_stroke(capabilities, rest_length, capabilities.pressure * k / count)
        for k in range(1, count + 1)
        for _ in range(ISOBAR_CYCLES)
    ]
