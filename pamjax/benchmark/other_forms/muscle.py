"""Force and diameter of a muscle with effects of any form, in numpy and without the equations of the fit.

With the potential U(L, B) = W(L, B) − P ΔV(L, B) of all effects that store energy or change the volume:

    load   T = P L B / (2πN²) − ∂U/∂B,                     B = B0 (1 + e) (1 + C T + Σ ε(T))
    force  F = P (3L² − B²) / (4πN²) + ∂U/∂L

    P  pressure inside, Pa       L  length, m                   N  turns
    B  thread length, m          B0 thread length unloaded, m   e  permanent extension
    C  thread compliance, 1/N    ε  strain of other laws

Derivatives of U are central differences. A bladder that does not touch the braid has T = 0, and B is that
of a braid of its radius. The muscle never pushes. Effects with memory see the states without memory.

Source: physics of the braid after Chambers & Wereley, Actuators 2022, 11, 219, Eqs. 1-12.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

#: Step of a central difference over the rest length.
_DIFFERENCE_STEP = 1e-6

#: Largest number of iterations of thread length, slack radius and rig, and relative tolerance.
_MAX_ITERATIONS, _ITERATION_TOLERANCE = 60, 1e-12

Energy = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class TrueBraid:
    """The true braid: rest length (m), unloaded thread length (m), turns, compliance of all threads (1/N)."""

    rest_length: float
    thread: float
    turns: float
    compliance: float = 0.0

    def compute_radius(self, length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        """Return the radius of a cylinder, R = sqrt(B² − L²) / (2πN), m."""
        return np.sqrt(np.maximum(thread**2 - length**2, 0.0)) / (2 * np.pi * self.turns)


@dataclass(frozen=True, eq=False)
class MusclePath:
    """The states of a muscle at every sample, (n,) each, SI.

    Attributes:
        time: time.
        starts: whether a sample is the first of a continuous part.
        pressure: inside.
        length, thread, radius: true length, thread length, mid-thread radius.
        load: pull of all threads together.
        force: tension.
    """

    time: np.ndarray
    starts: np.ndarray
    pressure: np.ndarray
    length: np.ndarray
    thread: np.ndarray
    radius: np.ndarray
    load: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class BenchPlan:
    """Pressure (Pa) and length (m) that the bench sets at every sample, (n,), with time and starts."""

    time: np.ndarray
    starts: np.ndarray
    pressure: np.ndarray
    length: np.ndarray


@dataclass(frozen=True, eq=False)
class Readings:
    """Recorded pressure (Pa), length (m), force (N) and diameter (m), (n,) each."""

    pressure: np.ndarray
    length: np.ndarray
    force: np.ndarray
    diameter: np.ndarray


@dataclass(frozen=True, eq=False)
class Effect:
    """What an effect changes; None changes nothing.

    Attributes:
        inputs: recorded pressure and length from the true ones, of a plan.
        pressure_loss: pressure that does not act on the braid, Pa.
        energy: stored energy at a length and thread length, J.
        memory: stored energy with constants that depend on the path.
        volume: change of the volume at a length and radius, m³.
        mean_radius: change of the mean radius at a length and radius, m.
        strain: strain of the threads at a load, N.
        extension: permanent extension of the threads.
        force: additional force, N.
        deflection: shortening of the muscle by the rig at a force, N, in m.
        outputs: recorded force and diameter from the true ones.
        readings: recorded channels after noise.
    """

    inputs: Callable[[BenchPlan], tuple[np.ndarray, np.ndarray]] | None = None
    pressure_loss: Callable[[MusclePath], np.ndarray] | None = None
    energy: Energy | None = None
    memory: Callable[[MusclePath], Energy] | None = None
    volume: Energy | None = None
    mean_radius: Energy | None = None
    strain: Callable[[np.ndarray], np.ndarray] | None = None
    extension: Callable[[MusclePath], np.ndarray] | None = None
    force: Callable[[MusclePath], np.ndarray] | None = None
    deflection: Callable[[np.ndarray], np.ndarray] | None = None
    outputs: Callable[[MusclePath, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    readings: Callable[[Readings], Readings] | None = None


@dataclass(frozen=True, eq=False)
class _Balance:
    """A muscle at given pressures: `energies` and `volumes` are functions of length and thread length."""

    braid: TrueBraid
    pressure: np.ndarray
    effects: Sequence[Effect]
    energies: Sequence[Energy] = ()
    extension: np.ndarray | float = 0.0

    def compute_potential(self, length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        """Return U = W − P ΔV, J."""
        radius = self.braid.compute_radius(length, thread)
        out = np.zeros_like(length)
        for energy in self.energies:
            out = out + energy(length, thread)
        for effect in self.effects:
            if effect.volume is not None:
                out = out - self.pressure * effect.volume(length, radius)
        return out

    @property
    def has_potential(self) -> bool:
        """Return whether any effect stores energy or changes the volume."""
        return bool(self.energies) or any(effect.volume is not None for effect in self.effects)

    def compute_load(self, length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        """Return the pull of all threads together, N."""
        out = self.pressure * length * thread / (2 * np.pi * self.braid.turns**2)
        if not self.has_potential:
            return out
        h = _DIFFERENCE_STEP * self.braid.rest_length
        upper, lower = (self.compute_potential(length, thread + step) for step in (h, -h))
        return out - (upper - lower) / (2 * h)

    def compute_force(self, length: np.ndarray, thread: np.ndarray) -> np.ndarray:
        """Return the tension, N."""
        out = self.pressure * (3 * length**2 - thread**2) / (4 * np.pi * self.braid.turns**2)
        if not self.has_potential:
            return out
        h = _DIFFERENCE_STEP * self.braid.rest_length
        upper, lower = (self.compute_potential(length + step, thread) for step in (h, -h))
        return out + (upper - lower) / (2 * h)

    def stretch_threads(self, load: np.ndarray) -> np.ndarray:
        """Return the length of the threads at a load, m."""
        load = np.maximum(load, 0.0)
        strain = self.braid.compliance * load
        for effect in self.effects:
            if effect.strain is not None:
                strain = strain + effect.strain(load)
        return self.braid.thread * (1 + self.extension) * (1 + strain)

    def solve_thread(self, length: np.ndarray) -> np.ndarray:
        """Return the thread length in equilibrium at a length, m."""
        unloaded_thread = self.stretch_threads(np.zeros_like(length))
        thread = unloaded_thread
        for _ in range(_MAX_ITERATIONS):
            longer = self.stretch_threads(self.compute_load(length, thread))
            change, thread = np.max(np.abs(longer - thread)), longer
            if change < _ITERATION_TOLERANCE * self.braid.thread:
                break
        if not self.has_potential:
            return thread
        slack = self.compute_load(length, unloaded_thread) < 0
        return np.where(slack, self._solve_slack(length, unloaded_thread), thread) if slack.any() else thread

    def _solve_slack(self, length: np.ndarray, unloaded_thread: np.ndarray) -> np.ndarray:
        """Return the thread length at which the load is zero, below the unloaded length, m."""
        low, high = length + 0.01 * (unloaded_thread - length), unloaded_thread
        for _ in range(_MAX_ITERATIONS):
            middle = 0.5 * (low + high)
            is_loaded = self.compute_load(length, middle) > 0
            low, high = np.where(is_loaded, middle, low), np.where(is_loaded, high, middle)
        return 0.5 * (low + high)

    def solve(self, plan: BenchPlan) -> MusclePath:
        """Return the states at the lengths of a plan, shortened by the deflection of the rig."""
        length, deflections = plan.length, [e.deflection for e in self.effects if e.deflection is not None]
        thread = self.solve_thread(length)
        for _ in range(_MAX_ITERATIONS if deflections else 0):
            force = np.maximum(self.compute_force(length, thread), 0.0)
            shorter = plan.length - sum(deflection(force) for deflection in deflections)
            change, length = np.max(np.abs(shorter - length)), shorter
            thread = self.solve_thread(length)
            if change < _ITERATION_TOLERANCE * self.braid.rest_length:
                break
        return MusclePath(
            plan.time, plan.starts, self.pressure, length, thread, self.braid.compute_radius(length, thread),
            np.maximum(self.compute_load(length, thread), 0.0), self.compute_force(length, thread),
        )  # fmt: skip


def simulate_effects(braid: TrueBraid, plan: BenchPlan, effects: Sequence[Effect]) -> Readings:
    """Return the recorded channels of a plan without noise."""
    energies = [effect.energy for effect in effects if effect.energy is not None]
    path = _Balance(braid, plan.pressure, effects, energies).solve(plan)
    losses = [effect.pressure_loss(path) for effect in effects if effect.pressure_loss is not None]
    inside = np.maximum(plan.pressure - sum(losses), 0.0) if losses else plan.pressure
    extension = sum(effect.extension(path) for effect in effects if effect.extension is not None)
    energies += [effect.memory(path) for effect in effects if effect.memory is not None]
    path = _Balance(braid, inside, effects, energies, extension).solve(plan)
    force = path.force
    for effect in effects:
        if effect.force is not None:
            force = force + effect.force(path)
    force, mean_radius = np.maximum(force, 0.0), path.radius
    for effect in effects:
        if effect.mean_radius is not None:
            mean_radius = mean_radius + effect.mean_radius(path.length, path.radius)
    diameter = 2 * mean_radius
    pressure, length = plan.pressure, plan.length
    for effect in effects:
        if effect.outputs is not None:
            force, diameter = effect.outputs(path, force, diameter)
        if effect.inputs is not None:
            pressure, length = effect.inputs(BenchPlan(plan.time, plan.starts, pressure, length))
    return Readings(pressure, length, force, diameter)


def apply_to_readings(readings: Readings, effects: Sequence[Effect]) -> Readings:
    """Return the channels as a logger keeps them: clipped or stuck."""
    for effect in effects:
        if effect.readings is not None:
            readings = effect.readings(readings)
    return readings


def split_runs(starts: np.ndarray) -> list[slice]:
    """Return the continuous parts of a recording as slices."""
    edges = [*np.flatnonzero(starts).tolist(), starts.size]
    edges[0] = 0
    return [slice(first, last) for first, last in pairwise(edges)]


def compute_rate(time: np.ndarray, starts: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the rate of change inside each continuous part, 1/s."""
    out = np.zeros_like(values, dtype=float)
    for run in split_runs(starts):
        if run.stop - run.start > 1:
            out[run] = np.gradient(values[run], time[run])
    return out
