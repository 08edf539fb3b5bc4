"""Runs of a few minutes on an isotonic rig, which sets the force and measures the length."""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.next_experiment.protocols import GAUGE_BLOCK_SD_M, REFERENCE_SD_SHARE
from pamjax.planning.rig_capabilities import RigCapabilities
from pamjax.planning.runs import CHECK_READINGS, HOLD_SECONDS, RAMP_SECONDS, PlannedRun, build_run
from pamjax.units import format_quantity

#: Pressures of the holds, as shares of the highest pressure.
_HOLD_SHARES = (0.2, 0.6, 1.0)


def list_isotonic_runs(capabilities: RigCapabilities) -> list[PlannedRun]:
    """Return all runs and checks of an isotonic rig."""
    all_runs = [build_pressure_ramp(capabilities, load) for load in capabilities.loads]
    all_runs += [
        _build_hold(capabilities, share * capabilities.max_pressure, load)
        for share in _HOLD_SHARES
        for load in capabilities.loads
    ]
    return all_runs + _list_checks(capabilities)


def build_pressure_ramp(capabilities: RigCapabilities, load: float) -> PlannedRun:
    """Return a ramp to the highest pressure and back at a set force, N."""
    max_pressure = capabilities.max_pressure
    description = f"pressure ramp to {format_quantity(max_pressure, 'kPa', 3)} and back {_format_load(load)}"
    corners = [(0.0, 0.0, load), (0.5, max_pressure, load), (1.0, 0.0, load)]
    return build_run(capabilities, description, 2 * RAMP_SECONDS, corners)


def _build_hold(capabilities: RigCapabilities, pressure: float, load: float) -> PlannedRun:
    description = (
        f"hold of {HOLD_SECONDS:.0f} s at {format_quantity(pressure, 'kPa', 3)} {_format_load(load)}"
    )
    return build_run(capabilities, description, HOLD_SECONDS, [(0.0, pressure, load), (1.0, pressure, load)])


def _format_load(load: float) -> str:
    return f"with a set force of {format_quantity(load, 'N', 3)}" if load else "without a load"


def _list_checks(capabilities: RigCapabilities) -> list[PlannedRun]:
    """Return the checks that measure zeros and gains of the rig without the muscle."""
    averaging, no_samples = CHECK_READINGS**0.5, np.zeros(0)
    checks = {
        "reading of the pressure gauge, vented": (
            3.0,
            {"pressure_offset.offset": capabilities.pressure_sd / averaging},
        ),
        "reading of a gauge block of known length and width": (
            15.0,
            {
                "length_offset.offset": max(capabilities.length_sd / averaging, GAUGE_BLOCK_SD_M),
                "diameter_offset.offset": max(
                    (capabilities.diameter_sd or 0.0) / averaging, GAUGE_BLOCK_SD_M
                ),
            },
        ),
        "reading of a second pressure gauge": (20.0, {"pressure_gain.gain": REFERENCE_SD_SHARE}),
    }
    measured = {"pressure", *capabilities.channels}
    return [
        PlannedRun(description, no_samples, no_samples, minutes, direct_sds, is_repeatable=False)
        for description, (minutes, all_sds) in checks.items()
        if (direct_sds := {n: sd for n, sd in all_sds.items() if n.partition("_")[0] in measured})
    ]
