"""Random muscles, benches and sensors of the simulation study.

| drawn                        | from                                                                   |
|------------------------------|------------------------------------------------------------------------|
| braid                        | 62 to 74 degrees at rest, 9 to 28 mm wide, 8 to 16 diameters long       |
| stretch of its threads       | 0.3 to 3 % at the highest pressure, 300 to 700 kPa; none if inelastic   |
| bench                        | strokes at five pressures, or ramps of pressure at five lengths         |
| noise of a sample, 1 sd      | force 0.03 to 0.2 % of full scale, diameter 0.1 to 0.4 %,               |
|                              | pressure 0.03 to 0.15 %, length 0.003 to 0.015 %                        |
| sd of stated values          | thread length to 0.15 %, turns to 0.4 %, stiffness to 20 %              |

Neglects: lengths read once for each level, static tables, several muscles in one fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import MuscleToml, Sensors
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.recording import Recording

#: Approximate number of rows of a drawn recording.
_DRAWN_RECORDING_ROWS = 850

#: Shares of setups with pressure ramps, and of setups with an inelastic baseline.
_RAMP_BENCH_SHARE, _INELASTIC_SHARE = 0.2, 0.25

#: Prior standard deviations: thread length and stiffness as shares of the value, turns absolute.
_THREAD_LENGTH_SD_SHARE, _STIFFNESS_SD_SHARE, _TURNS_SD = 1.5e-3, 0.2, 4e-3


@dataclass(frozen=True, eq=False)
class Setup:
    """A muscle on a bench, before anything is measured.

    Attributes:
        muscle_toml: stated values, as in muscle.toml.
        plan: set pressure and length; finite force and diameter mark measured samples.
    """

    muscle_toml: MuscleToml
    plan: Recording


def build_reference_setup() -> Setup:
    """Return the fixed reference setup: the muscle of the paper with softer threads, at five isobars."""
    muscle_toml = MuscleToml(
        name="reference muscle",
        rest_length=MeasuredValue(0.2357),
        thread_length=MeasuredValue(0.2512, 0.4e-3),
        turns=MeasuredValue(1.09, 0.004),
        threads=144,
        thread_area=MeasuredValue(0.0858e-6),
        modulus=MeasuredValue(40e9, 8e9),
        sensors=Sensors(force=3.0, diameter=0.05e-3, pressure=500.0, length=0.02e-3),
        baseline="elastic",
    )
    protocol = Protocol(
        kind="strokes",
        pressures=["100 kPa", "200 kPa", "350 kPa", "500 kPa", "650 kPa"],
        contractions=[0.1, 0.17, 0.24, 0.27, 0.29],
        cycles=2,
        speed="1.2 mm/s",
        rate="0.5 Hz",
        diameter_every=1,
    )
    return Setup(muscle_toml, _build_plan(protocol, muscle_toml.rest_length.value))


def draw_setup(rng: np.random.Generator, rows: int = _DRAWN_RECORDING_ROWS, law: str | None = None) -> Setup:
    """Draw a random muscle and bench.

    Args:
        rng: random generator.
        rows: approximate number of rows of the recording.
        law: "elastic" or "inelastic"; None draws it.
    """
    angle = math.radians(rng.uniform(62.0, 74.0))
    diameter = _draw_log_uniform(rng, 9e-3, 28e-3)
    rest_length = diameter * rng.uniform(8.0, 16.0)
    thread = rest_length / math.sin(angle)
    turns = thread * math.cos(angle) / (math.pi * diameter)
    highest_pressure = rng.uniform(300e3, 700e3)
    thread_load = highest_pressure * rest_length * thread / (2 * math.pi * turns**2)
    stiffness = float(np.clip(thread_load / _draw_log_uniform(rng, 0.003, 0.03), 2e3, 5e6))
    full_scale_force = highest_pressure * (3 * rest_length**2 - thread**2) / (4 * math.pi * turns**2)
    law = law or ("inelastic" if rng.random() < _INELASTIC_SHARE else "elastic")
    muscle_toml = MuscleToml(
        name="random muscle",
        rest_length=MeasuredValue(rest_length),
        thread_length=MeasuredValue(thread, _THREAD_LENGTH_SD_SHARE * thread),
        turns=MeasuredValue(turns, _TURNS_SD),
        stiffness=MeasuredValue(stiffness, _STIFFNESS_SD_SHARE * stiffness),
        sensors=Sensors(
            force=full_scale_force * _draw_log_uniform(rng, 3e-4, 2e-3),
            diameter=diameter * _draw_log_uniform(rng, 1e-3, 4e-3),
            pressure=highest_pressure * _draw_log_uniform(rng, 3e-4, 1.5e-3),
            length=rest_length * _draw_log_uniform(rng, 3e-5, 1.5e-4),
        ),
        baseline=law,
    )
    # Free contraction of inextensible threads of this angle: 3 L² = B².
    free_contraction = 1 - 1 / (math.sqrt(3) * math.sin(angle))
    draw_protocol = _draw_ramps if rng.random() < _RAMP_BENCH_SHARE else _draw_strokes
    return Setup(
        muscle_toml,
        _build_plan(draw_protocol(rng, highest_pressure, free_contraction, rest_length, rows), rest_length),
    )


def _draw_strokes(
    rng: np.random.Generator, highest_pressure: float, free_contraction: float, rest_length: float, rows: int
) -> Protocol:
    """Draw two strokes at each of five pressures, longer at higher pressures."""
    shares = np.linspace(0.16, 1.0, 5) * rng.uniform([0.9] * 5, [1.0] * 5)
    reach = free_contraction * np.linspace(rng.uniform(0.3, 0.5), rng.uniform(0.65, 0.78), 5)
    speed = _draw_log_uniform(rng, 0.004, 0.012) * rest_length
    seconds = 4 * float(reach.sum()) * rest_length / speed
    return Protocol(
        kind="strokes",
        pressures=[f"{share * highest_pressure:.0f} Pa" for share in shares],
        contractions=[float(k) for k in reach.round(3)],
        cycles=2,
        speed=f"{speed * 1e3:.6f} mm/s",
        rate=f"{rows / seconds:.6f} Hz",
        diameter_every=int(rng.choice([2, 4])),
    )


def _draw_ramps(
    rng: np.random.Generator, highest_pressure: float, free_contraction: float, rest_length: float, rows: int
) -> Protocol:
    """Draw two pressure ramps at each of five lengths."""
    duration = rng.uniform(15.0, 60.0)
    reach = free_contraction * np.linspace(0.0, rng.uniform(0.6, 0.75), 5)
    return Protocol(
        kind="ramps",
        pressures=[f"{highest_pressure:.0f} Pa"],
        contractions=[float(k) for k in reach.round(3)],
        cycles=2,
        duration=f"{duration:.3f} s",
        rate=f"{rows / (20 * duration):.6f} Hz",
        diameter_every=int(rng.choice([2, 4])),
    )


def _build_plan(protocol: Protocol, rest_length: float) -> Recording:
    """Return the schedule as a recording with placeholder values of force and diameter."""
    plan = protocol.build_schedule(rest_length)
    return Recording.from_arrays(
        time=plan.time, pressure=plan.pressure, length=plan.length, cycle=plan.cycle,
        force=np.full(plan.time.size, 1e3), diameter=np.where(plan.diameter_measured, 1.0, np.nan),
    )  # fmt: skip


def _draw_log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))
