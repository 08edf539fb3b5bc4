"""Scales of a muscle on its bench, from which shapes of effects are drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pamjax.benchmark.other_forms.muscle import BenchPlan, TrueBraid, compute_rate, simulate_effects
from pamjax.benchmark.other_forms.rubber_forms import RubberWall


@dataclass(frozen=True, eq=False)
class BenchScales:
    """A true muscle on its bench, and the ranges of its recording, SI.

    Attributes:
        braid: the true braid.
        plan: pressure and length that the bench sets.
        wall: the true bladder.
        fitting_radius: radius at the ends.
        duration, step: duration and median time step.
        stroke, max_contraction, max_pressure, max_force, max_load: ranges of the muscle without effects.
        speed: 90 % quantile of the speed; 0 at fixed lengths.
        flow: 90 % quantile of the flow into the muscle, m³/s.
        block: index of the isobar or length of each row, (n,).
    """

    braid: TrueBraid
    plan: BenchPlan
    wall: RubberWall
    fitting_radius: float
    duration: float
    step: float
    stroke: float
    max_contraction: float
    max_pressure: float
    max_force: float
    max_load: float
    speed: float
    flow: float
    block: np.ndarray

    @property
    def is_isometric(self) -> bool:
        """Return whether the bench changes the pressure at fixed lengths."""
        return self.speed == 0.0

    def draw_moment(self, rng: np.random.Generator) -> float:
        """Draw a time between 10 and 90 % of the recording, s."""
        return float(self.plan.time[0] + self.duration * rng.uniform(0.1, 0.9))


def compute_volume(braid: TrueBraid, length: np.ndarray, thread: np.ndarray) -> np.ndarray:
    """Return the volume of a cylinder, V = L (B² − L²)/(4πN²), m³."""
    return length * (thread**2 - length**2) / (4 * np.pi * braid.turns**2)


def build_scales(
    braid: TrueBraid, plan: BenchPlan, block: np.ndarray, rng: np.random.Generator
) -> BenchScales:
    """Return the scales of a muscle; its bladder and fittings are drawn.

    Bore 0.65 to 0.85 and wall 0.06 to 0.1 of the diameter at rest, fittings 0.9 to 1.0 of its radius.
    """
    outer = 2 * float(braid.compute_radius(np.array(braid.rest_length), np.array(braid.thread)))
    wall = RubberWall(
        braid, outer * rng.uniform(0.65, 0.85), outer * rng.uniform(0.06, 0.1), braid.rest_length
    )
    readings = simulate_effects(braid, plan, [])
    thread = np.hypot(plan.length, np.pi * braid.turns * readings.diameter)
    load = plan.pressure * plan.length * thread / (2 * np.pi * braid.turns**2)
    speeds = np.abs(compute_rate(plan.time, plan.starts, plan.length))
    flows = np.abs(compute_rate(plan.time, plan.starts, compute_volume(braid, plan.length, thread)))
    is_isometric = np.mean(speeds > 1e-9) < 0.2
    return BenchScales(
        braid=braid,
        plan=plan,
        wall=wall,
        fitting_radius=outer / 2 * rng.uniform(0.9, 1.0),
        duration=float(np.ptp(plan.time)),
        step=float(np.median(np.diff(plan.time))),
        stroke=float(np.ptp(plan.length)),
        max_contraction=float(1 - plan.length.min() / braid.rest_length),
        max_pressure=float(plan.pressure.max()),
        max_force=float(readings.force.max()),
        max_load=float(load.max()),
        speed=0.0 if is_isometric else float(np.quantile(speeds, 0.9)),
        flow=float(np.quantile(flows, 0.9)),
        block=block,
    )


def draw_log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))
