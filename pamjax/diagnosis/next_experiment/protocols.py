"""A menu of short real protocols, each simulated for the muscle and the rig at hand.

A protocol moves pressure and length along straight lines between a few corners, or reads some number of
the model directly (a vented gauge, a dead weight, a bar in the grips), or both. Sizes are taken from what
the rig has shown it can do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pamjax.diagnosis.next_experiment.rig import Corner, Rig, sampled
from pamjax.records.protocol import Schedule

#: A direct reading is no better than this many independent samples: its noise repeats itself.
READINGS = 10

#: What a reference (dead weights, a second gauge, a gauge block) is worth: share of the reading, and m.
REFERENCE, BLOCK = 1e-3, 2e-5


@dataclass(frozen=True)
class Protocol:
    """One entry of the menu.

    Attributes:
        id: as "X4".
        says: what to do, one sentence, for a rig.
        corners: the path; None where the muscle is not moved.
        direct: numbers that are read directly, SI, each with its standard deviation.
        effort: minutes of the person, beside the path's own.
        camera: whether diameters are photographed even where they usually are not.
        catalogued: whether anything pamjax can name shows in it.
    """

    id: str
    says: Callable[[Rig], str]
    corners: Callable[[Rig], list[Corner]] | None = None
    direct: Callable[[Rig], dict[str, float]] = lambda rig: {}
    effort: float = 5.0
    camera: bool = False
    catalogued: bool = True

    def minutes(self, rig: Rig) -> float:
        """What it costs."""
        path = self.corners(rig) if self.corners else []
        return self.effort + sum(seconds for seconds, *_ in path) / 60

    def schedule(self, rig: Rig, begin: float = 0.0) -> Schedule | None:
        """The samples, `ROWS` at most, from a time on; None where the muscle is not moved."""
        if self.corners is None:
            return None
        return sampled(self.corners(rig), rig.step, self.camera or rig.camera, begin)


def _start(rig: Rig, pressure: float, contraction: float = 0.0) -> Corner:
    return (0.0, pressure, rig.rest * (1 - contraction), 1)


def _kpa(pressure: float) -> str:
    return f"{pressure / 1e3:.3g} kPa"


def _low_strokes(rig: Rig) -> list[Corner]:
    shares = (0.0, 0.05, 0.1, 0.15, 0.2)
    corners = [_start(rig, 0.0)]
    for cycle, share in enumerate(shares, 1):
        deep = rig.contraction * (0.15 + 2 * share)
        corners += [(10.0, share * rig.pressure, rig.rest, cycle)]
        corners += rig.stroke(share * rig.pressure, deep, rig.speed, cycle)
    return corners


def _ramp(rig: Rig) -> list[Corner]:
    corners = [_start(rig, 0.0)]
    for cycle in (1, 2):
        corners += [(120.0, rig.pressure, rig.rest, cycle), (120.0, 0.0, rig.rest, cycle)]
    return corners


def _speeds(rig: Rig) -> list[Corner]:
    corners, pressure = [_start(rig, 0.5 * rig.pressure)], 0.5 * rig.pressure
    for cycle, times in enumerate((1, 1, 3, 3, 10, 10), 1):
        corners += rig.stroke(pressure, 0.5 * rig.contraction, times * rig.speed, cycle)
    return corners


def _holds(rig: Rig) -> list[Corner]:
    pressure, half, deep = 0.6 * rig.pressure, 0.3 * rig.contraction, 0.6 * rig.contraction
    travel = half * rig.rest / rig.speed
    middle, far = rig.rest * (1 - half), rig.rest * (1 - deep)
    return [
        _start(rig, pressure),
        (travel, pressure, middle, 1),
        (300.0, pressure, middle, 1),
        (travel, pressure, far, 2),
        (travel, pressure, middle, 2),
        (300.0, pressure, middle, 2),
    ]


def _reversals(rig: Rig) -> list[Corner]:
    corners, top = [_start(rig, 0.5 * rig.pressure)], 0.3 * rig.contraction
    for k, pressure in enumerate((0.25 * rig.pressure, 0.5 * rig.pressure, 0.9 * rig.pressure)):
        corners += [(20.0, pressure, rig.rest * (1 - top), 3 * k + 1)]
        for j, share in enumerate((0.01, 0.03, 0.1)):
            size = share * rig.contraction
            corners += rig.stroke(pressure, top + size, 0.3 * rig.speed, 3 * k + j + 1, top)
    return corners


def _descending(rig: Rig) -> list[Corner]:
    shares, corners = (1.0, 0.7, 0.4, 0.2), [_start(rig, 0.0)]
    for cycle, share in enumerate(shares, 1):
        corners += [(10.0, share * rig.pressure, rig.rest, cycle)]
        deep = rig.contraction * (0.3 + 0.6 * share)
        corners += rig.stroke(share * rig.pressure, deep, rig.speed, cycle)
    return corners


def _lowest_again(rig: Rig) -> list[Corner]:
    low, deep = 0.2 * rig.pressure, 0.4 * rig.contraction
    return [
        _start(rig, low),
        *rig.stroke(low, deep, rig.speed, 1),
        (20.0, rig.pressure, rig.rest, 2),
        (20.0, low, rig.rest, 3),
        *rig.stroke(low, deep, rig.speed, 3),
    ]


def _zeros(rig: Rig) -> dict[str, float]:
    many = READINGS**0.5
    return {
        "force_offset.offset": rig.force / many,
        "pressure_offset.offset": rig.gauge / many,
        "force_drift.rate": rig.force / many / max(rig.spent, 60.0),
    }


def _bar(rig: Rig) -> dict[str, float]:
    many = READINGS**0.5
    return {
        "rig_compliance.compliance": rig.ruler / many / rig.pull,
        "channel_lag.lag": rig.step / many,
        "length_offset.offset": max(rig.ruler / many, BLOCK),
        "diameter_offset.offset": max(rig.diameter / many, BLOCK),
    }


def _references(rig: Rig) -> dict[str, float]:
    many = READINGS**0.5
    return {
        "force_gain.gain": max(rig.force / many / rig.pull, REFERENCE),
        "pressure_gain.gain": max(rig.gauge / many / rig.pressure, REFERENCE),
        "pressure_offset.offset": max(rig.gauge / many, REFERENCE * rig.pressure),
        "force_offset.offset": max(rig.force / many, REFERENCE * rig.pull),
    }


#: The menu, cheap ones first. What a coupon of thread or bladder is worth is in shares of the value itself:
#: a negative standard deviation says so.
MENU = (
    Protocol(
        "X1",
        lambda rig: (
            "Read the load cell and the gauge with the muscle unclamped and vented, now and an hour on"
        ),
        direct=_zeros,
        effort=4.0,
    ),
    Protocol(
        "X2",
        lambda rig: f"Stroke slowly at 0 and at {_kpa(0.05 * rig.pressure)} to {_kpa(0.2 * rig.pressure)}",
        _low_strokes,
    ),
    Protocol(
        "X3",
        lambda rig: (
            f"Ramp the pressure to {_kpa(rig.pressure)} and back, twice, at the fixed rest length,"
            f" with a photograph of the diameter every {max(rig.step, 1):.2g} s"
        ),
        _ramp,
        camera=True,
    ),
    Protocol(
        "X4",
        lambda rig: (
            f"Make the same stroke at {_kpa(0.5 * rig.pressure)} once, three and ten times as fast"
            f" ({1e3 * rig.speed:.3g} to {1e4 * rig.speed:.3g} mm/s)"
        ),
        _speeds,
    ),
    Protocol(
        "X5",
        lambda rig: (
            f"Hold one length ({0.3 * rig.contraction:.0%} contracted) for 300 s at"
            f" {_kpa(0.6 * rig.pressure)}, reached by shortening and then by lengthening"
        ),
        _holds,
    ),
    Protocol(
        "X6",
        lambda rig: "Make small reversals (1, 3 and 10 % of the stroke) at three pressures",
        _reversals,
    ),
    Protocol(
        "X7",
        lambda rig: f"After a night of rest, stroke at falling pressures from {_kpa(rig.pressure)}",
        _descending,
        effort=720.0,
    ),
    Protocol(
        "X8",
        lambda rig: (
            f"Repeat the stroke at a low pressure ({_kpa(0.2 * rig.pressure)}) before and after the highest"
        ),
        _lowest_again,
    ),
    Protocol(
        "X9",
        lambda rig: (
            f"Put a steel bar of known length and width in the grips; pull it to {rig.pull:.0f} N in steps"
        ),
        direct=_bar,
        effort=20.0,
    ),
    Protocol(
        "X10",
        lambda rig: "Hang dead weights on the load cell, and put a second gauge at the muscle",
        direct=_references,
        effort=20.0,
    ),
    Protocol(
        "X11",
        lambda rig: (
            "Measure the diameter along the muscle, from the fittings to the middle, with a caliper check"
        ),
        direct=lambda rig: {
            "end_taper.share": rig.diameter / (0.1 * rig.rest) / READINGS**0.5,
            "diameter_offset.offset": max(rig.diameter / READINGS**0.5, BLOCK),
        },
        effort=15.0,
    ),
    Protocol(
        "X12",
        lambda rig: "Mark the free fitting and watch whether it turns under pressure",
        effort=5.0,
        catalogued=False,
    ),
    Protocol(
        "X13",
        lambda rig: "Repeat one stroke at a temperature 15 K higher",
        effort=120.0,
        catalogued=False,
    ),
    Protocol(
        "X14",
        lambda rig: "Pull a bare thread and a strip of the bladder in a tensile tester",
        direct=lambda rig: {
            "thread.modulus": -0.03,
            "thread.stiffness": -0.03,
            "braid_elasticity.compliance": -0.03,
            "thread_crimp.crimp": -0.1,
            "bladder_elasticity.modulus": -0.05,
        },
        effort=240.0,
    ),
)
