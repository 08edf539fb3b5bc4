"""List of short protocols for an isotonic rig, which sets the force and measures the length.

A protocol ramps the pressure at one set force, or measures a parameter directly. The rig has no load cell,
and its length is free. Pressures and speeds are within the range of the recording.
"""

from __future__ import annotations

from pamjax.diagnosis.next_experiment.protocols import (
    GAUGE_BLOCK_SD_M,
    INDEPENDENT_READING_COUNT,
    PROTOCOL_MENU,
    REFERENCE_SD_SHARE,
    PlannedProtocol,
    format_kpa,
)
from pamjax.diagnosis.next_experiment.rig import Corner, RigLimits

#: Protocols of the list in `protocols.py` that need neither a load cell nor a set length.
_SHARED_IDS = ("X11", "X12", "X14")


def _get_load(rig: RigLimits) -> float:
    assert rig.load is not None
    return rig.load


def _build_path(rig: RigLimits, ramps: list[Corner], load: float | None = None) -> list[Corner]:
    """Return a path that starts vented at a set force."""
    return [(0.0, 0.0, _get_load(rig) if load is None else load, 1), *ramps]


def _build_ramps(rig: RigLimits, shares_and_factors: list[tuple[float, float]]) -> list[Corner]:
    """Return ramps to shares of the highest pressure, each at a factor of the usual speed."""
    ramps = []
    for cycle, (share, factor) in enumerate(shares_and_factors, 1):
        ramps += rig.build_pressure_ramp(share * rig.max_pressure, factor, cycle, _get_load(rig))
    return _build_path(rig, ramps)


def _build_holds(rig: RigLimits) -> list[Corner]:
    middle, top, load = 0.6 * rig.max_pressure, rig.max_pressure, _get_load(rig)
    travel = rig.max_pressure / rig.pressure_speed
    return _build_path(
        rig,
        [
            (0.6 * travel, middle, load, 1),
            (300.0, middle, load, 1),
            (0.4 * travel, top, load, 2),
            (0.4 * travel, middle, load, 2),
            (300.0, middle, load, 2),
        ],
    )


def _build_reversals(rig: RigLimits) -> list[Corner]:
    ramps, load = [], _get_load(rig)
    for k, base_share in enumerate((0.25, 0.5, 0.85)):
        base = base_share * rig.max_pressure
        ramps += [(base / rig.pressure_speed, base, load, 3 * k + 1)]
        for j, share in enumerate((0.01, 0.03, 0.1)):
            ramps += rig.build_pressure_ramp(base + share * rig.max_pressure, 0.3, 3 * k + j + 1, load, base)
    return _build_path(rig, ramps)


def _build_loaded_ramps(rig: RigLimits) -> list[Corner]:
    ramps = [*rig.build_pressure_ramp(rig.max_pressure, 1.0, 1, rig.max_force)]
    return _build_path(rig, ramps, rig.max_force)


def _read_zeros(rig: RigLimits) -> dict[str, float]:
    return {"pressure_offset.offset": rig.pressure_noise / INDEPENDENT_READING_COUNT**0.5}


def _read_references(rig: RigLimits) -> dict[str, float]:
    root_count = INDEPENDENT_READING_COUNT**0.5
    return {
        "length_offset.offset": max(rig.length_noise / root_count, GAUGE_BLOCK_SD_M),
        "pressure_gain.gain": max(rig.pressure_noise / root_count / rig.max_pressure, REFERENCE_SD_SHARE),
        "pressure_offset.offset": max(rig.pressure_noise / root_count, REFERENCE_SD_SHARE * rig.max_pressure),
        "channel_lag.lag": rig.step / root_count,
    }


#: The menu of protocols of an isotonic rig.
ISOTONIC_MENU = (
    PlannedProtocol(
        "I1",
        lambda rig: "Read the pressure gauge with the muscle vented, now and one hour later",
        get_direct_readings=_read_zeros,
        operator_minutes=4.0,
    ),
    PlannedProtocol(
        "I2",
        lambda rig: f"Ramp the pressure slowly to {format_kpa(0.2 * rig.max_pressure)} and back, three times",
        lambda rig: _build_ramps(rig, [(0.2, 0.5)] * 3),
    ),
    PlannedProtocol(
        "I3",
        lambda rig: (
            f"Ramp the pressure to {format_kpa(rig.max_pressure)} and back, twice,"
            f" with a photograph of the diameter every {max(rig.step, 1):.2g} s"
        ),
        lambda rig: _build_ramps(rig, [(1.0, 1.0)] * 2),
        needs_camera=True,
    ),
    PlannedProtocol(
        "I4",
        lambda rig: (
            f"Ramp the pressure to {format_kpa(0.5 * rig.max_pressure)} and back once, three and ten times as"
            f" fast ({rig.pressure_speed / 1e3:.3g} to {rig.pressure_speed / 1e2:.3g} kPa/s)"
        ),
        lambda rig: _build_ramps(rig, [(0.5, factor) for factor in (1, 1, 3, 3, 10, 10)]),
    ),
    PlannedProtocol(
        "I5",
        lambda rig: (
            f"Hold {format_kpa(0.6 * rig.max_pressure)} for 300 s, first after an increase of the pressure,"
            " then after a decrease"
        ),
        _build_holds,
    ),
    PlannedProtocol(
        "I6",
        lambda rig: "Make small pressure ramps (1, 3 and 10 % of the highest pressure) at three pressures",
        _build_reversals,
    ),
    PlannedProtocol(
        "I7",
        lambda rig: (
            "After a night without pressure, ramp to decreasing pressures from"
            f" {format_kpa(rig.max_pressure)}"
        ),
        lambda rig: _build_ramps(rig, [(share, 1.0) for share in (1.0, 0.7, 0.4, 0.2)]),
        operator_minutes=720.0,
    ),
    PlannedProtocol(
        "I8",
        lambda rig: (
            f"Make the same ramp to a low pressure ({format_kpa(0.2 * rig.max_pressure)}) before and after a"
            " ramp to the highest pressure"
        ),
        lambda rig: _build_ramps(rig, [(0.2, 1.0), (1.0, 1.0), (0.2, 1.0)]),
    ),
    PlannedProtocol(
        "I9",
        lambda rig: (
            f"Set the force to {rig.max_force:.3g} N instead of {_get_load(rig):.3g} N, and ramp the pressure"
            f" to {format_kpa(rig.max_pressure)} and back"
        ),
        _build_loaded_ramps,
        operator_minutes=15.0,
    ),
    PlannedProtocol(
        "I10",
        lambda rig: (
            "Check the length sensor with a gauge block, and connect a second pressure gauge at the muscle"
        ),
        get_direct_readings=_read_references,
        operator_minutes=20.0,
    ),
    PlannedProtocol(
        "I11",
        lambda rig: "Repeat one pressure ramp at a temperature that is 15 K higher",
        operator_minutes=120.0,
        in_library=False,
    ),
    *(protocol for protocol in PROTOCOL_MENU if protocol.id in _SHARED_IDS),
)
