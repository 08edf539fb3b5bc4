"""Recordings of a known muscle in which known physics is concealed: the envelope of a proof."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pamjax.model.library import TWICE
from pamjax.records.case import Case
from pamjax.records.entry import Entry, Sensors
from pamjax.records.protocol import Protocol
from pamjax.records.quantity import Measured
from pamjax.records.recording import Recording
from pamjax.records.simulate import coloured
from pamjax.study.forms import Form, forms
from pamjax.study.naming import begun
from pamjax.study.problem import Problem, problem
from pamjax.study.refit import refit
from pamjax.study.whiten import whitening

#: What a lab would call the muscle that everything is concealed in: the paper's, with softer threads.
MUSCLE = Entry(
    name="a known muscle",
    rest_length=Measured(0.2357),
    thread_length=Measured(0.2512, 0.4e-3),
    turns=Measured(1.09, 0.004),
    threads=144,
    thread_area=Measured(0.0858e-6),
    modulus=Measured(40e9, 8e9),
    sensors=Sensors(force=3.0, diameter=0.05e-3, pressure=500.0, length=0.02e-3),
    baseline="elastic",
)

#: Five isobars, two strokes at each, at two speeds.
PROTOCOL = Protocol(
    kind="strokes",
    pressures=["100 kPa", "200 kPa", "350 kPa", "500 kPa", "650 kPa"],
    contractions=[0.1, 0.17, 0.24, 0.27, 0.29],
    cycles=2,
    speed="1.2 mm/s",
    rate="2 Hz",
    diameter_every=4,
)

#: What is in no catalogue: an obstacle in the way, a load cell that clips, a ripple on the force.
OUTSIDE = ("obstacle", "clipping", "ripple")

#: Rounds in which an amplitude is brought to its wanted effect.
ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Envelope:
    """A recording and what is concealed in it.

    Attributes:
        case: what the diagnosis sees.
        concealed: ids, or one of `OUTSIDE`.
        sizes: rms of each in noise standard deviations, after the baseline has made up for what it can.
        true: the values of every number, SI, by name.
    """

    case: Case
    concealed: tuple[str, ...]
    sizes: tuple[float, ...]
    true: dict[str, float]


def conceal(
    many: int, rng: np.random.Generator, *, outside: bool = False, only: str | None = None,
    correlation: float = 0.0, smallest: float = 3.0, largest: float = 10.0, number: int = 0,
) -> Envelope:  # fmt: skip
    """Make a recording with physics that its baseline does not have.

    Args:
        many: how many mechanisms to conceal.
        rng: what draws the muscle, the mechanisms, their sizes and the noise.
        outside: whether to conceal something that is in no catalogue instead.
        only: id of the one mechanism to choose from; None for all.
        correlation: of neighbouring samples of force and of diameter.
        smallest, largest: effect, rms in noise standard deviations.
        number: of the recording, for its name.
    """
    bare = _case(_plan(), f"concealed-{number:04d}")
    found = problem(bare)
    values = found.neutral.copy()
    for k in np.flatnonzero(found.own):
        drawn = found.start[k] + found.sd[k] * np.clip(rng.standard_normal(), -2, 2)
        values[k] = np.clip(drawn, found.low[k], found.high[k])
    chosen = [] if outside else _choose(found, many, rng, only)
    sizes = []
    for form in chosen:
        wanted = math.exp(rng.uniform(math.log(smallest), math.log(largest)))
        values, size = _sized(found, values, form, wanted)
        sizes.append(size)
    shown = found.shows(values).copy()
    concealed = tuple(form.id for form in chosen)
    if outside:
        concealed = (str(rng.choice(OUTSIDE)),)
        added = _outside(concealed[0], bare.recording, shown[0], rng)
        wanted = math.exp(rng.uniform(math.log(smallest), math.log(largest)))
        noise = MUSCLE.sensors.force or 1.0
        shown[0] += added * wanted * noise / max(float(np.sqrt(np.mean(added**2))), 1e-12)
        sizes = [wanted]
    case = dataclasses.replace(bare, recording=_noisy(bare.recording, shown, rng, correlation))
    return Envelope(case, concealed, tuple(sizes), dict(zip(found.names, values.tolist(), strict=True)))


def _plan() -> Recording:
    """The schedule as a recording without noise; force and diameter are filled in later."""
    plan = PROTOCOL.schedule(MUSCLE.rest_length.value)
    here = np.where(plan.optical, 1.0, np.nan)
    return Recording.from_arrays(
        time=plan.time, pressure=plan.pressure, length=plan.length, cycle=plan.cycle,
        force=np.full(plan.time.size, 1e3), diameter=here,
    )  # fmt: skip


def _case(recording: Recording, name: str) -> Case:
    return Case(name=name, folder=Path(name), entry=MUSCLE, recording=recording, checksum="simulated")


def _choose(found: Problem, many: int, rng: np.random.Generator, only: str | None) -> list[Form]:
    """Different mechanisms that may act together, each in one of its forms."""
    # The baseline's own threads are no concealed physics here.
    known = [form for form in forms(found) if form.id != "braid_elasticity" and only in (None, form.id)]
    chosen: list[Form] = []
    for id in rng.permutation(sorted({form.id for form in known})):
        if any(frozenset({id, form.id}) in TWICE for form in chosen):
            continue
        if len(chosen) < many:
            options = [form for form in known if form.id == id]
            chosen.append(options[rng.integers(len(options))])
    return chosen


def _sized(found: Problem, values: np.ndarray, form: Form, wanted: float) -> tuple[np.ndarray, float]:
    """Values with a form at the amplitude that has a wanted effect, or as much as its limits allow."""
    places = [found.place(name) for name in form.amplitudes]
    amplitude = np.array([0.002 * (found.high[k] - found.neutral[k]) for k in places])
    size = 0.0
    for _ in range(ROUNDS):
        trial = begun(found, values, form, amplitude)
        size = _effect(found, values, trial)
        amplitude = amplitude * np.clip(wanted / max(size, 1e-9), 0.02, 50.0)
    trial = begun(found, values, form, amplitude)
    return trial, _effect(found, values, trial)


def _effect(found: Problem, without: np.ndarray, values: np.ndarray) -> float:
    """Rms of a change in noise standard deviations, beyond a refitted baseline, on its largest channel."""
    shown = found.shows(values)
    whole = np.ones(found.n, dtype=bool)
    as_measured = dataclasses.replace(found, measured=np.where(np.isnan(found.measured), np.nan, shown))
    white = whitening(as_measured, values, whole)
    own = np.flatnonzero(found.own).tolist()
    left = shown - found.shows(refit(as_measured, white, own, without).values)
    sizes = []
    for c in range(2):
        own_sd = (MUSCLE.sensors.force, MUSCLE.sensors.diameter)[c] or 1.0
        standard = left[c][np.isfinite(as_measured.measured[c])] / own_sd
        sizes.append(float(np.sqrt(np.mean(standard**2))))
    return max(sizes)


def _outside(kind: str, recording: Recording, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A pattern on the force that is no muscle's, in arbitrary units."""
    contraction = 1 - recording.length / MUSCLE.rest_length.value
    if kind == "obstacle":
        start = rng.uniform(0.12, 0.2)
        return np.maximum(contraction - start, 0.0)
    if kind == "clipping":
        return -np.maximum(force - rng.uniform(0.55, 0.8) * force.max(), 0.0)
    return np.sin(2 * np.pi * recording.length / rng.uniform(2e-3, 4e-3)) * force / force.max()


def _noisy(plan: Recording, shown: np.ndarray, rng: np.random.Generator, correlation: float) -> Recording:
    sensors, n = MUSCLE.sensors, plan.n
    return dataclasses.replace(
        plan,
        pressure=plan.pressure + (sensors.pressure or 0.0) * rng.standard_normal(n),
        length=plan.length + (sensors.length or 0.0) * rng.standard_normal(n),
        force=shown[0] + (sensors.force or 0.0) * coloured(rng, n, correlation),
        diameter=np.where(
            np.isfinite(plan.diameter),
            shown[1] + (sensors.diameter or 0.0) * coloured(rng, n, correlation),
            np.nan,
        ),
    )
