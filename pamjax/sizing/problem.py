"""One choice of thread, count, bladder and parallel muscles, as a smooth problem in five numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pamjax.errors import refuse
from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import (
    COORDINATES,
    MuscleBuild,
    compute_hessian,
    evaluate_candidate,
    locate_output,
)
from pamjax.sizing.materials import BladderKind, ThreadKind
from pamjax.sizing.requirements import MIN_LOG_RATIO, SizingTask, compute_margin, compute_margin_slope
from pamjax.sizing.spec import PACKING_RATIOS, Spec
from pamjax.units import format_quantity

#: Most discrete choices that are enumerated.
MAX_CHOICES = 5000
#: Braid angles at rest, rad, that are looked at unless the spec says otherwise: 50 to 84 degrees.
ANGLE_RANGE = (math.radians(50.0), math.radians(84.0))
#: Largest share of its length by which a muscle could contract.
MAX_SIZING_CONTRACTION = 0.5
#: How far beyond a stated bound a search may go, so that an infeasible spec can be told by how much.
BOUND_EXTENSION = 4.0
#: Margin to everything that is required of a candidate without a balance: as far off as can be.
UNSOLVED_MARGIN = -1e3
#: Smallest and largest muscles, m: length, diameter.
LENGTH_RANGE, DIAMETER_RANGE = (5e-3, 5.0), (0.5e-3, 0.3)

#: Unit in which a person reads an objective.
OBJECTIVE_UNITS = {"diameter": "mm", "mass": "g", "air": "L", "pressure": "kPa", "cost": "1", "length": "mm"}

#: The output that each objective is; the diameter is that of all muscles together.
OBJECTIVE_OUTPUTS = {"diameter": "bundle"} | {
    name: name for name in ("mass", "air", "pressure", "cost", "length")
}


@dataclass(frozen=True)
class Choice:
    """What is counted or picked, not varied smoothly.

    Attributes:
        thread, bladder: of what.
        threads: how many, both families together.
        diameter: of one thread, m.
        parallel: muscles side by side.
        outer_diameter: standard diameter of the bladder, m; None where it is free.
    """

    thread: ThreadKind
    bladder: BladderKind
    threads: int
    diameter: float
    parallel: int
    outer_diameter: float | None = None

    def make_build(self, transfer: CalibrationTransfer | None = None) -> MuscleBuild:
        """What a candidate is made of, at the typical or the calibrated values."""
        modulus, shear, mooney = self.thread.modulus.value, self.bladder.modulus.value, self.bladder.mooney
        if transfer is not None:
            modulus = transfer.get_thread_modulus(self.thread)
            shear, mooney = transfer.get_rubber_moduli(self.bladder)
        return MuscleBuild(
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
            packing=PACKING_RATIOS[self.parallel - 1] if self.parallel <= len(PACKING_RATIOS) else 1.0,
        )

    def __str__(self) -> str:
        thread = f"{self.threads} threads of {self.thread.name}, {format_quantity(self.diameter, 'mm')}"
        muscle = f"{thread}, on {self.bladder.name}"
        return muscle if self.parallel == 1 else f"{self.parallel} muscles of {muscle}"


def list_choices(spec: Spec) -> list[Choice]:
    """Every choice that the catalogue allows.

    Raises:
        BadInput: if there are too many to enumerate.
    """
    outer_diameters = spec.entries.bladders.diameters or (None,)
    all_choices = [
        Choice(thread, bladder, count, diameter, parallel, outer_diameter)
        for thread in spec.threads
        for diameter in thread.diameters
        for bladder, count, parallel, outer_diameter in itertools.product(
            spec.bladders, spec.counts, spec.entries.parallel, outer_diameters
        )
    ]
    if len(all_choices) > MAX_CHOICES:
        rule = f"a catalogue has at most {MAX_CHOICES} combinations"
        raise refuse(rule, f"{len(all_choices)}", spec.file, "Name fewer kinds, counts or diameters.")
    return all_choices


def compute_bounds(spec: Spec, task: SizingTask, choice: Choice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of a search, and the highest of its starts, (5,) each."""
    limits, envelope = spec.entries.limits, spec.entries.envelope
    max_shortening = float(np.max(task.points.shortening))
    shortest = max(LENGTH_RANGE[0], max_shortening / MAX_SIZING_CONTRACTION)
    length = task.find_requirement("length")
    free_length = length.bounds[0] if length else max(20 * max_shortening, 0.2)
    max_diameter = envelope.diameter or (envelope.bundle or DIAMETER_RANGE[1]) / 1.5
    rest_lengths = limits.rest_length or (min(shortest, free_length / 1.5), BOUND_EXTENSION * free_length)
    diameters = limits.diameter or (DIAMETER_RANGE[0], min(BOUND_EXTENSION * max_diameter, DIAMETER_RANGE[1]))
    if choice.outer_diameter is not None:
        diameters = (choice.outer_diameter, choice.outer_diameter)
    wall = limits.wall or choice.bladder.walls
    pressure = (0.02 * spec.supply, BOUND_EXTENSION * spec.supply)
    angle = limits.braid_angle or ANGLE_RANGE
    logs = [np.log(pair) for pair in (rest_lengths, diameters, wall, pressure)]
    low, high = (np.array([logs[0][k], angle[k], *(pair[k] for pair in logs[1:])]) for k in (0, 1))
    start_high = np.log([free_length, 1.0, max(0.9 * max_diameter, diameters[0]), wall[1], spec.supply])
    start_high[1] = high[1]
    return low, high, np.clip(start_high, low, high)


@dataclass(eq=False)
class SizingProblem:
    """Minimise ln(objective) under margins that must not be negative, in coordinates scaled to 0..1.

    Attributes:
        task: places and requirements.
        choice: the discrete part.
        build, numbers, ids: what the candidates are made of.
        low, high, start_high: (5,) coordinates.
        objective: key of `OBJECTIVE_OUTPUTS`.
        back_off: margin that each requirement must keep, by key: what uncertainty takes.
        caps: further outputs with an upper bound, by name.
    """

    task: SizingTask
    choice: Choice
    build: MuscleBuild
    numbers: Mapping[str, float]
    ids: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    start_high: np.ndarray
    objective: str
    back_off: Mapping[str, float] = field(default_factory=dict)
    caps: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        self.free_indices = np.flatnonzero(self.high - self.low > 1e-12)
        requirements = self.task.requirements
        self.owner = np.array([k for k, requirement in enumerate(requirements) for _ in requirement.rows])
        self.rows = np.array([row for requirement in requirements for row in requirement.rows])
        self.bounds = np.array([bound for requirement in requirements for bound in requirement.bounds])
        self.sense = np.array(
            [requirement.sense for requirement in requirements for _ in requirement.rows], float
        )
        self.scale = np.array([requirement.scale for requirement in requirements for _ in requirement.rows])
        self.row_back_off = np.array(
            [
                self.back_off.get(requirement.key, 0.0)
                for requirement in requirements
                for _ in requirement.rows
            ]
        )
        for name, cap in self.caps.items():
            self.owner = np.append(self.owner, -1)
            self.rows = np.append(self.rows, locate_output(OBJECTIVE_OUTPUTS[name]))
            self.bounds, self.sense = np.append(self.bounds, cap), np.append(self.sense, -1.0)
            self.scale, self.row_back_off = np.append(self.scale, cap), np.append(self.row_back_off, 0.0)
        self._cached: tuple[bytes, tuple] = (b"", ())

    def compute_margins(self, y: np.ndarray) -> np.ndarray:
        """(..., rows) of outputs (..., m), less what is kept back."""
        return compute_margin(y[..., self.rows], self.bounds, self.sense, self.scale) - self.row_back_off

    def to_coordinates(self, z: np.ndarray) -> np.ndarray:
        """(5,) from the (free,) scaled ones."""
        c = self.low.copy()
        c[self.free_indices] += z * (self.high - self.low)[self.free_indices]
        return c

    def to_scaled(self, c: np.ndarray) -> np.ndarray:
        """(free,) scaled, clipped to the box."""
        span = (self.high - self.low)[self.free_indices]
        return np.clip((c - self.low)[self.free_indices] / span, 0.0, 1.0)

    def evaluate(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Objective and margins with their slopes: f, (free,), (rows,), (rows, free)."""
        key = z.tobytes()
        if key != self._cached[0]:
            y, slope = evaluate_candidate(
                self.to_coordinates(z), self.build, self.numbers, self.task.points, self.ids
            )
            slope = slope[:, self.free_indices] * (self.high - self.low)[self.free_indices]
            unsolved = y[locate_output("unsolved")] > 0 or not (
                np.all(np.isfinite(y)) and np.all(np.isfinite(slope))
            )
            if unsolved:
                # What has no balance shows nothing: as far from every requirement as can be, and flat.
                y, slope = np.where(np.isfinite(y), y, 1e9), np.zeros_like(slope)
            objective_index = locate_output(OBJECTIVE_OUTPUTS[self.objective])
            objective = max(float(y[objective_index]), 1e-12)
            margins = np.full(self.rows.size, UNSOLVED_MARGIN) if unsolved else self.compute_margins(y)
            slopes = (self.sense * compute_margin_slope(y[self.rows], self.bounds, self.scale))[
                :, None
            ] * slope[self.rows]
            self._cached = key, (math.log(objective), slope[objective_index] / objective, margins, slopes, y)
        return self._cached[1][:4]

    def is_unsolved(self, z: np.ndarray) -> bool:
        """Whether the candidate has no balance somewhere."""
        return bool(np.min(self.evaluate(z)[2]) <= UNSOLVED_MARGIN)

    def compute_outputs(self, z: np.ndarray) -> np.ndarray:
        """(m,) everything the candidate shows."""
        self.evaluate(z)
        return self._cached[1][4]

    def compute_hessian(self, z: np.ndarray, weights: np.ndarray, objective: float = 0.0) -> np.ndarray:
        """Hessian of objective × f + weights · margins, (free, free), exact."""
        c, y = self.to_coordinates(z), self.compute_outputs(z)
        objective_index = locate_output(OBJECTIVE_OUTPUTS[self.objective])
        by_row = np.zeros(y.size)
        slant = self.sense * compute_margin_slope(y[self.rows], self.bounds, self.scale)
        np.add.at(by_row, self.rows, weights * slant)
        by_row[objective_index] += objective / y[objective_index]
        whole = compute_hessian(c, by_row, self.build, self.numbers, self.task.points, self.ids)
        span = (self.high - self.low)[self.free_indices]
        hessian = whole[np.ix_(self.free_indices, self.free_indices)] * np.outer(span, span)
        # ln y has −y'y'ᵀ/y² beside y''/y, in the objective and in every room that is a ratio.
        _, slope, _, slopes = self.evaluate(z)
        by_ratio = weights * self.sense * ((self.bounds > 0) & (y[self.rows] > MIN_LOG_RATIO * self.bounds))
        return hessian - objective * np.outer(slope, slope) - (slopes.T * by_ratio) @ slopes

    def copy_with(self, **changes) -> SizingProblem:
        """A copy with some attributes changed."""
        return replace(self, **changes)

    def name_coordinates(self, z: np.ndarray) -> dict[str, float]:
        """The coordinates by name, SI."""
        c = self.to_coordinates(z)
        values = [c[1] if name == "braid_angle" else math.exp(c[k]) for k, name in enumerate(COORDINATES)]
        return dict(zip(COORDINATES, values, strict=True))


def build_problem(
    spec: Spec, task: SizingTask, choice: Choice, transfer: CalibrationTransfer
) -> SizingProblem:
    """The problem of one choice."""
    low, high, start_high = compute_bounds(spec, task, choice)
    build = choice.make_build(transfer)
    return SizingProblem(
        task, choice, build, transfer.numbers, transfer.ids, low, high, start_high, spec.entries.minimise
    )
