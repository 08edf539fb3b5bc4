"""A rig: what it can do, and a path through pressure and length as it would be recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.records.protocol import Schedule

#: Most rows of a protocol: all are padded to one number, so that one compiled program serves them.
ROWS = 512

#: A corner: seconds to get there, pressure (Pa) and length (m) there, cycle.
Corner = tuple[float, float, float, int]

#: Standard deviation of a diameter from a photograph, m, where the rig has shown none.
CAMERA = 1e-4


@dataclass(frozen=True)
class Rig:
    """What a rig can do, as far as a protocol must know.

    Attributes:
        rest: rest length of the muscle, m.
        pressure: highest pressure, Pa.
        contraction: largest contraction that was reached.
        speed: usual speed of a stroke, m/s.
        step: seconds between samples.
        force, diameter, gauge, ruler: noise of one sample of force (N), diameter (m), pressure (Pa) and
            length (m).
        pull: largest force that was met, N.
        camera: whether diameters are recorded as a matter of course.
        spent: seconds that the recording at hand has taken.
    """

    rest: float
    pressure: float
    contraction: float
    speed: float
    step: float
    force: float
    diameter: float
    gauge: float
    ruler: float
    pull: float
    camera: bool
    spent: float

    def stroke(
        self, pressure: float, deep: float, speed: float, cycle: int, top: float = 0.0
    ) -> list[Corner]:
        """Shortening from one contraction to another, and back."""
        seconds = abs(deep - top) * self.rest / speed
        there, back = (self.rest * (1 - c) for c in (deep, top))
        return [(seconds, pressure, there, cycle), (seconds, pressure, back, cycle)]


def sampled(corners: list[Corner], step: float, optical: bool, begin: float = 0.0) -> Schedule:
    """Straight lines between corners, sampled evenly, and not more often than the rows allow."""
    seconds, pressure, length, cycle = (np.array(x, dtype=float) for x in zip(*corners, strict=True))
    at = np.cumsum(seconds) - seconds[0]
    step = max(step, at[-1] / (ROWS - 1))
    time = np.arange(int(at[-1] / step) + 1) * step
    leg = np.searchsorted(at, time, side="left")
    return Schedule(
        time=begin + time,
        pressure=np.interp(time, at, pressure),
        length=np.interp(time, at, length),
        cycle=cycle[np.minimum(leg, cycle.size - 1)].astype(int),
        optical=np.full(time.size, optical),
    )
