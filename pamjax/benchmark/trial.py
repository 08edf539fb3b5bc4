"""A trial: one envelope, what was said of it, and how that compares with what was in it."""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from pamjax.baselines.gaussian_process import build_inputs, predict_discrepancy
from pamjax.baselines.stepwise_bic import select_by_bic
from pamjax.benchmark.inject_effect import GroundTruth, inject_effects
from pamjax.benchmark.overlap import compute_blind_overlap, compute_overlap, compute_true_boxes
from pamjax.benchmark.setups import draw_setup
from pamjax.benchmark.stand_in import is_indistinguishable
from pamjax.diagnosis.crossval.gain import select_held_out_rows
from pamjax.diagnosis.detect.regions import build_axes
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.detect.significance import DETECTION_P_VALUE, Significance, compute_significance
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.candidate_fit import fit_candidate
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case

#: Kinds of envelopes: nothing in it, one effect, two, three, or one that is in no catalogue.
TRIAL_KINDS = {"nothing": 0, "single": 1, "pair": 2, "triple": 3, "outside": 1}

#: How far a diagnosis is taken: to the end, or to the baseline's p-value, before anything is named.
TRIAL_STAGES = ("all", "score")

#: Effects, rms in noise standard deviations: from just detectable over obvious (8) to large.
MIN_EFFECT_SD, MAX_EFFECT_SD = 3.0, 25.0

#: What tells trials apart.
TrialKey = tuple[str, str, float, int, int, float]


@dataclass(frozen=True)
class TrialTask:
    """Which envelope; the same task is the same recording.

    Attributes:
        stage: one of `TRIAL_STAGES`.
        kind: a key of `MAX_LENGTH_COLOURS`.
        correlation: of neighbouring samples of noise.
        number: of the envelope.
        seed: of the proof.
        with_baselines: whether common practice is asked as well.
        form_error: share by which effects depart from their equations.
    """

    stage: str
    kind: str
    correlation: float
    number: int
    seed: int = 0
    with_baselines: bool = False
    form_error: float = 0.0

    @property
    def key(self) -> TrialKey:
        """What tells it from others."""
        return (
            self.stage, self.kind, round(self.correlation, 6), self.number, self.seed,
            round(self.form_error, 6),
        )  # fmt: skip


@dataclass(frozen=True)
class RecoveredParameter:
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
    numbers: tuple[RecoveredParameter, ...] = ()
    selected: tuple[str, ...] | None = None
    selected_after: float | None = None
    curve_after: float | None = None
    form_error: float = 0.0
    seconds: float = 0.0
    error: str = ""

    @property
    def key(self) -> TrialKey:
        """That of its task."""
        return TrialTask(
            self.stage, self.kind, self.correlation, self.number, self.seed, form_error=self.form_error
        ).key

    @property
    def detected(self) -> bool:
        """Whether the mismatch counts as one."""
        return self.p_value < DETECTION_P_VALUE

    @property
    def is_alarm(self) -> bool:
        """Whether anything was said to be wrong."""
        return self.detected or bool(self.named) or self.unexplained

    def matches(self, name: str, concealed: str) -> bool:
        """Whether a name is what was concealed, or what this recording truly cannot tell from it."""
        return name == concealed or (concealed, name) in self.stand_ins

    @property
    def effects_found(self) -> tuple[bool, ...]:
        """Which of the concealed effects have a name."""
        return tuple(any(self.matches(name, id) for name in self.named) for id in self.concealed)

    @property
    def names_right(self) -> tuple[bool, ...]:
        """Which of the names stand for something that was concealed."""
        return tuple(any(self.matches(name, id) for id in self.concealed) for name in self.named)

    @property
    def is_exact(self) -> bool:
        """Whether everything was named and nothing besides."""
        return all(self.effects_found) and all(self.names_right)

    def format_line(self) -> str:
        """One line of a file, without what is as in any trial."""
        values = asdict(self)
        return json.dumps(
            {k: v for k, v in values.items() if v != _DEFAULT_VALUES.get(k, ...)}, allow_nan=False
        )


_DEFAULT_VALUES = asdict(Trial("", "", math.nan, -1, -1, "", ""))


def parse_trial(line: str) -> Trial:
    """A trial from its line."""
    document = json.loads(line)
    known = {f.name for f in fields(Trial)}
    values = {k: _convert_to_tuples(v) for k, v in document.items() if k in known and k != "numbers"}
    return Trial(
        **values, numbers=tuple(RecoveredParameter(**parameter) for parameter in document.get("numbers", ()))
    )


def _convert_to_tuples(value: Any) -> Any:
    return tuple(_convert_to_tuples(v) for v in value) if isinstance(value, list) else value


def run_trial(task: TrialTask) -> Trial:
    """Draw an envelope, diagnose what the lab would see, open it."""
    start_time = time.process_time()
    ground_truth = draw_ground_truth(task)
    values: dict[str, Any] = {
        "stage": task.stage, "kind": task.kind, "correlation": task.correlation,
        "number": task.number, "seed": task.seed, "form_error": task.form_error,
        "law": ground_truth.case.entry.baseline,
        "blocks": find_blocks(ground_truth.case.recording).kind,
        "concealed": ground_truth.effect_ids, "sizes": ground_truth.effect_sizes,
    }  # fmt: skip
    try:
        if task.stage == "score":
            values["p_value"] = score_recording(ground_truth.case, task.number).p_value
        else:
            values |= _compare_with_truth(
                ground_truth, diagnose(ground_truth.case, seed=task.number), task.with_baselines
            )
    except Exception as error:  # one recording that breaks the tool is a result of the proof, not its end
        values["error"] = f"{type(error).__name__}: {error}"[:300]
    return Trial(**values, seconds=round(time.process_time() - start_time, 2))


def draw_ground_truth(task: TrialTask) -> GroundTruth:
    """The envelope of a task."""
    words = [task.seed, list(TRIAL_KINDS).index(task.kind), task.number, round(1e3 * task.correlation)]
    rng = np.random.default_rng(words)
    return inject_effects(
        TRIAL_KINDS[task.kind], rng, setup=draw_setup(rng), unmodelled=task.kind == "outside",
        correlation=task.correlation, smallest=MIN_EFFECT_SD, largest=MAX_EFFECT_SD,
        form_error=task.form_error, number=task.number,
    )  # fmt: skip


def score_recording(case: Case, seed: int = 0) -> Significance:
    """The baseline's own fit and its p-value, before anything is named."""
    problem = build_library_problem(case)
    training_rows = ~select_held_out_rows(find_blocks(case.recording))
    baseline = fit_candidate(problem, training_rows, (), problem.neutral)
    directions = compute_score_directions(
        problem, baseline.noise, baseline.estimate, build_candidates(problem)
    )
    return compute_significance(problem, baseline.noise, baseline.estimate, directions, seed)


def _compare_with_truth(
    ground_truth: GroundTruth, diagnosis: Diagnosis, with_baselines: bool
) -> dict[str, Any]:
    names = diagnosis.selection.established
    noise = _compute_noise_sd(diagnosis)
    values: dict[str, Any] = {
        "p_value": diagnosis.mismatch.p_value,
        "named": tuple(name.id for name in names),
        "ties": tuple(tuple(name.indistinguishable) for name in names),
        "probabilities": tuple(float(name.probability) for name in names),
        "stand_ins": _find_indistinguishable(ground_truth, diagnosis),
        "unexplained": diagnosis.unexplained,
        "before": _divide_by_noise(diagnosis, diagnosis.gain.rmse_before, noise),
        "after": _divide_by_noise(diagnosis, diagnosis.gain.rmse_after, noise),
        "numbers": tuple(_compare_parameters(ground_truth, diagnosis)),
    }
    axes = build_axes(diagnosis.problem)
    boxes = compute_true_boxes(axes, ground_truth.effects, noise)
    if boxes:
        claims = diagnosis.mismatch_boxes if diagnosis.detected else []
        values |= {
            "iou": compute_overlap(axes, claims, boxes),
            "iou_blind": compute_blind_overlap(axes, boxes),
        }
    return values | (_fit_baselines(diagnosis, noise) if with_baselines else {})


def _compute_noise_sd(diagnosis: Diagnosis) -> np.ndarray:
    """(2, n) effective noise of every sample, SI."""
    out = np.ones((len(CHANNELS), diagnosis.problem.n))
    for c, channel in enumerate(diagnosis.model.noise.channels):
        if channel is not None:
            out[c] = np.broadcast_to(channel.sd, diagnosis.problem.n)
    return out


def _divide_by_noise(diagnosis: Diagnosis, rmse: dict[str, float], noise: np.ndarray) -> dict[str, float]:
    out = {}
    for c, channel in enumerate(CHANNELS):
        rows = diagnosis.gain.held_out & np.isfinite(diagnosis.problem.measured[c])
        if channel in rmse and rows.any():
            out[channel] = rmse[channel] / float(np.sqrt(np.mean(noise[c][rows] ** 2)))
    return out


def _find_indistinguishable(ground_truth: GroundTruth, diagnosis: Diagnosis) -> tuple[tuple[str, str], ...]:
    """Which of what was said, and was not concealed, this recording cannot tell from what was."""
    effect_ids = [candidate.id for candidate in ground_truth.candidates]
    reported_ids = {
        id for name in diagnosis.named_mechanisms for id in (name.id, *name.indistinguishable)
    } - set(effect_ids)
    return tuple(
        (id, other)
        for id in effect_ids
        for other in sorted(reported_ids)
        if is_indistinguishable(diagnosis.problem, ground_truth, id, other)
    )


def _compare_parameters(ground_truth: GroundTruth, diagnosis: Diagnosis) -> list[RecoveredParameter]:
    """The numbers of right names, and of the baseline, beside the true ones."""
    problem, out = diagnosis.problem, []
    free_by_effect = {candidate.id: set(candidate.free_parameters) for candidate in ground_truth.candidates}
    free_by_mechanism = {
        candidate.id: set(candidate.free_parameters) for candidate in diagnosis.model.mechanisms
    }
    for id, numbers in diagnosis.parameters.items():
        for word, number in numbers.items() if id in free_by_effect else ():
            name = f"{id}.{word}"
            same = free_by_effect[id] == free_by_mechanism[id]
            out.append(_build_recovered(ground_truth, name, number.value, number.sd, same))
    exact = set(free_by_effect) == set(free_by_mechanism)
    # What noise made of a held length has no true number.
    for k in (
        k
        for k in np.flatnonzero(problem.is_baseline).tolist()
        if problem.names[k] in ground_truth.true_values
    ):
        out.append(
            _build_recovered(
                ground_truth,
                problem.names[k],
                diagnosis.model.estimate.values[k],
                diagnosis.model.sd(k),
                exact,
            )
        )
    return [number for number in out if np.isfinite([number.true, number.value, number.sd]).all()]


def _build_recovered(
    ground_truth: GroundTruth, name: str, value: float, sd: float, same: bool
) -> RecoveredParameter:
    return RecoveredParameter(
        name, float(ground_truth.true_values[name]), float(value), float(sd), bool(same)
    )


def _fit_baselines(diagnosis: Diagnosis, noise: np.ndarray) -> dict[str, Any]:
    problem, training_rows, out = diagnosis.problem, ~diagnosis.gain.held_out, {}
    selection = select_by_bic(problem, training_rows)
    out["selected"] = selection.ids
    before = diagnosis.gain.before[0]
    curve = before + predict_discrepancy(build_inputs(problem), problem.measured[0] - before, training_rows)
    rows = diagnosis.gain.held_out & np.isfinite(problem.measured[0])
    if rows.any():
        floor = float(np.sqrt(np.mean(noise[0][rows] ** 2)))
        for word, force in (("selected_after", selection.force), ("curve_after", curve)):
            out[word] = float(np.sqrt(np.mean((problem.measured[0] - force)[rows] ** 2))) / floor
    return out
