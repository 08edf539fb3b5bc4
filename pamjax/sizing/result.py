"""A sized muscle: what was chosen, what it will do, what it costs, and what would have to give."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pamjax.model.bench import Bench
from pamjax.sizing.calibration import Handed
from pamjax.sizing.candidate import Places, bench, index, many
from pamjax.sizing.enumerate import Tried
from pamjax.sizing.inelastic import Cost
from pamjax.sizing.infeasible import Gives
from pamjax.sizing.pareto import Front
from pamjax.sizing.problem import OUTPUT, Choice, Problem
from pamjax.sizing.requirements import Asked
from pamjax.sizing.sensitivity import Price
from pamjax.sizing.spec import Spec


@dataclass(frozen=True, eq=False)
class Design:
    """The answer to a spec; prints as a lab note.

    Attributes:
        spec, asked, handed: what was wanted, and what a calibration handed on.
        tried: every choice that was searched, the best first.
        chosen: the answer; where the spec cannot be met, the candidate that comes nearest.
        probability: that everything holds, over the draws; NaN where the spec cannot be met.
        held: the same of each requirement, by key.
        prices: requirements that cost something, the dearest first.
        properties: per cent of the objective for a per cent of a property, by its words.
        limits: coordinates at an end of their range.
        gives: what would have to give; empty where the spec is met.
        costs: of the inelastic assumption.
        front: between two objectives, None where the spec cannot be met.
        left_out: choices that were looked at but not searched.
        seed, method: of the search.
        unsure: whether a probability was wanted that no choice holds.
    """

    spec: Spec
    asked: Asked
    handed: Handed
    tried: tuple[Tried, ...]
    chosen: Tried
    probability: float = math.nan
    held: dict[str, float] = field(default_factory=dict)
    prices: tuple[Price, ...] = ()
    properties: dict[str, float] = field(default_factory=dict)
    limits: tuple[str, ...] = ()
    gives: tuple[Gives, ...] = ()
    costs: tuple[Cost, ...] = ()
    front: Front | None = None
    left_out: int = 0
    seed: int = 0
    method: str = "slsqp"
    unsure: bool = False

    @property
    def feasible(self) -> bool:
        """Whether the spec can be met."""
        return self.chosen.answer is not None

    @property
    def problem(self) -> Problem:
        return self.chosen.problem

    @property
    def choice(self) -> Choice:
        """Thread, count, bladder and number of muscles."""
        return self.chosen.problem.choice

    @cached_property
    def z(self) -> np.ndarray:
        """(free,) scaled coordinates of the chosen muscle."""
        return self.chosen.answer.z if self.chosen.answer is not None else self.chosen.start

    @cached_property
    def outputs(self) -> np.ndarray:
        """Everything that the chosen muscle shows, in the order of `candidate.outputs`."""
        return self.problem.outputs(self.z)

    def output(self, name: str, place: int | None = None) -> float:
        """One of them, SI."""
        return float(self.outputs[index(name, place)])

    @cached_property
    def numbers(self) -> dict[str, float]:
        """The chosen muscle's own numbers, SI."""
        choice = self.choice
        named = self.problem.named(self.z)
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
        return self.output(OUTPUT[self.spec.words.minimise])

    @cached_property
    def bench(self) -> Bench:
        """The chosen muscle, one of those in parallel, as a bench without sensors."""
        p = self.problem
        return bench(p.coordinates(self.z), p.made, p.ids, p.numbers)

    def force(self, pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
        """Force of all muscles, N, as they lift: (n,) for pressures (n,), Pa, and contractions (n,).

        Not a number where the muscle has no equilibrium.
        """
        return self._asked("force", pressure, contraction)

    def outside(self, pressure: np.ndarray, contraction: np.ndarray) -> np.ndarray:
        """Outer diameter of one muscle, m, alike."""
        return self._asked("diameter", pressure, contraction)

    def _asked(self, name: str, pressure, contraction) -> np.ndarray:
        size = self.asked.places.contraction.size
        pressure, contraction = np.broadcast_arrays(np.atleast_1d(pressure), np.atleast_1d(contraction))
        found = []
        for at in range(0, pressure.size, size):
            p, c = pressure[at : at + size], contraction[at : at + size]
            filled = [np.concatenate([x, np.full(size - x.size, x[-1])]) for x in (c, p)]
            places = Places(filled[0], np.zeros(size), np.zeros(size), filled[1])
            one = self.problem
            y = many(one.coordinates(self.z)[None], one.made, one.numbers, places, one.ids)[0]
            found.append(y[[index(name, k) for k in range(p.size)]])
        return np.concatenate(found)

    def __str__(self) -> str:
        from pamjax.sizing.report import note

        return note(self)
