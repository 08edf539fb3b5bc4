"""Errors of manufacture and of the sensors: those of the spec, or usual ones as shares of the dimensions.

The defaults are standard deviations. Those of lengths and turns are half widths divided by √3. Chambers and
Wereley (Actuators 2022, 11, 219) state for their muscle: 0.8 mm of 235.7 mm, 0.8 mm of 251.2 mm, 0.005 of
1.09 turns. That of the wall follows from the tolerance of the tube. A wall without a tube has that of stock
tubing, see `data/materials/tubes.csv`. Those of pressure and of the set length are a judgement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pamjax.sizing.problem import Choice
from pamjax.sizing.specification.schema import Tolerance

#: Default standard deviations, relative to the dimension; of `position` relative to the rest length.
DEFAULT_SHARES = {
    "rest_length": 0.002,
    "thread_length": 0.002,
    "turns": 0.0025,
    "wall": 0.08,
    "position": 0.001,
    "pressure": 0.01,
}
#: Units of the errors in reports; that of the pressure is a share.
TOLERANCE_UNITS = {
    "rest_length": "mm", "thread_length": "mm", "turns": "1", "wall": "mm", "position": "mm",
}  # fmt: skip


@dataclass(frozen=True)
class BuildErrors:
    """Standard deviations of the errors of one muscle, SI.

    Attributes:
        rest_length, thread_length, wall: m; turns: 1.
        position: of the length at which a force is required, m.
        pressure: of regulator and gauge, as a fraction of the pressure.
        stated: names that the spec states; the others are defaults.
    """

    rest_length: float = 0.0
    thread_length: float = 0.0
    turns: float = 0.0
    wall: float = 0.0
    position: float = 0.0
    pressure: float = 0.0
    stated: tuple[str, ...] = ()


def choose_errors(tolerance: Tolerance, choice: Choice, dimensions: dict[str, float]) -> BuildErrors:
    """Return the standard deviations of a muscle.

    Args:
        tolerance: [tolerance] of the spec.
        choice: its discrete variables; a tube states the tolerance of its wall.
        dimensions: rest_length, thread_length, wall, m, and turns.
    """
    sds = {
        name: share * dimensions["rest_length" if name == "position" else name]
        for name, share in DEFAULT_SHARES.items()
        if name != "pressure"
    }
    sds["pressure"] = DEFAULT_SHARES["pressure"]
    if choice.tube is not None:
        sds["wall"] = choice.tube.wall_tolerance / math.sqrt(3)
    stated = {name: getattr(tolerance, name) for name in DEFAULT_SHARES}
    stated = {name: sd for name, sd in stated.items() if sd is not None}
    return BuildErrors(**(sds | stated), stated=tuple(stated))
