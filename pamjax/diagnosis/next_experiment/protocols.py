"""List of short protocols for the next experiment, scaled to the muscle and the rig.

A protocol moves pressure and length along straight lines between corners, measures a parameter directly, or
does both. Direct measurements use a vented gauge, a dead weight, or a steel bar in the grips. Amplitudes and
speeds are within the range of the recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pamjax.diagnosis.next_experiment.rig import Corner, RigLimits, sample_path
from pamjax.records.protocol import Schedule

#: Independent samples in the mean of a direct reading; more samples have correlated noise.
INDEPENDENT_READING_COUNT = 10

#: Standard deviation of a reference (dead weights, second gauge): share of the reading; of a gauge block: m.
REFERENCE_SD_SHARE, GAUGE_BLOCK_SD_M = 1e-3, 2e-5


@dataclass(frozen=True)
class PlannedProtocol:
    """A protocol of the list.

    Attributes:
        id: id, for example "X4".
        describe: function of the rig that returns the instruction, one sentence.
        build_corners: function of the rig that returns the path; None if the muscle is not moved.
        get_direct_readings: parameters that are measured directly, by name, with standard deviations, SI.
        operator_minutes: preparation time in addition to the path, min.
        needs_camera: whether the diameter is photographed even if the recording has no diameters.
        in_library: whether a mechanism of the library can change the result.
    """

    id: str
    describe: Callable[[RigLimits], str]
    build_corners: Callable[[RigLimits], list[Corner]] | None = None
    get_direct_readings: Callable[[RigLimits], dict[str, float]] = lambda rig: {}
    operator_minutes: float = 5.0
    needs_camera: bool = False
    in_library: bool = True

    def compute_minutes(self, rig: RigLimits) -> float:
        """Return the duration, min."""
        path = self.build_corners(rig) if self.build_corners else []
        return self.operator_minutes + sum(seconds for seconds, *_ in path) / 60

    def build_schedule(self, rig: RigLimits, begin: float = 0.0) -> Schedule | None:
        """Return at most `MAX_PROTOCOL_ROWS` samples from time `begin` on; None without a path."""
        if self.build_corners is None:
            return None
        optical = self.needs_camera or rig.has_camera
        return sample_path(self.build_corners(rig), rig.step, optical, begin, rig.load is not None)


def _build_start(rig: RigLimits, pressure: float, contraction: float = 0.0) -> Corner:
    return (0.0, pressure, rig.rest_length * (1 - contraction), 1)


def format_kpa(pressure: float) -> str:
    return f"{pressure / 1e3:.3g} kPa"


def _build_low_strokes(rig: RigLimits) -> list[Corner]:
    shares = (0.0, 0.05, 0.1, 0.15, 0.2)
    corners = [_build_start(rig, 0.0)]
    for cycle, share in enumerate(shares, 1):
        deep = rig.max_contraction * (0.15 + 2 * share)
        corners += [(10.0, share * rig.max_pressure, rig.rest_length, cycle)]
        corners += rig.build_stroke(share * rig.max_pressure, deep, rig.speed, cycle)
    return corners


def _build_ramp(rig: RigLimits) -> list[Corner]:
    corners = [_build_start(rig, 0.0)]
    for cycle in (1, 2):
        corners += [(120.0, rig.max_pressure, rig.rest_length, cycle), (120.0, 0.0, rig.rest_length, cycle)]
    return corners


def _build_speeds(rig: RigLimits) -> list[Corner]:
    corners, pressure = [_build_start(rig, 0.5 * rig.max_pressure)], 0.5 * rig.max_pressure
    for cycle, times in enumerate((1, 1, 3, 3, 10, 10), 1):
        corners += rig.build_stroke(pressure, 0.5 * rig.max_contraction, times * rig.speed, cycle)
    return corners


def _build_holds(rig: RigLimits) -> list[Corner]:
    pressure, half, deep = 0.6 * rig.max_pressure, 0.3 * rig.max_contraction, 0.6 * rig.max_contraction
    travel = half * rig.rest_length / rig.speed
    middle, end = rig.rest_length * (1 - half), rig.rest_length * (1 - deep)
    return [
        _build_start(rig, pressure),
        (travel, pressure, middle, 1),
        (300.0, pressure, middle, 1),
        (travel, pressure, end, 2),
        (travel, pressure, middle, 2),
        (300.0, pressure, middle, 2),
    ]


def _build_reversals(rig: RigLimits) -> list[Corner]:
    corners, top = [_build_start(rig, 0.5 * rig.max_pressure)], 0.3 * rig.max_contraction
    for k, pressure in enumerate((0.25 * rig.max_pressure, 0.5 * rig.max_pressure, 0.9 * rig.max_pressure)):
        corners += [(20.0, pressure, rig.rest_length * (1 - top), 3 * k + 1)]
        for j, share in enumerate((0.01, 0.03, 0.1)):
            size = share * rig.max_contraction
            corners += rig.build_stroke(pressure, top + size, 0.3 * rig.speed, 3 * k + j + 1, top)
    return corners


def _build_descending(rig: RigLimits) -> list[Corner]:
    shares, corners = (1.0, 0.7, 0.4, 0.2), [_build_start(rig, 0.0)]
    for cycle, share in enumerate(shares, 1):
        corners += [(10.0, share * rig.max_pressure, rig.rest_length, cycle)]
        deep = rig.max_contraction * (0.3 + 0.6 * share)
        corners += rig.build_stroke(share * rig.max_pressure, deep, rig.speed, cycle)
    return corners


def _build_repeated_low(rig: RigLimits) -> list[Corner]:
    low, deep = 0.2 * rig.max_pressure, 0.4 * rig.max_contraction
    return [
        _build_start(rig, low),
        *rig.build_stroke(low, deep, rig.speed, 1),
        (20.0, rig.max_pressure, rig.rest_length, 2),
        (20.0, low, rig.rest_length, 3),
        *rig.build_stroke(low, deep, rig.speed, 3),
    ]


def _read_zeros(rig: RigLimits) -> dict[str, float]:
    root_count = INDEPENDENT_READING_COUNT**0.5
    return {
        "force_offset.offset": rig.force_noise / root_count,
        "pressure_offset.offset": rig.pressure_noise / root_count,
        "force_drift.rate": rig.force_noise / root_count / max(rig.duration, 60.0),
    }


def _read_bar(rig: RigLimits) -> dict[str, float]:
    root_count = INDEPENDENT_READING_COUNT**0.5
    return {
        "rig_compliance.compliance": rig.length_noise / root_count / rig.max_force,
        "channel_lag.lag": rig.step / root_count,
        "length_offset.offset": max(rig.length_noise / root_count, GAUGE_BLOCK_SD_M),
        "diameter_offset.offset": max(rig.diameter_noise / root_count, GAUGE_BLOCK_SD_M),
    }


def _read_references(rig: RigLimits) -> dict[str, float]:
    root_count = INDEPENDENT_READING_COUNT**0.5
    return {
        "force_gain.gain": max(rig.force_noise / root_count / rig.max_force, REFERENCE_SD_SHARE),
        "pressure_gain.gain": max(rig.pressure_noise / root_count / rig.max_pressure, REFERENCE_SD_SHARE),
        "pressure_offset.offset": max(rig.pressure_noise / root_count, REFERENCE_SD_SHARE * rig.max_pressure),
        "force_offset.offset": max(rig.force_noise / root_count, REFERENCE_SD_SHARE * rig.max_force),
    }


#: The menu of protocols. A negative standard deviation of a direct reading is relative to the value.
PROTOCOL_MENU = (
    PlannedProtocol(
        "X1",
        lambda rig: (
            "Read the load cell and the pressure gauge with the muscle unclamped and vented, now and one hour"
            " later"
        ),
        get_direct_readings=_read_zeros,
        operator_minutes=4.0,
    ),
    PlannedProtocol(
        "X2",
        lambda rig: (
            f"Stroke slowly at 0 and at {format_kpa(0.05 * rig.max_pressure)} to"
            f" {format_kpa(0.2 * rig.max_pressure)}"
        ),
        _build_low_strokes,
    ),
    PlannedProtocol(
        "X3",
        lambda rig: (
            f"Ramp the pressure to {format_kpa(rig.max_pressure)} and back, twice, at the fixed rest length,"
            f" with a photograph of the diameter every {max(rig.step, 1):.2g} s"
        ),
        _build_ramp,
        needs_camera=True,
    ),
    PlannedProtocol(
        "X4",
        lambda rig: (
            f"Make the same stroke at {format_kpa(0.5 * rig.max_pressure)} once, three and ten times as fast"
            f" ({1e3 * rig.speed:.3g} to {1e4 * rig.speed:.3g} mm/s)"
        ),
        _build_speeds,
    ),
    PlannedProtocol(
        "X5",
        lambda rig: (
            f"Hold one length ({0.3 * rig.max_contraction:.0%} contracted) for 300 s at"
            f" {format_kpa(0.6 * rig.max_pressure)}, first after shortening, then after lengthening"
        ),
        _build_holds,
    ),
    PlannedProtocol(
        "X6",
        lambda rig: "Make small strokes (1, 3 and 10 % of the full stroke) at three pressures",
        _build_reversals,
    ),
    PlannedProtocol(
        "X7",
        lambda rig: (
            f"After a night without load, stroke at decreasing pressures from {format_kpa(rig.max_pressure)}"
        ),
        _build_descending,
        operator_minutes=720.0,
    ),
    PlannedProtocol(
        "X8",
        lambda rig: (
            f"Make the same stroke at a low pressure ({format_kpa(0.2 * rig.max_pressure)}) before and"
            f" after the highest pressure"
        ),
        _build_repeated_low,
    ),
    PlannedProtocol(
        "X9",
        lambda rig: (
            f"Clamp a steel bar of known length and width in the rig; pull it to {rig.max_force:.0f} N"
            f" in steps"
        ),
        get_direct_readings=_read_bar,
        operator_minutes=20.0,
    ),
    PlannedProtocol(
        "X10",
        lambda rig: "Hang dead weights on the load cell, and connect a second pressure gauge at the muscle",
        get_direct_readings=_read_references,
        operator_minutes=20.0,
    ),
    PlannedProtocol(
        "X11",
        lambda rig: (
            "Measure the diameter along the muscle, from the fittings to the middle, and check it with a"
            " caliper"
        ),
        get_direct_readings=lambda rig: {
            "end_taper.share": rig.diameter_noise / (0.1 * rig.rest_length) / INDEPENDENT_READING_COUNT**0.5,
            "diameter_offset.offset": max(
                rig.diameter_noise / INDEPENDENT_READING_COUNT**0.5, GAUGE_BLOCK_SD_M
            ),
        },
        operator_minutes=15.0,
    ),
    PlannedProtocol(
        "X12",
        lambda rig: "Mark the free fitting and observe whether it turns under pressure",
        operator_minutes=5.0,
        in_library=False,
    ),
    PlannedProtocol(
        "X13",
        lambda rig: "Repeat one stroke at a temperature that is 15 K higher",
        operator_minutes=120.0,
        in_library=False,
    ),
    PlannedProtocol(
        "X14",
        lambda rig: "Test a bare thread and a strip of the bladder in a tensile testing machine",
        get_direct_readings=lambda rig: {
            "thread.modulus": -0.03,
            "thread.stiffness": -0.03,
            "braid_elasticity.compliance": -0.03,
            "thread_crimp.crimp": -0.1,
            "bladder_elasticity.modulus": -0.05,
        },
        operator_minutes=240.0,
    ),
)
