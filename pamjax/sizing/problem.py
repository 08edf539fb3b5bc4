"""The smooth optimisation problem of one choice of materials and counts, in five coordinates."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from pamjax.errors import BadInput
from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import (
    COORDINATES,
    MuscleBuild,
    build_evaluation,
    compute_hessian,
    locate_output,
)
from pamjax.sizing.requirements import MIN_LOG_RATIO, SizingTask, compute_margin, compute_margin_slope
from pamjax.sizing.specification.materials import BladderKind, ThreadKind
from pamjax.sizing.specification.parts import Tube, find_yarn_count
from pamjax.sizing.specification.spec import PACKING_RATIOS, Spec
from pamjax.units import format_quantity

#: Largest number of discrete choices.
_MAX_CHOICES = 5000
#: Default range of the braid angle at rest, rad: 50 to 84 degrees.
_ANGLE_RANGE = (math.radians(50.0), math.radians(84.0))
#: The same for sold parts, a judgement: braids are seldom closer than 15 degrees to the axis,
#: see `data/materials/sleeves.csv`.
_BUILDABLE_ANGLE_RANGE = (math.radians(50.0), math.radians(75.0))
#: Upper limit of the contraction of any muscle.
MAX_SIZING_CONTRACTION = 0.5
#: Factor by which a search may exceed a stated bound, so that the violation of an infeasible spec is known.
_BOUND_EXTENSION = 4.0
#: Margin of every requirement for a candidate without equilibrium.
_UNSOLVED_MARGIN = -1e3
#: Smallest and largest length and diameter of a muscle, m.
_LENGTH_RANGE, _DIAMETER_RANGE = (5e-3, 5.0), (0.5e-3, 0.3)

#: Unit of each objective in reports.
OBJECTIVE_UNITS = {"diameter": "mm", "mass": "g", "air": "L", "pressure": "kPa", "cost": "1", "length": "mm"}

#: Output of each objective; the diameter is that of all muscles together.
OBJECTIVE_OUTPUTS = {"diameter": "bundle"} | {
    name: name for name in ("mass", "air", "pressure", "cost", "length")
}


@dataclass(frozen=True)
class Choice:
    """The discrete variables of a muscle.

    Attributes:
        thread, bladder: materials.
        threads: number of threads, both families together.
        diameter: diameter of one thread, m.
        parallel: number of muscles in parallel.
        outer_diameter: standard outer diameter of the bladder, m; None if it is a free coordinate.
        tube: tube that is sold; None if diameter and wall are free coordinates.
    """

    thread: ThreadKind
    bladder: BladderKind
    threads: int
    diameter: float
    parallel: int
    outer_diameter: float | None = None
    tube: Tube | None = None

    @property
    def yarn_count(self) -> float | None:
        """Return the count of the yarn, kg/m; None if the thread is not a yarn of the table."""
        return find_yarn_count(self.thread, self.diameter)

    def make_build(self, transfer: CalibrationTransfer | None = None) -> MuscleBuild:
        """Return the build of a candidate with typical or calibrated material properties."""
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

    def describe_thread(self) -> str:
        """Return the size of a thread: the count of a yarn, else the diameter."""
        diameter = format_quantity(self.diameter, "mm", 2)
        if self.yarn_count is None:
            return format_quantity(self.diameter, "mm")
        return f"{format_quantity(self.yarn_count, 'dtex')} ({diameter})"

    def describe_bladder(self) -> str:
        """Return the rubber, and the size of the tube if it is one that is sold."""
        return (
            f"{self.bladder.name} bladder"
            if self.tube is None
            else f"{self.bladder.name} tube of {self.tube.metric_size}"
        )

    def __str__(self) -> str:
        thread = f"{self.threads} {self.thread.name} threads of {self.describe_thread()}"
        muscle = f"{thread}, {self.describe_bladder()}"
        return muscle if self.parallel == 1 else f"{self.parallel} muscles in parallel, each with {muscle}"


def list_choices(spec: Spec) -> list[Choice]:
    """Return all choices of the catalogue.

    Raises:
        BadInput: if there are more than `_MAX_CHOICES`.
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
    if len(all_choices) > _MAX_CHOICES:
        rule = f"a catalogue must have at most {_MAX_CHOICES} combinations"
        raise BadInput.from_rule(
            rule, f"{len(all_choices)}", spec.file, "List fewer kinds, counts or diameters."
        )
    return all_choices


def compute_bounds(spec: Spec, task: SizingTask, choice: Choice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lowest and highest coordinates of a search, and the highest of its starts, (5,) each."""
    limits, envelope = spec.entries.limits, spec.entries.envelope
    max_shortening = float(np.max(task.points.shortening))
    shortest = max(_LENGTH_RANGE[0], max_shortening / MAX_SIZING_CONTRACTION)
    length = task.find_requirement("length")
    free_length = length.bounds[0] if length else max(20 * max_shortening, 0.2)
    max_diameter = envelope.diameter or (envelope.bundle or _DIAMETER_RANGE[1]) / 1.5
    rest_lengths = limits.rest_length or (min(shortest, free_length / 1.5), _BOUND_EXTENSION * free_length)
    diameters = limits.diameter or (
        _DIAMETER_RANGE[0],
        min(_BOUND_EXTENSION * max_diameter, _DIAMETER_RANGE[1]),
    )
    if choice.outer_diameter is not None:
        diameters = (choice.outer_diameter, choice.outer_diameter)
    wall = limits.wall or choice.bladder.walls
    if choice.tube is not None:
        diameters, wall = (choice.tube.outer_diameter,) * 2, (choice.tube.wall,) * 2
    pressure = (0.02 * spec.supply, _BOUND_EXTENSION * spec.supply)
    angle = limits.braid_angle or (_BUILDABLE_ANGLE_RANGE if spec.stock else _ANGLE_RANGE)
    logs = [np.log(pair) for pair in (rest_lengths, diameters, wall, pressure)]
    low, high = (np.array([logs[0][k], angle[k], *(pair[k] for pair in logs[1:])]) for k in (0, 1))
    start_high = np.log([free_length, 1.0, max(0.9 * max_diameter, diameters[0]), wall[1], spec.supply])
    start_high[1] = high[1]
    return low, high, np.clip(start_high, low, high)


@dataclass(eq=False)
class SizingProblem:
    """Minimisation of ln(objective) with margins that must not be negative, in coordinates scaled to 0..1.

    Attributes:
        task: operating points and requirements.
        choice: the discrete variables.
        build, numbers, ids: material properties, and the transferred mechanisms with their parameters.
        low, high, start_high: (5,) bounds of the coordinates and of the starts.
        objective: key of `OBJECTIVE_OUTPUTS`.
        back_off: smallest permitted margin of each requirement, by key, as an allowance for uncertainty.
        caps: upper bounds of further objectives, by name.
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
        """Return the margins, (..., rows), of outputs (..., m), less the back-off."""
        return compute_margin(y[..., self.rows], self.bounds, self.sense, self.scale) - self.row_back_off

    def to_coordinates(self, z: np.ndarray) -> np.ndarray:
        """Return the coordinates, (5,), from the scaled free coordinates, (free,)."""
        c = self.low.copy()
        c[self.free_indices] += z * (self.high - self.low)[self.free_indices]
        return c

    def to_scaled(self, c: np.ndarray) -> np.ndarray:
        """Return the scaled free coordinates, (free,), clipped to 0..1."""
        span = (self.high - self.low)[self.free_indices]
        return np.clip((c - self.low)[self.free_indices] / span, 0.0, 1.0)

    def __getstate__(self) -> dict[str, Any]:
        # A compiled program cannot be pickled.
        return {name: value for name, value in self.__dict__.items() if name != "_evaluation"}

    @cached_property
    def _evaluation(self) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
        return build_evaluation(self.build, self.numbers, self.task.points, self.ids)

    def evaluate(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Return f, its slope (free,), the margins (rows,) and their slopes (rows, free)."""
        key = z.tobytes()
        if key != self._cached[0]:
            y, slope = self._evaluation(self.to_coordinates(z))
            slope = slope[:, self.free_indices] * (self.high - self.low)[self.free_indices]
            is_unsolved = y[locate_output("unsolved")] > 0 or not (
                np.all(np.isfinite(y)) and np.all(np.isfinite(slope))
            )
            if is_unsolved:
                # A candidate without equilibrium violates every requirement, and has zero slopes.
                y, slope = np.where(np.isfinite(y), y, 1e9), np.zeros_like(slope)
            objective_index = locate_output(OBJECTIVE_OUTPUTS[self.objective])
            objective = max(float(y[objective_index]), 1e-12)
            margins = np.full(self.rows.size, _UNSOLVED_MARGIN) if is_unsolved else self.compute_margins(y)
            slopes = (self.sense * compute_margin_slope(y[self.rows], self.bounds, self.scale))[
                :, None
            ] * slope[self.rows]
            self._cached = key, (math.log(objective), slope[objective_index] / objective, margins, slopes, y)
        return self._cached[1][:4]

    def is_unsolved(self, z: np.ndarray) -> bool:
        """Return whether the candidate lacks an equilibrium at some operating point."""
        return bool(np.min(self.evaluate(z)[2]) <= _UNSOLVED_MARGIN)

    def compute_outputs(self, z: np.ndarray) -> np.ndarray:
        """Return the outputs of the candidate, (m,), in the order of `candidate.compute_outputs`."""
        self.evaluate(z)
        return self._cached[1][4]

    def compute_hessian(self, z: np.ndarray, weights: np.ndarray, objective: float = 0.0) -> np.ndarray:
        """Return the exact Hessian of objective × f + weights · margins, (free, free)."""
        c, y = self.to_coordinates(z), self.compute_outputs(z)
        objective_index = locate_output(OBJECTIVE_OUTPUTS[self.objective])
        output_weights = np.zeros(y.size)
        margin_slope = self.sense * compute_margin_slope(y[self.rows], self.bounds, self.scale)
        np.add.at(output_weights, self.rows, weights * margin_slope)
        output_weights[objective_index] += objective / y[objective_index]
        full_hessian = compute_hessian(
            c, output_weights, self.build, self.numbers, self.task.points, self.ids
        )
        span = (self.high - self.low)[self.free_indices]
        hessian = full_hessian[np.ix_(self.free_indices, self.free_indices)] * np.outer(span, span)
        # (ln y)'' = y''/y − y'y'ᵀ/y²: the second term, in the objective and in every logarithmic margin.
        _, slope, _, slopes = self.evaluate(z)
        log_weights = (
            weights * self.sense * ((self.bounds > 0) & (y[self.rows] > MIN_LOG_RATIO * self.bounds))
        )
        return hessian - objective * np.outer(slope, slope) - (slopes.T * log_weights) @ slopes

    def copy_with(self, **changes) -> SizingProblem:
        """Return a copy with some attributes changed."""
        return replace(self, **changes)

    def name_coordinates(self, z: np.ndarray) -> dict[str, float]:
        """Return the coordinates by name, SI."""
        c = self.to_coordinates(z)
        values = [c[1] if name == "braid_angle" else math.exp(c[k]) for k, name in enumerate(COORDINATES)]
        return dict(zip(COORDINATES, values, strict=True))


def build_problem(
    spec: Spec, task: SizingTask, choice: Choice, transfer: CalibrationTransfer
) -> SizingProblem:
    """Return the optimisation problem of one choice."""
    low, high, start_high = compute_bounds(spec, task, choice)
    build = choice.make_build(transfer)
    return SizingProblem(
        task, choice, build, transfer.numbers, transfer.ids, low, high, start_high, spec.entries.minimise
    )
