"""Simulated trial of one mechanism: the article's muscle with and without it.

The muscle of Chambers & Wereley (Actuators 2022, 11, 219) has threads of 80 GPa. It makes strokes at three
pressures, and is filled and vented at three lengths. The bench contains every mechanism of the library, all
but one at their neutral values, so that all figures share one compiled program. A textbook form outside the
library has a separate bench.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np

from pamjax.model.balance import Status
from pamjax.model.bench import Bench, record_bench
from pamjax.model.history import History, build_time_history
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.registry import MECHANISMS
from pamjax.parameter import list_field_meanings, list_meanings, replace_values

#: Thread length, m, turns, length at rest, m, and compliance of the threads, 1/N, of the article's muscle.
DEMO_THREAD_LENGTH, DEMO_TURNS, DEMO_REST_LENGTH, _DEMO_COMPLIANCE = (
    0.251206,
    1.09,
    0.235744,
    1 / (144 * 0.0858e-6 * 80e9),
)

#: Strokes: pressures, Pa, and contraction. Ramps: contractions, and highest pressure, Pa.
DEMO_PRESSURES, _DEMO_STROKE = (150e3, 350e3, 690e3), 0.25
DEMO_CONTRACTIONS, _DEMO_MAX_PRESSURE = (0.0, 0.1, 0.2), 690e3

#: Samples of a half-cycle, sampling interval, s, and cycles of a run. The stroke speed is 1.2 mm/s.
HALF_CYCLE_SAMPLES, _DEMO_TIME_STEP, DEMO_CYCLES = 100, 0.5, 2

#: Parameters of each mechanism in its figure, SI: typical values of a muscle of 25 mm.
_DEMO_VALUES: dict[str, dict[str, float]] = {
    "braid_elasticity": {"compliance": _DEMO_COMPLIANCE},
    "thread_crimp": {"crimp": 2e-3, "load": 1000.0},
    "thread_slip": {"bedding": 1e-3, "load": 1500.0},
    "bladder_elasticity": {"modulus": 0.4e6},
    "contact_pressure": {"threshold": 40e3},
    "viscoelastic_creep": {"modulus": 0.08e6},
    "mullins_softening": {"modulus": 0.1e6},
    "diameter_offset": {"offset": 0.6e-3, "compaction": 0.1e-3},
    "end_taper": {"share": 1.0},
    "braid_friction": {"coefficient": 0.2, "presliding": 2e-3, "give": 2e-9},
    "viscous_damping": {"coefficient": 5e3},
    "pressure_drop": {"impedance": 5e8},
    "rig_compliance": {"compliance": 2e-7},
    "force_offset": {"offset": 5.0},
    "force_gain": {"gain": 0.01},
    "force_drift": {"rate": 0.02},
    "pressure_offset": {"offset": 3e3},
    "pressure_gain": {"gain": 0.01},
    "length_offset": {"offset": 0.5e-3},
    "channel_lag": {"lag": 0.5},
    "braid_locking": {"stiffness": 0.2e6},
    "end_cones": {"height": 1.0},
    "contraction_factor": {"excess": 0.1},
}


@dataclass(frozen=True, eq=False)
class DemoRun:
    """One run of the trial, with and without the mechanism.

    Attributes:
        pressure, length: (n,) Pa and m.
        rising: (n,) whether length, or in a ramp pressure, increases.
        force, diameter: (n,) with the mechanism, N and m; NaN where there is no solution.
        bare_force, bare_diameter: (n,) without it.
    """

    pressure: np.ndarray
    length: np.ndarray
    rising: np.ndarray
    force: np.ndarray
    diameter: np.ndarray
    bare_force: np.ndarray
    bare_diameter: np.ndarray


def choose_demo_values(kind: type[AbstractMechanism]) -> dict[str, float]:
    """Return a mechanism's parameters: those of `_DEMO_VALUES`, else 5 % from neutral to the upper limit."""
    if kind.id in _DEMO_VALUES:
        return _DEMO_VALUES[kind.id]
    meanings = list_field_meanings(kind).items()
    return {
        name: meaning.neutral + 0.05 * (meaning.high - meaning.neutral)
        for name, meaning in meanings
        if meaning.neutral is not None
    }


def simulate_demo(kind: type[AbstractMechanism]) -> tuple[list[DemoRun], list[DemoRun]]:
    """Return strokes at each of `DEMO_PRESSURES`, and ramps at each of `DEMO_CONTRACTIONS`."""
    pressure, length, _ = _build_schedule()
    demo_values = {f"{kind.id}.{name}": value for name, value in choose_demo_values(kind).items()}
    thread_values = {} if kind is BraidElasticity else {f"{BraidElasticity.id}.compliance": _DEMO_COMPLIANCE}
    (force, diameter), without_mechanism = (
        _simulate_bench(kind, thread_values | demo_values),
        _simulate_bench(kind, thread_values),
    )
    columns = (pressure, length, _find_rising(), force, diameter, *without_mechanism)
    runs = [
        DemoRun(*parts)
        for parts in zip(*(np.split(column, _count_runs()) for column in columns), strict=True)
    ]
    return runs[: len(DEMO_PRESSURES)], runs[len(DEMO_PRESSURES) :]


def _count_runs() -> int:
    return len(DEMO_PRESSURES) + len(DEMO_CONTRACTIONS)


@cache
def _build_schedule() -> tuple[np.ndarray, np.ndarray, History]:
    ramp = np.linspace(0, 1, HALF_CYCLE_SAMPLES, endpoint=False)
    wave = np.tile(np.r_[ramp, 1 - ramp], DEMO_CYCLES)
    strokes = [(np.full(wave.size, p), DEMO_REST_LENGTH * (1 - _DEMO_STROKE * wave)) for p in DEMO_PRESSURES]
    ramps = [
        (_DEMO_MAX_PRESSURE * wave, np.full(wave.size, DEMO_REST_LENGTH * (1 - c))) for c in DEMO_CONTRACTIONS
    ]
    pressure, length = (np.concatenate(parts) for parts in zip(*strokes, *ramps, strict=True))
    starts = np.arange(pressure.size) % wave.size == 0
    return (
        pressure,
        length,
        build_time_history(_DEMO_TIME_STEP * np.arange(pressure.size), starts, restart=True),
    )


def _find_rising() -> np.ndarray:
    stroke = np.arange(2 * HALF_CYCLE_SAMPLES * DEMO_CYCLES) // HALF_CYCLE_SAMPLES % 2 == 0
    return np.concatenate([np.tile(~stroke, len(DEMO_PRESSURES)), np.tile(stroke, len(DEMO_CONTRACTIONS))])


def _simulate_bench(
    kind: type[AbstractMechanism], numbers: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    pressure, length, time_history = _build_schedule()
    bench = _build_bench(MECHANISMS if kind in MECHANISMS else (BraidElasticity, kind))
    reading = record_bench(
        replace_values(bench, _set_bladder_lengths(bench) | numbers),
        jnp.asarray(pressure),
        jnp.asarray(length),
        time_history,
    )
    is_solved = np.asarray(reading.status) == Status.OK
    force, diameter = (np.where(is_solved, np.asarray(x), np.nan) for x in (reading.force, reading.diameter))
    return force, diameter


@cache
def _build_bench(kinds: tuple[Any, ...]) -> Bench:
    return Bench(jnp.asarray(DEMO_THREAD_LENGTH), jnp.asarray(DEMO_TURNS), tuple(kind() for kind in kinds))


def _set_bladder_lengths(bench: Bench) -> dict[str, float]:
    """Return the lengths of all bladders, equal to the rest length."""
    return {path: DEMO_REST_LENGTH for path in list_meanings(bench) if path.endswith(".length")}
