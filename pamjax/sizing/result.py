"""A sized muscle: what was chosen, what it will do, what it costs, and what would have to give."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pamjax.model.bench import Bench
from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import OperatingPoints, build_bench, evaluate_many, locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.inelastic import InelasticCost
from pamjax.sizing.infeasible import Relaxation
from pamjax.sizing.pareto import ParetoFront
from pamjax.sizing.problem import OBJECTIVE_OUTPUTS, Choice, SizingProblem
from pamjax.sizing.requirements import SizingTask
from pamjax.sizing.sensitivity import ShadowPrice
from pamjax.sizing.spec import Spec


@dataclass(frozen=True, eq=False)
class Design:
    """The answer to a spec; prints as a lab note.

    Attributes:
        spec, task, transfer: what was wanted, and what a calibration handed on.
        results: every choice that was searched, the best first.
        chosen: the answer; where the spec cannot be met, the candidate that comes nearest.
        probability: that everything holds, over the draws; NaN where the spec cannot be met.
        requirement_probabilities: the same of each requirement, by key.
        prices: requirements that cost something, the dearest first.
        property_sensitivities: per cent of the objective for a per cent of a property, by its words.
        active_limits: coordinates at an end of their range.
        relaxations: what would have to give; empty where the spec is met.
        inelastic_costs: of the inelastic assumption.
        front: between two objectives, None where the spec cannot be met.
        unsearched_count: choices that were looked at but not searched.
        seed, method: of the search.
        misses_probability: whether a probability was wanted that no choice holds.
    """

    spec: Spec
    task: SizingTask
    transfer: CalibrationTransfer
    results: tuple[ChoiceResult, ...]
    chosen: ChoiceResult
    probability: float = math.nan
    requirement_probabilities: dict[str, float] = field(default_factory=dict)
    prices: tuple[ShadowPrice, ...] = ()
    property_sensitivities: dict[str, float] = field(default_factory=dict)
    active_limits: tuple[str, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    inelastic_costs: tuple[InelasticCost, ...] = ()
    front: ParetoFront | None = None
    unsearched_count: int = 0
    seed: int = 0
    method: str = "slsqp"
    misses_probability: bool = False

    @property
    def feasible(self) -> bool:
        """Whether the spec can be met."""
        return self.chosen.optimum is not None

    @property
    def problem(self) -> SizingProblem:
        return self.chosen.problem

    @property
    def choice(self) -> Choice:
        """Thread, count, bladder and number of muscles."""
        return self.chosen.problem.choice

    @cached_property
    def z(self) -> np.ndarray:
        """(free,) scaled coordinates of the chosen muscle."""
        return self.chosen.optimum.z if self.chosen.optimum is not None else self.chosen.start

    @cached_property
    def outputs(self) -> np.ndarray:
        """Everything that the chosen muscle shows, in the order of `candidate.compute_outputs`."""
        return self.problem.compute_outputs(self.z)

    def output(self, name: str, point: int | None = None) -> float:
        """One of them, SI."""
        return float(self.outputs[locate_output(name, point)])

    @cached_property
    def numbers(self) -> dict[str, float]:
        """The chosen muscle's own numbers, SI."""
        choice = self.choice
        named = self.problem.name_coordinates(self.z)
        return named | {
            "thread_length": self.output("thread_length"),
            "turns": self.output("turns"),
            "threads": float(choice.threads),
            "thread_diameter": choice.diameter,
            "thread_area": choice.thread.area(choice.diameter),
            "bore": named["diameter"] - 2 * named["wall"],
        }

    @property
    def objective(self) -> float:
        """What was minimised, SI."""
        return self.output(OBJECTIVE_OUTPUTS[self.spec.entries.minimise])

    @cached_property
    def bench(self) -> Bench:
        """The chosen muscle, one of those in parallel, as a bench without sensors."""
        p = self.problem
        return build_bench(p.to_coordinates(self.z), p.build, p.ids, p.numbers)

    def force(self, pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
        """Force of all muscles, N, as they lift: (n,) for pressures (n,), Pa, and contractions (n,).

        Not a number where the muscle has no equilibrium.
        """
        return self._evaluate_output("force", pressure, contraction)

    def outer_diameter(self, pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
        """Outer diameter of one muscle, m, alike."""
        return self._evaluate_output("diameter", pressure, contraction)

    def _evaluate_output(self, name: str, pressure, contraction) -> np.ndarray:
        size = self.task.points.contraction.size
        pressure, contraction = np.broadcast_arrays(np.atleast_1d(pressure), np.atleast_1d(contraction))
        values = []
        for start in range(0, pressure.size, size):
            p, c = pressure[start : start + size], contraction[start : start + size]
            padded = [np.concatenate([x, np.full(size - x.size, x[-1])]) for x in (c, p)]
            points = OperatingPoints(padded[0], np.zeros(size), np.zeros(size), padded[1])
            problem = self.problem
            y = evaluate_many(
                problem.to_coordinates(self.z)[None], problem.build, problem.numbers, points, problem.ids
            )[0]
            values.append(y[[locate_output(name, k) for k in range(p.size)]])
        return np.concatenate(values)

    def __str__(self) -> str:
        from pamjax.sizing.report import format_design_note

        return format_design_note(self)
