"""One choice of thread, count, bladder and parallel muscles, as a smooth problem in five numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pamjax.errors import refuse
from pamjax.sizing.calibration import Handed
from pamjax.sizing.candidate import COORDINATES, Made, curved, index, shown
from pamjax.sizing.materials import BladderKind, ThreadKind
from pamjax.sizing.requirements import TENTH, Asked, room, steep
from pamjax.sizing.spec import PACKING, Spec
from pamjax.units import show

#: Most discrete choices that are enumerated.
MOST_CHOICES = 5000
#: Braid angles at rest, rad, that are looked at unless the spec says otherwise: 50 to 84 degrees.
ANGLES = (math.radians(50.0), math.radians(84.0))
#: Largest share of its length by which a muscle could contract.
DEEPEST = 0.5
#: How far beyond a stated bound a search may go, so that an infeasible spec can be told by how much.
BEYOND = 4.0
#: Margin to everything that is required of a candidate without a balance: as far off as can be.
LOST = -1e3
#: Smallest and largest muscles, m: length, diameter.
LENGTHS, DIAMETERS = (5e-3, 5.0), (0.5e-3, 0.3)

#: Unit in which a person reads an objective.
UNITS = {"diameter": "mm", "mass": "g", "air": "L", "pressure": "kPa", "cost": "1", "length": "mm"}

#: The output that each objective is; the diameter is that of all muscles together.
OUTPUT = {"diameter": "bundle"} | {name: name for name in ("mass", "air", "pressure", "cost", "length")}


@dataclass(frozen=True)
class Choice:
    """What is counted or picked, not varied smoothly.

    Attributes:
        thread, bladder: of what.
        threads: how many, both families together.
        diameter: of one thread, m.
        parallel: muscles side by side.
        outside: standard diameter of the bladder, m; None where it is free.
    """

    thread: ThreadKind
    bladder: BladderKind
    threads: int
    diameter: float
    parallel: int
    outside: float | None = None

    def made(self, handed: Handed | None = None) -> Made:
        """What a candidate is made of, at the typical or the calibrated values."""
        modulus, shear, mooney = self.thread.modulus.value, self.bladder.modulus.value, self.bladder.mooney
        if handed is not None:
            modulus = handed.modulus(self.thread)
            shear, mooney = handed.rubber(self.bladder)
        return Made(
            threads=self.threads,
            thread_diameter=self.diameter,
            thread_area=self.thread.area(self.diameter),
            modulus=modulus,
            strength=self.thread.strength.value,
            density=self.thread.density,
            price=self.thread.price or 0.0,
            shear=shear,
            mooney=mooney,
            elongation=self.bladder.elongation,
            rubber_density=self.bladder.density,
            rubber_price=self.bladder.price or 0.0,
            parallel=self.parallel,
            packing=PACKING[self.parallel - 1] if self.parallel <= len(PACKING) else 1.0,
        )

    def __str__(self) -> str:
        thread = f"{self.threads} threads of {self.thread.name}, {show(self.diameter, 'mm')}"
        one = f"{thread}, on {self.bladder.name}"
        return one if self.parallel == 1 else f"{self.parallel} muscles of {one}"


def choices(spec: Spec) -> list[Choice]:
    """Every choice that the catalogue allows.

    Raises:
        BadInput: if there are too many to enumerate.
    """
    outsides = spec.words.bladders.diameters or (None,)
    found = [
        Choice(thread, bladder, count, diameter, parallel, outside)
        for thread in spec.threads
        for diameter in thread.diameters
        for bladder, count, parallel, outside in itertools.product(
            spec.bladders, spec.counts, spec.words.parallel, outsides
        )
    ]
    if len(found) > MOST_CHOICES:
        rule = f"a catalogue has at most {MOST_CHOICES} combinations"
        raise refuse(rule, f"{len(found)}", spec.file, "Name fewer kinds, counts or diameters.")
    return found


def boxes(spec: Spec, asked: Asked, choice: Choice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of a search, and the highest of its starts, (5,) each."""
    limits, room = spec.words.limits, spec.words.envelope
    moved = float(np.max(asked.places.shortening))
    shortest = max(LENGTHS[0], moved / DEEPEST)
    length = asked.get("length")
    free = length.bounds[0] if length else max(20 * moved, 0.2)
    wide = room.diameter or (room.bundle or DIAMETERS[1]) / 1.5
    rest = limits.rest_length or (min(shortest, free / 1.5), BEYOND * free)
    across = limits.diameter or (DIAMETERS[0], min(BEYOND * wide, DIAMETERS[1]))
    if choice.outside is not None:
        across = (choice.outside, choice.outside)
    wall = limits.wall or choice.bladder.walls
    pressure = (0.02 * spec.supply, BEYOND * spec.supply)
    angle = limits.braid_angle or ANGLES
    logs = [np.log(pair) for pair in (rest, across, wall, pressure)]
    low, high = (np.array([logs[0][k], angle[k], *(pair[k] for pair in logs[1:])]) for k in (0, 1))
    usual = np.log([free, 1.0, max(0.9 * wide, across[0]), wall[1], spec.supply])
    usual[1] = high[1]
    return low, high, np.clip(usual, low, high)


@dataclass(eq=False)
class Problem:
    """Minimise ln(objective) under margins that must not be negative, in coordinates scaled to 0..1.

    Attributes:
        asked: places and requirements.
        choice: the discrete part.
        made, numbers, ids: what the candidates are made of.
        low, high, usual: (5,) coordinates.
        objective: key of `OUTPUT`.
        back_off: margin that each requirement must keep, by key: what uncertainty takes.
        caps: further outputs with an upper bound, by name.
    """

    asked: Asked
    choice: Choice
    made: Made
    numbers: Mapping[str, float]
    ids: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    usual: np.ndarray
    objective: str
    back_off: Mapping[str, float] = field(default_factory=dict)
    caps: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        self.free = np.flatnonzero(self.high - self.low > 1e-12)
        every = self.asked.requirements
        self.owner = np.array([k for k, one in enumerate(every) for _ in one.rows])
        self.rows = np.array([row for one in every for row in one.rows])
        self.bounds = np.array([bound for one in every for bound in one.bounds])
        self.sense = np.array([one.sense for one in every for _ in one.rows], float)
        self.scale = np.array([one.scale for one in every for _ in one.rows])
        self.kept = np.array([self.back_off.get(one.key, 0.0) for one in every for _ in one.rows])
        for name, cap in self.caps.items():
            self.owner = np.append(self.owner, -1)
            self.rows = np.append(self.rows, index(OUTPUT[name]))
            self.bounds, self.sense = np.append(self.bounds, cap), np.append(self.sense, -1.0)
            self.scale, self.kept = np.append(self.scale, cap), np.append(self.kept, 0.0)
        self._at: tuple[bytes, tuple] = (b"", ())

    def margins(self, y: np.ndarray) -> np.ndarray:
        """(..., rows) of outputs (..., m), less what is kept back."""
        return room(y[..., self.rows], self.bounds, self.sense, self.scale) - self.kept

    def coordinates(self, z: np.ndarray) -> np.ndarray:
        """(5,) from the (free,) scaled ones."""
        c = self.low.copy()
        c[self.free] += z * (self.high - self.low)[self.free]
        return c

    def scaled(self, c: np.ndarray) -> np.ndarray:
        """(free,) scaled, clipped to the box."""
        span = (self.high - self.low)[self.free]
        return np.clip((c - self.low)[self.free] / span, 0.0, 1.0)

    def at(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Objective and margins with their slopes: f, (free,), (rows,), (rows, free)."""
        key = z.tobytes()
        if key != self._at[0]:
            y, slope = shown(self.coordinates(z), self.made, self.numbers, self.asked.places, self.ids)
            slope = slope[:, self.free] * (self.high - self.low)[self.free]
            lost = y[index("unsolved")] > 0 or not (np.all(np.isfinite(y)) and np.all(np.isfinite(slope)))
            if lost:
                # What has no balance shows nothing: as far from every requirement as can be, and flat.
                y, slope = np.where(np.isfinite(y), y, 1e9), np.zeros_like(slope)
            goal = index(OUTPUT[self.objective])
            best = max(float(y[goal]), 1e-12)
            margins = np.full(self.rows.size, LOST) if lost else self.margins(y)
            slopes = (self.sense * steep(y[self.rows], self.bounds, self.scale))[:, None] * slope[self.rows]
            self._at = key, (math.log(best), slope[goal] / best, margins, slopes, y)
        return self._at[1][:4]

    def lost(self, z: np.ndarray) -> bool:
        """Whether the candidate has no balance somewhere."""
        return bool(np.min(self.at(z)[2]) <= LOST)

    def outputs(self, z: np.ndarray) -> np.ndarray:
        """(m,) everything the candidate shows."""
        self.at(z)
        return self._at[1][4]

    def curvature(self, z: np.ndarray, weights: np.ndarray, objective: float = 0.0) -> np.ndarray:
        """Hessian of objective × f + weights · margins, (free, free), exact."""
        c, y = self.coordinates(z), self.outputs(z)
        goal = index(OUTPUT[self.objective])
        by_row = np.zeros(y.size)
        slant = self.sense * steep(y[self.rows], self.bounds, self.scale)
        np.add.at(by_row, self.rows, weights * slant)
        by_row[goal] += objective / y[goal]
        whole = curved(c, by_row, self.made, self.numbers, self.asked.places, self.ids)
        span = (self.high - self.low)[self.free]
        found = whole[np.ix_(self.free, self.free)] * np.outer(span, span)
        # ln y has −y'y'ᵀ/y² beside y''/y, in the objective and in every room that is a ratio.
        _, slope, _, slopes = self.at(z)
        by_ratio = weights * self.sense * ((self.bounds > 0) & (y[self.rows] > TENTH * self.bounds))
        return found - objective * np.outer(slope, slope) - (slopes.T * by_ratio) @ slopes

    def with_(self, **changes) -> Problem:
        """A copy with some attributes changed."""
        return replace(self, **changes)

    def named(self, z: np.ndarray) -> dict[str, float]:
        """The coordinates by name, SI."""
        c = self.coordinates(z)
        plain = [c[1] if name == "braid_angle" else math.exp(c[k]) for k, name in enumerate(COORDINATES)]
        return dict(zip(COORDINATES, plain, strict=True))


def problem(spec: Spec, asked: Asked, choice: Choice, handed: Handed) -> Problem:
    """The problem of one choice."""
    low, high, usual = boxes(spec, asked, choice)
    made = choice.made(handed)
    return Problem(asked, choice, made, handed.numbers, handed.ids, low, high, usual, spec.words.minimise)
