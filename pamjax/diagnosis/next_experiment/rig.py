"""Limits of a rig, and the samples of a path of pressure and length on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.records.protocol import Schedule
from pamjax.records.reading.muscle_toml import MuscleToml

#: Largest number of rows of a protocol. All protocols are padded to it and use one compiled program.
MAX_PROTOCOL_ROWS = 512

#: A corner of a path: seconds from the last corner, pressure (Pa), length (m), cycle. On an isotonic rig, the
#: set force (N) takes the place of the length.
Corner = tuple[float, float, float, int]

#: Standard deviation of a diameter from a photograph, m, if the recording has no diameters.
CAMERA_SD_M = 1e-4

#: Load that an isotonic rig can add, as a share of the ideal force at the highest pressure and rest length.
_LOAD_SHARE = 0.2


@dataclass(frozen=True)
class RigLimits:
    """Limits and noise of a rig.

    Attributes:
        rest_length: rest length of the muscle, m.
        max_pressure: highest pressure, Pa.
        max_contraction: largest contraction of the recording.
        speed: usual speed of a stroke, m/s.
        step: time between samples, s.
        force_noise, diameter_noise, pressure_noise, length_noise: noise of one sample of force (N),
            diameter (m), pressure (Pa) and length (m), 1 sd.
        max_force: largest force of the recording, N; on an isotonic rig, a load that a muscle can lift.
        has_camera: whether the recording has diameters.
        duration: duration of the recording, s.
        load: usual set force of an isotonic rig, N; None if the rig sets the length and measures the force.
        pressure_speed: usual speed of a pressure ramp on an isotonic rig, Pa/s.
    """

    rest_length: float
    max_pressure: float
    max_contraction: float
    speed: float
    step: float
    force_noise: float
    diameter_noise: float
    pressure_noise: float
    length_noise: float
    max_force: float
    has_camera: bool
    duration: float
    load: float | None = None
    pressure_speed: float = 0.0

    def build_stroke(
        self, pressure: float, deep: float, speed: float, cycle: int, top: float = 0.0
    ) -> list[Corner]:
        """Return the corners of a stroke from contraction `top` to `deep` and back."""
        seconds = abs(deep - top) * self.rest_length / speed
        return [(seconds, pressure, self.rest_length * (1 - c), cycle) for c in (deep, top)]

    def build_pressure_ramp(
        self, peak: float, speed_factor: float, cycle: int, load: float, base: float = 0.0
    ) -> list[Corner]:
        """Return the corners of a pressure ramp from `base` to `peak` and back at a set force."""
        seconds = max(abs(peak - base) / (speed_factor * self.pressure_speed), self.step)
        return [(seconds, peak, load, cycle), (seconds, base, load, cycle)]


def compute_usual_load(muscle_toml: MuscleToml, max_pressure: float) -> float:
    """Return a weight that a muscle can lift, N: a share of its ideal force at the highest pressure and rest.

    The ideal force of inextensible threads of length B with N turns is P (3 L² − B²) / (4 π N²).
    """
    thread, turns = muscle_toml.braid
    area = (3.0 * muscle_toml.rest_length.value**2 - thread**2) / (4.0 * np.pi * turns**2)
    return _LOAD_SHARE * max_pressure * area


def sample_path(
    corners: list[Corner], step: float, optical: bool, begin: float = 0.0, sets_force: bool = False
) -> Schedule:
    """Return even samples of straight lines between corners, with at most `MAX_PROTOCOL_ROWS` rows.

    If the path sets the force, the lengths follow from the muscle, and are NaN here.
    """
    seconds, pressure, second, cycle = (np.array(x, dtype=float) for x in zip(*corners, strict=True))
    arrival_time = np.cumsum(seconds) - seconds[0]
    step = max(step, arrival_time[-1] / (MAX_PROTOCOL_ROWS - 1))
    time = np.arange(int(arrival_time[-1] / step) + 1) * step
    leg = np.searchsorted(arrival_time, time, side="left")
    second_input = np.interp(time, arrival_time, second)
    return Schedule(
        time=begin + time,
        pressure=np.interp(time, arrival_time, pressure),
        length=np.full(time.size, np.nan) if sets_force else second_input,
        cycle=cycle[np.minimum(leg, cycle.size - 1)].astype(int),
        diameter_measured=np.full(time.size, optical),
        load=second_input if sets_force else None,
    )
