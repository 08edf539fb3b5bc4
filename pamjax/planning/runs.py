"""Runs of a few minutes on a test rig, the elements of a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.next_experiment.protocols import GAUGE_BLOCK_SD_M, REFERENCE_SD_SHARE
from pamjax.planning.rig_capabilities import RigCapabilities
from pamjax.units import format_quantity

#: Numbers of levels of pressure and of contraction.
_PRESSURE_LEVELS, _CONTRACTION_LEVELS = 5, 4

#: Duration of a ramp up or down, and of a hold, s.
RAMP_SECONDS, HOLD_SECONDS = 60.0, 60.0

#: Independent readings of a check.
CHECK_READINGS = 10

#: Strokes at each pressure in the protocol of Chambers & Wereley (2022).
ISOBAR_CYCLES = 3

#: Tension of a steel bar in a check, N.
_CHECK_FORCE = 1000.0


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """One run or check of a plan.

    Attributes:
        description: short description.
        pressure, length: (n,) commands, Pa and m; empty for a check. On an isotonic rig the length is NaN.
        minutes: duration with set-up, min.
        direct_sds: parameters that are measured directly, with the standard deviation of the reading, SI.
        is_repeatable: whether a repetition adds information.
        load: (n,) set force of an isotonic run, N; None if the length is set.
    """

    description: str
    pressure: np.ndarray
    length: np.ndarray
    minutes: float
    direct_sds: dict[str, float]
    is_repeatable: bool = True
    load: np.ndarray | None = None

    @property
    def has_fixed_length(self) -> bool:
        """Return whether the length is constant."""
        return self.length.size > 0 and float(np.ptp(self.length)) == 0.0

    def select_samples(self, max_samples: int) -> PlannedRun:
        """Return the run with at most `max_samples` samples, evenly selected."""
        n = self.pressure.size
        if n <= max_samples:
            return self
        kept_samples = ((np.arange(max_samples) + 0.5) * n / max_samples).astype(int)
        return replace(
            self,
            pressure=self.pressure[kept_samples],
            length=self.length[kept_samples],
            load=None if self.load is None else self.load[kept_samples],
        )


def list_runs(capabilities: RigCapabilities, rest_length: float) -> list[PlannedRun]:
    """Return all runs and checks of a rig with a muscle of this rest length, m."""
    pressures = capabilities.max_pressure * np.arange(1, _PRESSURE_LEVELS + 1) / _PRESSURE_LEVELS
    contractions = _list_contractions(capabilities)
    all_runs = [_build_stroke(capabilities, rest_length, p) for p in pressures]
    all_runs += [_build_ramp(capabilities, rest_length, c) for c in contractions]
    all_runs += [
        _build_hold(capabilities, rest_length, p, c) for p in pressures[[0, 2, -1]] for c in contractions
    ]
    return all_runs + _list_checks(capabilities)


def compute_fixed_lengths(capabilities: RigCapabilities, rest_length: float) -> np.ndarray:
    """Return the fixed lengths of a rig's runs, m."""
    return rest_length * (1 - _list_contractions(capabilities))


def _list_contractions(capabilities: RigCapabilities) -> np.ndarray:
    return capabilities.max_contraction * np.arange(_CONTRACTION_LEVELS) / _CONTRACTION_LEVELS


def build_run(
    capabilities: RigCapabilities, description: str, seconds: float, corners: list[tuple[float, float, float]]
) -> PlannedRun:
    """Return a run with straight lines between corners (share of the time, pressure, length).

    On an isotonic rig, the set force takes the place of the length.
    """
    n = max(int(seconds * capabilities.rate), 1)
    corner_times, corner_pressures, corner_inputs = (np.array(x) for x in zip(*corners, strict=True))
    share = (np.arange(n) + 0.5) / n
    minutes = (seconds + capabilities.setup_seconds) / 60
    pressure, second_input = (np.interp(share, corner_times, x) for x in (corner_pressures, corner_inputs))
    if capabilities.measures_length:
        return PlannedRun(description, pressure, np.full(n, np.nan), minutes, {}, load=second_input)
    return PlannedRun(description, pressure, second_input, minutes, {})


def _build_stroke(capabilities: RigCapabilities, rest_length: float, pressure: float) -> PlannedRun:
    shortest = rest_length * (1 - capabilities.max_contraction)
    description = (
        f"stroke to {capabilities.max_contraction:.0%} contraction and back at"
        f" {format_quantity(pressure, 'kPa', 3)}"
    )
    corners = [(0.0, pressure, rest_length), (0.5, pressure, shortest), (1.0, pressure, rest_length)]
    return build_run(
        capabilities,
        description,
        2 * rest_length * capabilities.max_contraction / capabilities.speed,
        corners,
    )


def _build_ramp(capabilities: RigCapabilities, rest_length: float, contraction: float) -> PlannedRun:
    length, max_pressure = rest_length * (1 - contraction), capabilities.max_pressure
    place = f"{contraction:.0%} contraction" if contraction else "rest length"
    description = f"pressure ramp to {format_quantity(max_pressure, 'kPa', 3)} and back at {place}"
    return build_run(
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
    return build_run(
        capabilities, description, HOLD_SECONDS, [(0.0, pressure, length), (1.0, pressure, length)]
    )


def _list_checks(capabilities: RigCapabilities) -> list[PlannedRun]:
    """Return the checks that measure zeros and gains of the rig without the muscle."""
    averaging, no_samples = CHECK_READINGS**0.5, np.zeros(0)
    force, diameter = capabilities.force_sd or 0.0, capabilities.diameter_sd or 0.0
    # All readings of one bar have the same length error.
    ruler = max(capabilities.length_sd / averaging, capabilities.length_level_sd)
    checks = {
        "reading of all channels, vented and unclamped": (
            3.0,
            {
                "force_offset.offset": force / averaging,
                "pressure_offset.offset": capabilities.pressure_sd / averaging,
            },
        ),
        "reading of a steel bar of known length and width in the grips": (
            15.0,
            {
                "length_offset.offset": max(ruler, GAUGE_BLOCK_SD_M),
                "diameter_offset.offset": max(diameter / averaging, GAUGE_BLOCK_SD_M),
                "rig_compliance.compliance": ruler / _CHECK_FORCE,
            },
        ),
        "reading of dead weights and of a second gauge": (
            20.0,
            {"force_gain.gain": REFERENCE_SD_SHARE, "pressure_gain.gain": REFERENCE_SD_SHARE},
        ),
    }
    measured = {"pressure", "length", "rig", *capabilities.channels}
    return [
        PlannedRun(description, no_samples, no_samples, minutes, direct_sds, is_repeatable=False)
        for description, (minutes, all_sds) in checks.items()
        if (direct_sds := {n: sd for n, sd in all_sds.items() if n.partition("_")[0] in measured})
    ]


def list_isobars(capabilities: RigCapabilities, rest_length: float, count: int = 10) -> list[PlannedRun]:
    """Return the protocol of Chambers & Wereley (2022): three strokes at each of ten pressures."""
    return [
        _build_stroke(capabilities, rest_length, capabilities.max_pressure * k / count)
        for k in range(1, count + 1)
        for _ in range(ISOBAR_CYCLES)
    ]
