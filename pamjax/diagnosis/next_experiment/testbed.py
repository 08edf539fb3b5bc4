"""The stage: a recording's muscle, rig and noise, on which protocols are played before they are made."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.library.library_problem import Problem, program_rows
from pamjax.diagnosis.next_experiment.power import Side
from pamjax.diagnosis.next_experiment.protocols import Protocol
from pamjax.diagnosis.next_experiment.rig import CAMERA, Rig
from pamjax.diagnosis.noise.estimate import Whitening
from pamjax.diagnosis.refit.candidate_fit import Model
from pamjax.diagnosis.refit.least_squares import LIMITS_APART, UNKNOWN, coordinates
from pamjax.infer.noise.ar1_filter import Colour
from pamjax.infer.noise.sensor_noise import effective_sd
from pamjax.infer.problem.dataset import case_history, sample_rows, starting_sd
from pamjax.records.case import Case
from pamjax.records.protocol import Schedule
from pamjax.records.recording import Recording

#: Seconds between a recording and the next protocol.
BREAK = 60.0


@dataclass(frozen=True, eq=False)
class Stage:
    """Where protocols are played: a recording's muscle and rig, and its noise.

    Attributes:
        found: the recording before the library.
        rig: what its bench can do.
        own: noise of one sample of force (N) and of diameter (m) that is the channel's own.
        wider: factor on it where the model leaves more than noise.
        memory: by channel, correlation of neighbouring samples and the seconds between them.
        begin: when a new protocol begins, s.
    """

    found: Problem
    rig: Rig
    own: tuple[float, float]
    wider: float
    memory: tuple[tuple[float, float], ...]
    begin: float

    @classmethod
    def of(cls, found: Problem, model: Model) -> Stage:
        """The stage that a recording and its model set."""
        recording, sensors = found.case.recording, found.case.entry.sensors
        step, spent = _clock(recording)
        colours = model.white.colours
        seen = [CAMERA if c is None else float(np.sqrt(np.mean(c.sd[r] ** 2))) for c, r in
                zip(colours, model.white.rows, strict=True)]  # fmt: skip
        given = starting_sd(found.case)
        own = (
            seen[0] if sensors.force is None else given[0],
            seen[1] if sensors.diameter is None else given[1],
        )
        wider = np.sqrt(max(model.at.misfit / max(model.white.size, 1), 1.0))
        memory = tuple((0.0 if c is None else c.correlation, step) for c in colours)
        return cls(
            found, _rig(recording, found.case, own, step, spent), own, float(wider), memory, spent + BREAK
        )

    def play(self, schedule: Schedule) -> Problem:
        """The muscle on a schedule, in the same compiled program as the recording unless it is longer."""
        found, n = self.found, schedule.time.size
        size = max(found.member.rows.pressure.size, program_rows(n))
        recording = Recording.from_arrays(
            time=schedule.time, pressure=schedule.pressure, length=schedule.length, cycle=schedule.cycle,
            force=np.full(n, 1e3), diameter=np.where(schedule.optical, 1.0, np.nan),
        )  # fmt: skip
        case = Case(found.case.name, Path(), found.case.entry, recording, "", (), "carry", found.case.before)
        rows = sample_rows(case, size)
        rows = dataclasses.replace(rows, setting=jnp.zeros_like(rows.setting))
        history = case_history(case, size, padding=False)
        member, lighter = (
            dataclasses.replace(m, rows=rows, history=history) for m in (found.member, found.lighter)
        )
        return dataclasses.replace(
            found, case=case, member=member, lighter=lighter, measured=np.full((2, n), np.nan)
        )

    def white(self, on: Problem, values: np.ndarray, there: np.ndarray) -> Whitening:
        """The noise that a protocol will have, in the (2, n) samples that will be there."""
        sd = effective_sd(on.member, jnp.asarray(values), on.case.entry.sensors, self.own)[:, : on.n]
        sd = self.wider * np.nan_to_num(sd, nan=1e30)
        step, _ = _clock(on.case.recording)
        colours, rows, runs = [], [], []
        for c in range(2):
            at = np.flatnonzero(there[c])
            rows.append(at)
            runs.append(np.array([[0, at.size]]) if at.size else np.zeros((0, 2), int))
            rho, per = self.memory[c]
            shared = float(np.mean((self.wider * self.own[c] / sd[c][at]) ** 2)) if at.size else 1.0
            colours.append(Colour(sd[c], shared, rho ** (step / per), True) if at.size else None)
        return Whitening(tuple(colours), tuple(rows), tuple(runs))


def _clock(recording: Recording) -> tuple[float, float]:
    """Seconds between samples, and where the clock stands at the end."""
    if recording.time is None or recording.n < 2:
        return 1.0, 0.0
    return max(float(np.median(np.diff(recording.time))), 1e-3), float(recording.time[-1])


def _rig(recording: Recording, case: Case, own, step: float, spent: float) -> Rig:
    good = recording.usable
    rest, sensors = case.entry.rest_length.value, case.entry.sensors
    length = recording.length[good]
    speed = np.abs(np.diff(length)) / step
    moving = speed[speed > 0.2 * np.max(speed, initial=0.0)]
    strokes = moving.size > 0.2 * speed.size
    return Rig(
        rest=rest,
        pressure=float(np.max(recording.pressure[good])),
        contraction=float(max(1 - np.min(length) / rest, 0.05)),
        speed=float(np.median(moving)) if strokes else 1e-3,
        step=step,
        force=own[0],
        diameter=own[1],
        gauge=sensors.pressure or 1e-3 * float(np.max(recording.pressure[good])),
        ruler=sensors.length or 2e-5,
        pull=float(np.nanmax(recording.force, initial=10.0)),
        camera=bool(np.isfinite(recording.diameter).any()),
        spent=spent,
    )


def contrast(stage: Stage, protocol: Protocol, a: Model, b: Model) -> tuple[np.ndarray, Side, Side]:
    """White difference of two models on a protocol, (m,), and either model before it."""
    found = stage.found
    delta, slopes = [], [[], []]
    schedule = protocol.schedule(stage.rig, stage.begin)
    if schedule is not None:
        on = stage.play(schedule)
        (shown_a, by_a), (shown_b, by_b) = (on.slopes(m.at.values, m.at.moved) for m in (a, b))
        there = np.isfinite(shown_a) & np.isfinite(shown_b)
        # A muscle that would have to push is slack: nothing is measured there that tells models apart.
        there &= (shown_a[0] > 0) & (shown_b[0] > 0)
        there[1] &= schedule.optical
        white = stage.white(on, a.at.values, there)
        if white.size:
            delta.append(white(np.nan_to_num(shown_a - shown_b)))
            for k, (model, by) in enumerate(((a, by_a), (b, by_b))):
                slopes[k].append(white(np.nan_to_num(by)) * model.at.scale[:, None])
    for k, sd in readings(stage, protocol, a, b).items():
        delta.append(np.array([(a.at.values[k] - b.at.values[k]) / sd]))
        for j, model in enumerate((a, b)):
            own = np.array([float(place == k) for place in model.at.moved])
            slopes[j].append((own * model.at.scale / sd)[:, None])
    if not delta:
        delta, slopes = [np.zeros(0)], [[np.zeros((len(m.at.moved), 0))] for m in (a, b)]
    first, second = (
        Side(np.concatenate(by, axis=1), _known(found, m)) for m, by in zip((a, b), slopes, strict=True)
    )
    return np.concatenate(delta), first, second


def readings(stage: Stage, protocol: Protocol, a: Model, b: Model) -> dict[int, float]:
    """Which numbers a protocol reads directly, by their place, with the standard deviations, SI."""
    found, out = stage.found, {}
    for name, sd in protocol.direct(stage.rig).items():
        if name in found.names:
            k = found.place(name)
            own = max(abs(a.at.values[k]), abs(b.at.values[k]), 1e-12)
            out[k] = sd if sd >= 0 else -sd * own
    return out


def _known(found: Problem, model: Model) -> np.ndarray:
    """What the recording, the priors and the limits know of a model's numbers, in their coordinates."""
    jacobian, moved = model.at.jacobian, model.at.moved
    low, high = (coordinates(found, moved, edge) for edge in (found.low, found.high))
    # A number anywhere between its limits has a twelfth of their distance squared as variance.
    believed = np.where(model.at.prior < UNKNOWN, model.at.prior, (high - low) / LIMITS_APART)
    return jacobian.T @ jacobian + np.diag(1 / believed**2)
