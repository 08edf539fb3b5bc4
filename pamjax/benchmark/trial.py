"""A trial: one envelope, what was said of it, and how that compares with what was in it."""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from pamjax.baselines.gaussian_process import discrepancy, inputs
from pamjax.baselines.stepwise_bic import select
from pamjax.benchmark.inject_effect import Envelope, conceal
from pamjax.benchmark.overlap import blind, overlap, true_boxes
from pamjax.benchmark.setups import draw
from pamjax.benchmark.stand_in import stands_in
from pamjax.diagnosis.crossval.gain import held_out
from pamjax.diagnosis.detect.regions import axes
from pamjax.diagnosis.detect.score_test import signatures
from pamjax.diagnosis.detect.significance import DETECTED, Significance, significance
from pamjax.diagnosis.library.candidates import forms
from pamjax.diagnosis.library.library_problem import problem
from pamjax.diagnosis.refit.candidate_fit import settle
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.blocks import blocks
from pamjax.records.case import Case

#: Kinds of envelopes: nothing in it, one effect, two, three, or one that is in no catalogue.
KINDS = {"nothing": 0, "single": 1, "pair": 2, "triple": 3, "outside": 1}

#: How far a diagnosis is taken: to the end, or to the baseline's p-value, before anything is named.
STAGES = ("all", "score")

#: Effects, rms in noise standard deviations: from just detectable over obvious (8) to large.
SMALLEST, LARGEST = 3.0, 25.0

#: What tells trials apart.
Key = tuple[str, str, float, int, int, float]


@dataclass(frozen=True)
class Task:
    """Which envelope; the same task is the same recording.

    Attributes:
        stage: one of `STAGES`.
        kind: a key of `KINDS`.
        correlation: of neighbouring samples of noise.
        number: of the envelope.
        seed: of the proof.
        rivals: whether common practice is asked as well.
        form_error: share by which effects depart from their equations.
    """

    stage: str
    kind: str
    correlation: float
    number: int
    seed: int = 0
    rivals: bool = False
    form_error: float = 0.0

    @property
    def key(self) -> Key:
        """What tells it from others."""
        return (
            self.stage, self.kind, round(self.correlation, 6), self.number, self.seed,
            round(self.form_error, 6),
        )  # fmt: skip


@dataclass(frozen=True)
class Recovered:
    """A number, SI: as it was, as it was found, its sd; whether the concealed form has the same numbers."""

    name: str
    true: float
    value: float
    sd: float
    same: bool


@dataclass(frozen=True)
class Trial:
    """One envelope and what was said of it.

    Attributes:
        stage, kind, correlation, number, seed, form_error: of its task.
        law: the baseline.
        blocks: what kind of blocks the recording has.
        concealed, sizes: what was in it, and its effect in noise standard deviations.
        p_value: of the mismatch.
        named: what was named, most probable first; ties: what else each could have been.
        probabilities: of the names.
        stand_ins: (concealed, other) pairs among what was said that this recording truly cannot tell apart.
        unexplained: whether something was said to be left.
        before, after: held-out rmse over effective noise, by channel.
        iou, iou_blind: overlap of the located box with a true one, and of the whole recording; None without.
        numbers: of right names, and of the baseline.
        selected: what BIC under independent noise selected; None where it was not asked.
        selected_after, curve_after: held-out rmse of force over noise, of that selection and of a process.
        seconds: of processor time.
        error: why there is no verdict, or "".
    """

    stage: str
    kind: str
    correlation: float
    number: int
    seed: int
    law: str
    blocks: str
    concealed: tuple[str, ...] = ()
    sizes: tuple[float, ...] = ()
    p_value: float = 1.0
    named: tuple[str, ...] = ()
    ties: tuple[tuple[str, ...], ...] = ()
    probabilities: tuple[float, ...] = ()
    stand_ins: tuple[tuple[str, str], ...] = ()
    unexplained: bool = False
    before: dict[str, float] = field(default_factory=dict)
    after: dict[str, float] = field(default_factory=dict)
    iou: float | None = None
    iou_blind: float | None = None
    numbers: tuple[Recovered, ...] = ()
    selected: tuple[str, ...] | None = None
    selected_after: float | None = None
    curve_after: float | None = None
    form_error: float = 0.0
    seconds: float = 0.0
    error: str = ""

    @property
    def key(self) -> Key:
        """That of its task."""
        return Task(
            self.stage, self.kind, self.correlation, self.number, self.seed, form_error=self.form_error
        ).key

    @property
    def detected(self) -> bool:
        """Whether the mismatch counts as one."""
        return self.p_value < DETECTED

    @property
    def alarm(self) -> bool:
        """Whether anything was said to be wrong."""
        return self.detected or bool(self.named) or self.unexplained

    def meets(self, name: str, concealed: str) -> bool:
        """Whether a name is what was concealed, or what this recording truly cannot tell from it."""
        return name == concealed or (concealed, name) in self.stand_ins

    @property
    def found(self) -> tuple[bool, ...]:
        """Which of the concealed effects have a name."""
        return tuple(any(self.meets(name, id) for name in self.named) for id in self.concealed)

    @property
    def right(self) -> tuple[bool, ...]:
        """Which of the names stand for something that was concealed."""
        return tuple(any(self.meets(name, id) for id in self.concealed) for name in self.named)

    @property
    def exact(self) -> bool:
        """Whether everything was named and nothing besides."""
        return all(self.found) and all(self.right)

    def line(self) -> str:
        """One line of a file, without what is as in any trial."""
        told = asdict(self)
        return json.dumps({k: v for k, v in told.items() if v != _USUAL.get(k, ...)}, allow_nan=False)


_USUAL = asdict(Trial("", "", math.nan, -1, -1, "", ""))


def read_line(line: str) -> Trial:
    """A trial from its line."""
    told = json.loads(line)
    known = {f.name for f in fields(Trial)}
    values = {k: _tuples(v) for k, v in told.items() if k in known and k != "numbers"}
    return Trial(**values, numbers=tuple(Recovered(**one) for one in told.get("numbers", ())))


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def attempt(task: Task) -> Trial:
    """Draw an envelope, diagnose what the lab would see, open it."""
    begun = time.process_time()
    envelope = drawn(task)
    told: dict[str, Any] = {
        "stage": task.stage, "kind": task.kind, "correlation": task.correlation,
        "number": task.number, "seed": task.seed, "form_error": task.form_error,
        "law": envelope.case.entry.baseline,
        "blocks": blocks(envelope.case.recording).kind,
        "concealed": envelope.concealed, "sizes": envelope.sizes,
    }  # fmt: skip
    try:
        if task.stage == "score":
            told["p_value"] = scored(envelope.case, task.number).p_value
        else:
            told |= _compared(envelope, diagnose(envelope.case, seed=task.number), task.rivals)
    except Exception as error:  # one recording that breaks the tool is a result of the proof, not its end
        told["error"] = f"{type(error).__name__}: {error}"[:300]
    return Trial(**told, seconds=round(time.process_time() - begun, 2))


def drawn(task: Task) -> Envelope:
    """The envelope of a task."""
    words = [task.seed, list(KINDS).index(task.kind), task.number, round(1e3 * task.correlation)]
    rng = np.random.default_rng(words)
    return conceal(
        KINDS[task.kind], rng, setup=draw(rng), outside=task.kind == "outside",
        correlation=task.correlation, smallest=SMALLEST, largest=LARGEST,
        form_error=task.form_error, number=task.number,
    )  # fmt: skip


def scored(case: Case, seed: int = 0) -> Significance:
    """The baseline's own fit and its p-value, before anything is named."""
    found = problem(case)
    used = ~held_out(blocks(case.recording))
    baseline = settle(found, used, (), found.neutral)
    seen = signatures(found, baseline.white, baseline.at, forms(found))
    return significance(found, baseline.white, baseline.at, seen, seed)


def _compared(envelope: Envelope, one: Diagnosis, rivals: bool) -> dict[str, Any]:
    names = one.naming.established
    noise = _noise(one)
    told: dict[str, Any] = {
        "p_value": one.mismatch.p_value,
        "named": tuple(name.id for name in names),
        "ties": tuple(tuple(name.ties) for name in names),
        "probabilities": tuple(float(name.probability) for name in names),
        "stand_ins": _stand_ins(envelope, one),
        "unexplained": one.unexplained,
        "before": _over_noise(one, one.gain.rmse_before, noise),
        "after": _over_noise(one, one.gain.rmse_after, noise),
        "numbers": tuple(_numbers(envelope, one)),
    }
    at = axes(one.found)
    boxes = true_boxes(at, envelope.effects, noise)
    if boxes:
        claims = one.where if one.detected else []
        told |= {"iou": overlap(at, claims, boxes), "iou_blind": blind(at, boxes)}
    return told | (_rivals(one, noise) if rivals else {})


def _noise(one: Diagnosis) -> np.ndarray:
    """(2, n) effective noise of every sample, SI."""
    out = np.ones((len(CHANNELS), one.found.n))
    for c, colour in enumerate(one.model.white.colours):
        if colour is not None:
            out[c] = np.broadcast_to(colour.sd, one.found.n)
    return out


def _over_noise(one: Diagnosis, rmse: dict[str, float], noise: np.ndarray) -> dict[str, float]:
    out = {}
    for c, channel in enumerate(CHANNELS):
        rows = one.gain.held_out & np.isfinite(one.found.measured[c])
        if channel in rmse and rows.any():
            out[channel] = rmse[channel] / float(np.sqrt(np.mean(noise[c][rows] ** 2)))
    return out


def _stand_ins(envelope: Envelope, one: Diagnosis) -> tuple[tuple[str, str], ...]:
    """Which of what was said, and was not concealed, this recording cannot tell from what was."""
    real = [form.id for form in envelope.forms]
    said = {id for name in one.names for id in (name.id, *name.ties)} - set(real)
    return tuple(
        (id, other) for id in real for other in sorted(said) if stands_in(one.found, envelope, id, other)
    )


def _numbers(envelope: Envelope, one: Diagnosis) -> list[Recovered]:
    """The numbers of right names, and of the baseline, beside the true ones."""
    found, out = one.found, []
    concealed = {form.id: set(form.moves) for form in envelope.forms}
    chosen = {form.id: set(form.moves) for form in one.model.chosen}
    for id, numbers in one.parameters.items():
        for word, number in numbers.items() if id in concealed else ():
            name = f"{id}.{word}"
            same = concealed[id] == chosen[id]
            out.append(_recovered(envelope, name, number.value, number.sd, same))
    exact = set(concealed) == set(chosen)
    # What noise made of a held length has no true number.
    for k in (k for k in np.flatnonzero(found.own).tolist() if found.names[k] in envelope.true):
        out.append(_recovered(envelope, found.names[k], one.model.at.values[k], one.model.sd(k), exact))
    return [number for number in out if np.isfinite([number.true, number.value, number.sd]).all()]


def _recovered(envelope: Envelope, name: str, value: float, sd: float, same: bool) -> Recovered:
    return Recovered(name, float(envelope.true[name]), float(value), float(sd), bool(same))


def _rivals(one: Diagnosis, noise: np.ndarray) -> dict[str, Any]:
    found, used, out = one.found, ~one.gain.held_out, {}
    selection = select(found, used)
    out["selected"] = selection.ids
    before = one.gain.before[0]
    curve = before + discrepancy(inputs(found), found.measured[0] - before, used)
    rows = one.gain.held_out & np.isfinite(found.measured[0])
    if rows.any():
        floor = float(np.sqrt(np.mean(noise[0][rows] ** 2)))
        for word, force in (("selected_after", selection.force), ("curve_after", curve)):
            out[word] = float(np.sqrt(np.mean((found.measured[0] - force)[rows] ** 2))) / floor
    return out
