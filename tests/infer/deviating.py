"""Simulated muscles whose mechanism differs from its equation, and their fits."""

import dataclasses
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.fit import fit
from pamjax.model.assembly import assemble_bench
from pamjax.records.case import Case
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import Sensors, read_muscle_toml
from pamjax.records.simulate import simulate
from tests.infer.made import TRUE

SENSORS = Sensors(force=2.0)
MECHANISM = "contact_pressure"
STRENGTH = {"contact_pressure.threshold": 30e3}
#: Five isobars of 31 rows, and other pressures, contractions and speeds within their range.
PLANS = {
    "first": Protocol(
        kind="strokes",
        pressures=["100 kPa", "200 kPa", "350 kPa", "500 kPa", "690 kPa"],
        contractions=[0.2],
        speed="3.14 mm/s",
        cycles=1,
    ),
    "other": Protocol(
        kind="strokes",
        pressures=["150 kPa", "280 kPa", "430 kPa", "600 kPa"],
        contractions=[0.17],
        speed="5 mm/s",
        cycles=2,
    ),
}
MUSCLE = """\
[muscle]
name = "made"
rest_length = "235.7 mm"
thread_length = {value = "251.2 mm", sd = "0.8 mm"}
turns = {value = 1.09, sd = 0.005}
threads = 144
thread_area = "0.0858 mm^2"

[thread]
modulus = {value = "40 GPa", sd = "8 GPa"}

[sensors]
force = "2 N"
"""
QUICK = {"mechanisms": [MECHANISM], "starts": 1, "fold_count": 5}


@cache
def simulate_exactly(on, plan="first"):
    numbers = {key: jnp.asarray(value) for key, value in TRUE.items()} | (
        {key: jnp.asarray(value) for key, value in STRENGTH.items()} if on else {}
    )
    schedule = PLANS[plan].build_schedule(TRUE["muscle.rest_length"])
    return simulate(assemble_bench("elastic", (MECHANISM,), numbers), schedule, Sensors())


def compute_true_force(share, plan="first"):
    """Return the force, N, with an effect that differs by a share of its rms, in length and pressure."""
    on, off, reference = simulate_exactly(True, plan), simulate_exactly(False, plan), simulate_exactly(True)
    rms = np.sqrt(np.mean(add_coordinates(reference, reference) ** 2))
    return off.force + (on.force - off.force) * (1 + share * add_coordinates(on, reference) / rms)


def build_case(share, seed=0, plan="first"):
    """Return a recording of `compute_true_force`, with sensor noise."""
    on, force = simulate_exactly(True, plan), compute_true_force(share, plan)
    noise = SENSORS.force * np.random.default_rng(seed).standard_normal(on.n)
    recording = dataclasses.replace(on, force=force + noise, diameter=np.full(on.n, np.nan))
    muscle_toml = read_muscle_toml(MUSCLE.encode(), "muscle.toml")
    return Case("made", Path("."), muscle_toml, recording, f"{share} {seed} {on.n}", text=MUSCLE)


def add_coordinates(recording, reference):
    """Return the sum of length and pressure, each scaled to -1 to 1 in the rows of a reference."""
    return sum(
        2 * (values - limits.min()) / np.ptp(limits) - 1
        for values, limits in (
            (recording.length, reference.length),
            (recording.pressure, reference.pressure),
        )
    )


@cache
def fit_case(share, form_error):
    return fit(build_case(share), form_error=form_error, **QUICK)
