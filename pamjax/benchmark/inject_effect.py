"""Recordings of a muscle in which known physics is concealed: the envelope of a proof.

They are made with the same equations as the fit: a proof on them shows that the method can do what it
says where its equations hold, not that they hold. Shapes of what is concealed (times, distances, shares)
are drawn off the values from which the catalogue's forms start. With a form error each effect departs from
its equation as well, by a smooth share that is drawn over pressure and length: physics of the catalogue as
nature may have it.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.benchmark.setups import Setup, known
from pamjax.diagnosis.library.candidates import Form, forms
from pamjax.diagnosis.library.library_problem import Problem, problem
from pamjax.diagnosis.noise.estimate import whitening
from pamjax.diagnosis.refit.least_squares import refit
from pamjax.infer.problem.dataset import Member
from pamjax.model.mechanism import AbstractSensor
from pamjax.model.registry import MECHANISMS, TWICE
from pamjax.records.case import Case
from pamjax.records.recording import Recording
from pamjax.records.simulate import coloured

#: What is in no catalogue: an obstacle in the way, a load cell that clips, a ripple on the force.
OUTSIDE = ("obstacle", "clipping", "ripple")

#: Mechanisms that only read wrongly.
SENSORS = {kind.id for kind in MECHANISMS if issubclass(kind, AbstractSensor)}

#: Rounds in which an amplitude is brought to its wanted effect.
ROUNDS = 4

#: Sd of ln(shape number) around the value from which a form starts.
SPREAD = 0.3

#: What falls short of its wanted effect by more than this factor, at the limits of its numbers, is not
#: concealed: another is drawn.
SHORT = 0.7


@dataclass(frozen=True, eq=False)
class Envelope:
    """A recording and what is concealed in it.

    Attributes:
        case: what the diagnosis sees.
        concealed: ids, or one of `OUTSIDE`.
        sizes: rms of each in effective noise standard deviations, after the baseline has made up for what
            it can with all others there; on the channel where it is largest.
        true: the values of every number, SI, by name.
        forms: in which each id was concealed; none for what is in no catalogue.
        clean: (2, n) force (N) and diameter (m) without noise.
        effects: (k, 2, n) what each does beyond a refitted baseline, SI.
    """

    case: Case
    concealed: tuple[str, ...]
    sizes: tuple[float, ...]
    true: dict[str, float]
    forms: tuple[Form, ...]
    clean: np.ndarray
    effects: np.ndarray


def conceal(
    many: int, rng: np.random.Generator, *, setup: Setup | None = None,
    outside: bool = False, only: str | None = None, correlation: float = 0.0,
    smallest: float = 3.0, largest: float = 10.0, form_error: float = 0.0, number: int = 0,
) -> Envelope:  # fmt: skip
    """Make a recording with physics that its baseline does not have.

    Args:
        many: how many mechanisms to conceal.
        rng: what draws the muscle's numbers, the mechanisms, their sizes and the noise.
        setup: the muscle and its bench; None takes the one that is always the same.
        outside: whether to conceal something that is in no catalogue instead.
        only: id of the one mechanism to choose from; None for all.
        correlation: of neighbouring samples of force and of diameter.
        smallest, largest: effect, rms in noise standard deviations.
        form_error: share, rms, by which each effect of muscle or rig departs from its equation.
        number: of the recording, for its name.
    """
    setup = setup or known()
    name = f"concealed-{number:04d}"
    bare = Case(name=name, folder=Path(name), entry=setup.entry, recording=setup.plan, checksum="simulated")
    found = _slackening(problem(bare))
    values = _muscle(found, rng)
    chosen: list[Form] = []
    for form in [] if outside else _choices(found, rng, only):
        if len(chosen) == many:
            break
        if any(frozenset({form.id, other.id}) in TWICE for other in chosen):
            continue
        wanted = math.exp(rng.uniform(math.log(smallest), math.log(largest)))
        trial, effect, own = _sized(found, values, form, wanted, rng)
        if _rms(effect, own) > SHORT * wanted:
            values = trial
            chosen.append(form)
    shown = found.shows(values)
    shown = shown + _departure(found, values, chosen, form_error, rng)
    effects, sizes = _alone(found, values, chosen)
    ids = tuple(form.id for form in chosen)
    if outside:
        ids = (str(rng.choice(OUTSIDE)),)
        wanted = math.exp(rng.uniform(math.log(smallest), math.log(largest)))
        effects, sizes = _added(found, values, ids[0], wanted, rng)
        shown += effects[0]
    case = dataclasses.replace(bare, recording=_noisy(setup, shown, rng, correlation))
    true = dict(zip(found.names, values.tolist(), strict=True))
    return Envelope(case, ids, tuple(sizes), true, tuple(chosen), shown, effects)


def _slackening(found: Problem) -> Problem:
    """The same bench, on which a muscle never pushes: where the ideal one would, it is slack."""

    def slack(member: Member) -> Member:
        return eqx.tree_at(lambda m: m.rows.slack, member, jnp.ones_like(member.rows.slack))

    return dataclasses.replace(found, member=slack(found.member), lighter=slack(found.lighter))


def _muscle(found: Problem, rng: np.random.Generator) -> np.ndarray:
    """The muscle as it is: its numbers off what the lab believes, within two standard deviations."""
    values = found.neutral.copy()
    for k in np.flatnonzero(found.own).tolist():
        values[k] = _near(found, k, rng)
    return values


def _near(found: Problem, k: int, rng: np.random.Generator) -> float:
    """A number off what the lab believes, within two standard deviations."""
    drawn = found.start[k] + found.sd[k] * np.clip(rng.standard_normal(), -2, 2)
    return float(np.clip(drawn, found.low[k], found.high[k]))


def _choices(found: Problem, rng: np.random.Generator, only: str | None) -> list[Form]:
    """Every mechanism in one of its forms, in an order that is drawn."""
    known = [form for form in forms(found) if only in (None, form.id)]
    if found.law != "inelastic":
        # The baseline's own threads are no concealed physics here.
        known = [form for form in known if form.id != "braid_elasticity"]
    order = rng.permutation(sorted({form.id for form in known}))
    return [options[rng.integers(len(options))] for id in order if (options := _of(known, id))]


def _of(known: list[Form], id: str) -> list[Form]:
    return [form for form in known if form.id == id]


def _sized(
    found: Problem, values: np.ndarray, form: Form, wanted: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values with a form at the amplitude that has a wanted effect or as much as its limits allow, that
    effect and the noise it is measured in. What the lab states has no other size than the lab believes."""
    places = [found.place(name) for name in form.amplitudes]
    shaped = _shaped(found, values, form, rng)
    sign = np.array([rng.choice([-1.0, 1.0]) if found.low[k] < found.neutral[k] else 1.0 for k in places])
    span = np.array([found.high[k] - found.neutral[k] for k in places])
    along = sign * span * rng.dirichlet(np.ones(len(places)))
    stated = {k: _near(found, k, rng) for k in places if math.isfinite(found.sd[k])}
    scale = 0.002
    trial, effect, own = shaped, np.full((2, found.n), np.nan), np.ones((2, found.n))
    for _ in range(ROUNDS):
        trial = shaped.copy()
        for k, amplitude in zip(places, scale * along, strict=True):
            inside = 0.02 * (found.high[k] - found.low[k])
            sized = np.clip(found.neutral[k] + amplitude, found.low[k], found.high[k] - inside)
            trial[k] = stated.get(k, sized)
        effect, own = _effect(found, values, trial)
        off = wanted / max(_rms(effect, own), 1e-9)
        if abs(math.log(off)) < 0.05:
            break
        scale *= float(np.clip(off, 0.02, 50.0))
    return trial, effect, own


def _shaped(found: Problem, values: np.ndarray, form: Form, rng: np.random.Generator) -> np.ndarray:
    """Values with a form's shape off the one that the catalogue starts from."""
    out = values.copy()
    for name, value in form.shape.items():
        k = found.place(name)
        low, high = found.low[k], found.high[k]
        if name.endswith(".when"):
            assert found.case.recording.time is not None
            low, high = found.case.recording.time[[0, -1]]
        edge = 0.02 * (high - low) if found.meaning[k].scale != "log" else 0.0
        drawn = np.clip(rng.standard_normal(), -2, 2)
        near = value + found.sd[k] * drawn if math.isfinite(found.sd[k]) else value * math.exp(SPREAD * drawn)
        out[k] = np.clip(near, low + edge, high - edge)
    return out


def _effect(found: Problem, without: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a change does beyond a refitted baseline, SI, (2, n), and the noise of every sample."""
    shown = found.shows(values)
    as_measured = dataclasses.replace(found, measured=np.where(np.isnan(found.measured), np.nan, shown))
    white = whitening(as_measured, values, np.ones(found.n, dtype=bool))
    own = np.flatnonzero(found.own).tolist()
    left = shown - found.shows(refit(as_measured, white, own, without).values)
    sd = [np.broadcast_to(colour.sd, found.n) if colour else np.ones(found.n) for colour in white.colours]
    return np.where(np.isnan(found.measured), np.nan, left), np.array(sd)


def _rms(effect: np.ndarray, own: np.ndarray) -> float:
    """The larger of the two channels' rms, in noise standard deviations; NaN is not measured.

    The largest hundredth is left out: what two samples beside a slack muscle alone show is no effect.
    """
    squares = [np.sort(one[np.isfinite(one)] ** 2) for one in effect / own]
    most = [square[: square.size - square.size // 100] for square in squares]
    return max(float(np.sqrt(np.mean(square))) if square.size else 0.0 for square in most)


def _alone(found: Problem, values: np.ndarray, chosen: list[Form]) -> tuple[np.ndarray, list[float]]:
    """What each form adds to all others, and its size."""
    effects, sizes = np.zeros((len(chosen), 2, found.n)), []
    for i, form in enumerate(chosen):
        effects[i], own = _effect(found, absent(found, values, form), values)
        sizes.append(_rms(effects[i], own))
    return effects, sizes


def _departure(
    found: Problem, values: np.ndarray, chosen: list[Form], share: float, rng: np.random.Generator
) -> np.ndarray:
    """By how much effects are not what their equations say, SI, (2, n).

    A sensor's zero is a zero and its gain a gain: those do not depart.
    """
    out = np.zeros((2, found.n))
    for form in chosen if share else []:
        if form.id not in SENSORS:
            effect = found.shows(values) - found.shows(absent(found, values, form))
            out += share * _smooth(found.case.recording, rng) * effect
    return out


def _smooth(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A quadratic in pressure and length with coefficients that are drawn, (n,), rms one."""
    p, x = (
        2 * (one - one.min()) / max(np.ptp(one), 1e-12) - 1 for one in (recording.pressure, recording.length)
    )
    drawn = rng.standard_normal(5) @ np.stack([p, x, p * x, p**2 - 1 / 3, x**2 - 1 / 3])
    return drawn / np.sqrt(np.mean(drawn**2))


def absent(found: Problem, values: np.ndarray, form: Form) -> np.ndarray:
    """Values with a form's amplitudes back at neutral."""
    out = values.copy()
    for name in form.amplitudes:
        out[found.place(name)] = found.neutral[found.place(name)]
    return out


def _added(
    found: Problem, values: np.ndarray, kind: str, wanted: float, rng: np.random.Generator
) -> tuple[np.ndarray, list[float]]:
    """A pattern on the force that is no muscle's, as large as wanted after a refit."""
    plain = found.shows(values)
    pattern = np.zeros((2, found.n))
    pattern[0] = _outside(kind, found.case, plain[0], rng)
    measured = np.isfinite(found.measured)
    scale, size = (found.case.entry.sensors.force or 1.0) / max(float(np.std(pattern[0])), 1e-12), 0.0
    for _ in range(ROUNDS):
        shown = np.where(measured, plain + scale * pattern, np.nan)
        as_measured = dataclasses.replace(found, measured=shown)
        white = whitening(as_measured, values, np.ones(found.n, dtype=bool))
        own = np.flatnonzero(found.own).tolist()
        left = shown - found.shows(refit(as_measured, white, own, values).values)
        colour = white.colours[0]
        assert colour is not None
        size = float(np.sqrt(np.nanmean((left[0] / colour.sd) ** 2)))
        if abs(math.log(wanted / max(size, 1e-9))) < 0.05:
            break
        scale *= float(np.clip(wanted / max(size, 1e-9), 0.02, 50.0))
    return (scale * pattern)[None], [size]


def _outside(kind: str, case: Case, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A pattern on the force that is no muscle's, in arbitrary units."""
    recording, rest = case.recording, case.entry.rest_length.value
    contraction = 1 - recording.length / rest
    if kind == "obstacle":
        start = rng.uniform(0.4, 0.7) * contraction.max()
        return np.maximum(contraction - start, 0.0)
    if kind == "clipping":
        return -np.maximum(force - rng.uniform(0.55, 0.8) * force.max(), 0.0)
    return np.sin(2 * np.pi * recording.length / (rest * rng.uniform(0.01, 0.02))) * force / force.max()


def _noisy(setup: Setup, shown: np.ndarray, rng: np.random.Generator, correlation: float) -> Recording:
    sensors, plan = setup.entry.sensors, setup.plan
    n = plan.n
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
