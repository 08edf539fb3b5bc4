"""The result of a sizing: the chosen muscle, its outputs, sensitivities, and relaxations if infeasible."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pamjax.drawing import DrawableResult
from pamjax.model.bench import Bench
from pamjax.notebook import NotebookText
from pamjax.sizing.assure import Finalist
from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.candidate import OperatingPoints, build_bench, evaluate_many, locate_output
from pamjax.sizing.enumerate import ChoiceResult
from pamjax.sizing.inelastic import InelasticError
from pamjax.sizing.infeasible import Relaxation
from pamjax.sizing.pareto import ParetoFront
from pamjax.sizing.problem import MAX_SIZING_CONTRACTION, OBJECTIVE_OUTPUTS, Choice, SizingProblem
from pamjax.sizing.requirements import SizingTask
from pamjax.sizing.sensitivity import RequirementSensitivity
from pamjax.sizing.specification.spec import Spec
from pamjax.sizing.tolerances import BuildErrors

#: Number of contractions between which the free contraction is interpolated.
_FREE_CONTRACTION_STEPS = 101


@dataclass(frozen=True, eq=False, repr=False)
class Design(DrawableResult, NotebookText):
    """The design for a spec; its text is a report.

    Attributes:
        spec, task, transfer: spec, its requirements, and the transferred properties of a calibration.
        results: all optimised choices, the best first.
        chosen_result: the best choice; for an infeasible spec, the nearest candidate.
        probability: probability that all requirements hold; NaN if infeasible.
        requirement_probabilities: probability of each requirement, by key.
        requirement_sensitivities: sensitivity to each active requirement, the largest first.
        property_sensitivities: change of the objective, %, for a 1 % increase of a property, by label.
        active_limits: coordinates at a bound, as text.
        relaxations: relaxations of the conflicting requirements; empty if feasible.
        inelastic_errors: errors of the inelastic assumption.
        front: Pareto front of two objectives, None if infeasible.
        unsearched_count: number of choices that were screened but not optimised.
        seed, method: of the search.
        misses_probability: whether no choice reaches the required probability.
        misses_stock: whether no tube that is sold fits, so that the bladder has any diameter and wall.
        errors: standard deviations of the errors of manufacture, length and pressure.
        nominal: best choice of any size at typical properties; None if infeasible.
        nominal_stock: best choice of the parts that are sold, at typical properties; None if infeasible, if
            no tube fits, or if any size is allowed.
        finalists: choices that were optimised for the probability, the chosen one first.
        choice_count: number of optimised choices, with sold parts if these are used.
        force_sds: (points,) standard deviation of the force over the draws, N.
    """

    spec: Spec
    task: SizingTask
    transfer: CalibrationTransfer
    results: tuple[ChoiceResult, ...]
    chosen_result: ChoiceResult
    probability: float = math.nan
    requirement_probabilities: dict[str, float] = field(default_factory=dict)
    requirement_sensitivities: tuple[RequirementSensitivity, ...] = ()
    property_sensitivities: dict[str, float] = field(default_factory=dict)
    active_limits: tuple[str, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    inelastic_errors: tuple[InelasticError, ...] = ()
    front: ParetoFront | None = None
    unsearched_count: int = 0
    seed: int = 0
    method: str = "slsqp"
    misses_probability: bool = False
    misses_stock: bool = False
    errors: BuildErrors = field(default_factory=BuildErrors)
    nominal: ChoiceResult | None = None
    nominal_stock: ChoiceResult | None = None
    finalists: tuple[Finalist, ...] = ()
    choice_count: int = 0
    force_sds: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def feasible(self) -> bool:
        """Return whether a muscle that meets the spec was found."""
        return self.chosen_result.optimum is not None

    @property
    def problem(self) -> SizingProblem:
        return self.chosen_result.problem

    @property
    def choice(self) -> Choice:
        """Return the chosen thread, count, bladder and number of muscles."""
        return self.chosen_result.problem.choice

    @cached_property
    def z(self) -> np.ndarray:
        """Return the scaled coordinates of the chosen muscle, (free,)."""
        return (
            self.chosen_result.optimum.z
            if self.chosen_result.optimum is not None
            else self.chosen_result.start
        )

    @cached_property
    def outputs(self) -> np.ndarray:
        """Return the outputs of the chosen muscle, in the order of `candidate.compute_outputs`."""
        return self.problem.compute_outputs(self.z)

    def output(self, name: str, point: int | None = None) -> float:
        """Return one output, SI."""
        return float(self.outputs[locate_output(name, point)])

    @cached_property
    def numbers(self) -> dict[str, float]:
        """Return the dimensions of the chosen muscle, SI."""
        choice = self.choice
        coordinates = self.problem.name_coordinates(self.z)
        return coordinates | {
            "thread_length": self.output("thread_length"),
            "turns": self.output("turns"),
            "threads": float(choice.threads),
            "thread_diameter": choice.diameter,
            "thread_area": choice.thread.area(choice.diameter),
            "bore": coordinates["diameter"] - 2 * coordinates["wall"],
        }

    @property
    def objective(self) -> float:
        """Return the value of the minimised objective, SI."""
        return self.output(OBJECTIVE_OUTPUTS[self.spec.entries.minimise])

    @cached_property
    def bench(self) -> Bench:
        """Return the chosen muscle (one of those in parallel) as a bench without sensors."""
        p = self.problem
        return build_bench(p.to_coordinates(self.z), p.build, p.ids, p.numbers)

    def force(self, pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
        """Return the force of all muscles during contraction, N, (n,).

        Args:
            pressure: (n,), Pa.
            contraction: (n,).

        The force is NaN at points without equilibrium.
        """
        return self._evaluate_output("force", pressure, contraction)

    @cached_property
    def free_contraction(self) -> float:
        """Return the contraction at which the force at working pressure is zero."""
        contraction = np.linspace(0.0, MAX_SIZING_CONTRACTION, _FREE_CONTRACTION_STEPS)
        force = self.force(np.full(contraction.size, self.numbers["pressure"]), contraction)
        pulls = np.flatnonzero(force > 0)
        if not pulls.size or pulls[-1] + 1 == contraction.size:
            return float(contraction[pulls[-1]]) if pulls.size else 0.0
        k = int(pulls[-1])
        # A blank after the last pull is a muscle without equilibrium: its contraction ends there.
        if not np.isfinite(force[k + 1]):
            return float(contraction[k])
        return float(np.interp(0.0, [force[k + 1], force[k]], [contraction[k + 1], contraction[k]]))

    def outer_diameter(self, pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
        """Return the outer diameter of one muscle, m, for the same arguments as `force`."""
        return self._evaluate_output("diameter", pressure, contraction)

    def _evaluate_output(self, name: str, pressure, contraction) -> np.ndarray:
        batch_size = self.task.points.contraction.size
        pressure, contraction = np.broadcast_arrays(np.atleast_1d(pressure), np.atleast_1d(contraction))
        values = []
        for start in range(0, pressure.size, batch_size):
            stop = start + batch_size
            p, c = pressure[start:stop], contraction[start:stop]
            batch = [np.concatenate([x, np.full(batch_size - x.size, x[-1])]) for x in (c, p)]
            points = OperatingPoints(batch[0], np.zeros(batch_size), np.zeros(batch_size), batch[1])
            problem = self.problem
            y = evaluate_many(
                problem.to_coordinates(self.z)[None], problem.build, problem.numbers, points, problem.ids
            )[0]
            values.append(y[[locate_output(name, k) for k in range(p.size)]])
        return np.concatenate(values)

    def __str__(self) -> str:
        from pamjax.sizing.report import format_design_summary

        return format_design_summary(self)
