"""Simulated cases of a known muscle, with the priors of a lab."""

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pamjax.model.assembly import assemble
from pamjax.records.case import Case
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import MuscleToml, Sensors
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.simulate import simulate

#: The muscle of the paper with softer threads and, for laws with a toe, its parameters.
TRUE = {
    "muscle.rest_length": 0.2357,
    "muscle.thread_length": 0.2512,
    "muscle.turns": 1.09,
    "thread.modulus": 40e9,
    "muscle.threads": 144.0,
    "muscle.thread_area": 0.0858e-6,
    "thread.toe_ratio": 0.3,
    "thread.crimp": 0.006,
    "thread.width": 1e-3,
    "thread.curvature": 300.0,
    "thread.spread": 2e-3,
}
#: Standard deviations of a ruler and of a data sheet.
SD = {"muscle.thread_length": 0.8e-3, "muscle.turns": 0.005, "thread.modulus": 8e9}
SENSORS = Sensors(force=2.0, diameter=0.05e-3, pressure=700.0, length=0.02e-3)

#: Four isobars of 61 rows: with every case of one shape, few programs are compiled.
STROKES = Protocol(
    kind="strokes",
    pressures=["100 kPa", "250 kPa", "450 kPa", "690 kPa"],
    contractions=[0.2],
    speed="1.57 mm/s",
    cycles=1,
)
#: Five lengths set by ruler, one ramp of 51 rows at each.
RAMPS = Protocol(
    kind="ramps", pressures=["600 kPa"], contractions=[0.0, 0.05, 0.1, 0.15, 0.2], duration="25 s", cycles=1
)


def build_muscle_toml(off=(0.0, 0.0, 0.0), sensors=SENSORS, baseline="elastic", **more):
    """Return a muscle.toml whose values differ from the truth by multiples of their sd."""
    length, turns, modulus = (
        MeasuredValue(TRUE[n] + k * sd, sd) for (n, sd), k in zip(SD.items(), off, strict=True)
    )
    entries = {
        "name": "made",
        "rest_length": MeasuredValue(TRUE["muscle.rest_length"]),
        "thread_length": length,
        "turns": turns,
        "threads": 144,
        "thread_area": MeasuredValue(TRUE["muscle.thread_area"]),
        "modulus": modulus,
        "sensors": sensors,
        "baseline": baseline,
    }
    return MuscleToml(**entries | more)


def made(
    law="elastic",
    seed=0,
    off=(0.7, -0.6, 1.0),
    channels=("force", "diameter"),
    bench=SENSORS,
    plan=STROKES,
    lag_one=0.0,
    name="made",
    true=None,
    **entries,
):
    """Return a simulated case.

    Args:
        off: see `build_muscle_toml`.
        bench: true noise of the sensors; `sensors` in `entries` is the stated noise.
        lag_one: lag-one correlation of the noise of force and diameter.
        true: true parameters that differ from `TRUE`.
    """
    numbers = {key: jnp.asarray(value) for key, value in (TRUE | (true or {})).items()}
    schedule = plan.build_schedule(TRUE["muscle.rest_length"])
    time = -1.0 / np.log(lag_one) if lag_one else 0.0
    recording = simulate(assemble(law, numbers), schedule, bench, seed=seed, correlation_time=time)
    for channel in {"force", "diameter"} - set(channels):
        recording = dataclasses.replace(recording, **{channel: np.full(recording.n, np.nan)})
    return Case(name, Path("."), build_muscle_toml(off, **entries), recording, "")


def sds_off(fit, true=TRUE):
    """Return the error of each estimate in units of its sd, by parameter."""
    return {n: (e.value - true[n]) / e.sd for n, e in fit.estimates.items() if n in true and e.sd is not None}
