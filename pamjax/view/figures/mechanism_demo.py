"""One bench trial for every mechanism: the article's muscle, with and without it.

The muscle of Chambers & Wereley (Actuators 2022, 11, 219) with its threads of 80 GPa goes through strokes at
three pressures, and is filled and vented at three lengths. The bench holds every mechanism of the library
and all but one stand at their neutral values, so that every figure shares one compiled program; a textbook
form, which is not in the library, has a small bench of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np

from pamjax.model.balance import Status
from pamjax.model.bench import Bench, record
from pamjax.model.history import History, history
from pamjax.model.mechanism import AbstractMechanism
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.registry import MECHANISMS
from pamjax.parameter import field_meanings, meanings, replace

#: Thread length, m, turns, length at rest, m, and compliance of the threads, 1/N, of the article's muscle.
THREAD, TURNS, REST, COMPLIANCE = 0.251206, 1.09, 0.235744, 1 / (144 * 0.0858e-6 * 80e9)

#: Of the strokes: pressures, Pa, and contraction; of the ramps: contractions, and the highest pressure, Pa.
PRESSURES, STROKE = (150e3, 350e3, 690e3), 0.25
CONTRACTIONS, TOP = (0.0, 0.1, 0.2), 690e3

#: Samples from one turn to the next, their distance, s, and cycles of a run. A stroke goes at 1.2 mm/s.
HALF, STEP, CYCLES = 100, 0.5, 2

#: What is shown of each mechanism, SI: of the size that physics or practice gives a muscle of an inch.
SIZES: dict[str, dict[str, float]] = {
    "braid_elasticity": {"compliance": COMPLIANCE},
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
class Run:
    """One of the runs of the trial, with and without the mechanism.

    Attributes:
        pressure, length: (n,) Pa and m.
        rising: (n,) whether length, or in a ramp pressure, grows.
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


def sizes(kind: type[AbstractMechanism]) -> dict[str, float]:
    """The numbers at which a mechanism is shown: those of `SIZES`, or a twentieth of the limits."""
    if kind.id in SIZES:
        return SIZES[kind.id]
    declared = field_meanings(kind).items()
    return {n: m.neutral + 0.05 * (m.high - m.neutral) for n, m in declared if m.neutral is not None}


def trial(kind: type[AbstractMechanism]) -> tuple[list[Run], list[Run]]:
    """Strokes at each of `PRESSURES`, and ramps at each of `CONTRACTIONS`."""
    pressure, length, _ = _schedule()
    mine = {f"{kind.id}.{name}": value for name, value in sizes(kind).items()}
    stiff = {} if kind is BraidElasticity else {f"{BraidElasticity.id}.compliance": COMPLIANCE}
    (force, diameter), bare = _shown(kind, stiff | mine), _shown(kind, stiff)
    columns = (pressure, length, _rising(), force, diameter, *bare)
    runs = [Run(*parts) for parts in zip(*(np.split(c, _count()) for c in columns), strict=True)]
    return runs[: len(PRESSURES)], runs[len(PRESSURES) :]


def _count() -> int:
    return len(PRESSURES) + len(CONTRACTIONS)


@cache
def _schedule() -> tuple[np.ndarray, np.ndarray, History]:
    there = np.linspace(0, 1, HALF, endpoint=False)
    wave = np.tile(np.r_[there, 1 - there], CYCLES)
    strokes = [(np.full(wave.size, p), REST * (1 - STROKE * wave)) for p in PRESSURES]
    ramps = [(TOP * wave, np.full(wave.size, REST * (1 - c))) for c in CONTRACTIONS]
    pressure, length = (np.concatenate(parts) for parts in zip(*strokes, *ramps, strict=True))
    starts = np.arange(pressure.size) % wave.size == 0
    return pressure, length, history(STEP * np.arange(pressure.size), starts, restart=True)


def _rising() -> np.ndarray:
    out = np.arange(2 * HALF * CYCLES) // HALF % 2 == 0
    return np.concatenate([np.tile(~out, len(PRESSURES)), np.tile(out, len(CONTRACTIONS))])


def _shown(kind: type[AbstractMechanism], numbers: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    pressure, length, past = _schedule()
    bench = _bench(MECHANISMS if kind in MECHANISMS else (BraidElasticity, kind))
    seen = record(replace(bench, _sized(bench) | numbers), jnp.asarray(pressure), jnp.asarray(length), past)
    solved = np.asarray(seen.status) == Status.OK
    force, diameter = (np.where(solved, np.asarray(x), np.nan) for x in (seen.force, seen.diameter))
    return force, diameter


@cache
def _bench(kinds: tuple[Any, ...]) -> Bench:
    return Bench(jnp.asarray(THREAD), jnp.asarray(TURNS), tuple(kind() for kind in kinds))


def _sized(bench: Bench) -> dict[str, float]:
    """Every bladder is as long as the muscle at rest."""
    return {path: REST for path in meanings(bench) if path.endswith(".length")}
