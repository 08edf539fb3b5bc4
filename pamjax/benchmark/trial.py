"""A trial: one simulated recording, its diagnosis, and the comparison with the injected effects."""

from __future__ import annotations

import json
import math
import time
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from pamjax.baselines.gaussian_process import build_inputs, predict_discrepancy
from pamjax.baselines.stepwise_bic import select_by_bic
from pamjax.benchmark.indistinguishable import is_indistinguishable
from pamjax.benchmark.inject_effect import GroundTruth, inject_effects
from pamjax.benchmark.overlap import compute_blind_overlap, compute_overlap, compute_true_regions
from pamjax.benchmark.setups import draw_setup
from pamjax.diagnosis.detect.recording_axes import build_axes
from pamjax.diagnosis.detect.residual_test import run_baseline_test
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case

#: Kinds of recordings with the number of effects; "outside" has one effect outside the library.
TRIAL_KINDS = {"nothing": 0, "single": 1, "pair": 2, "triple": 3, "outside": 1}

#: Stages: the whole diagnosis, or only the p-value of the baseline.
_TRIAL_STAGES = ("all", "score")

#: Range of effects, rms in noise standard deviations: just detectable to large.
_MIN_EFFECT_SD, _MAX_EFFECT_SD = 3.0, 25.0

#: Banks of simulated recordings: effects with the equations of the fit, or in other forms.
_BANKS = ("own", "other-forms")

#: Identifies a trial: stage, kind, correlation, index, seed, form error, bank.
TrialKey = tuple[str, str, float, int, int, float, str]


@dataclass(frozen=True)
class TrialTask:
    """Definition of a trial; the same task gives the same recording.

    Attributes:
        stage: one of `_TRIAL_STAGES`.
        kind: a key of `TRIAL_KINDS`.
        correlation: noise correlation of neighbouring samples.
        trial_index: index of the recording, from 0.
        seed: seed of the study.
        with_competitors: whether to evaluate the methods of common practice too.
        form_error: rms share by which effects deviate from their equations.
        bank: one of `_BANKS`.
    """

    stage: str
    kind: str
    correlation: float
    trial_index: int
    seed: int = 0
    with_competitors: bool = False
    form_error: float = 0.0
    bank: str = "own"

    @property
    def key(self) -> TrialKey:
        """Return the key that identifies the trial."""
        return (
            self.stage, self.kind, round(self.correlation, 6), self.trial_index, self.seed,
            round(self.form_error, 6), self.bank,
        )  # fmt: skip


@dataclass(frozen=True)
class RecoveredParameter:
    """A parameter, SI: true value, estimate, sd; `same`: the true model has the same free parameters."""

    name: str
    true: float
    value: float
    sd: float
    same: bool


@dataclass(frozen=True)
class Trial:
    """Result of one simulated recording.

    Attributes:
        stage, kind, correlation, trial_index, seed, form_error, bank: as in its task.
        law: thread law of the baseline.
        blocks: kind of the recording's blocks.
        concealed: ids of the injected effects.
        sizes: effect sizes in noise standard deviations.
        p_value: p-value of the misfit of the baseline.
        named: ids of the identified mechanisms, most probable first.
        ties: ids of the indistinguishable rivals of each.
        probabilities: probabilities of the identified mechanisms.
        verified_ties: (injected, reported) pairs of ids that are truly indistinguishable on this recording;
            in the own bank only.
        reported_ties: (concealed, named) pairs of ids in which the diagnosis reports the concealed one as a
            tie; in the bank of other forms only.
        unexplained: whether the diagnosis reports an unexplained misfit.
        unexplained_probability: that an effect outside the library is present, in the bank of other forms.
        unexplained_reason: the clause that states why a part is unexplained, in that bank, or "".
        before, after: held-out rmse over effective noise by channel, of the baseline and of the final model.
        iou: overlap of the located region with a true region; None without a true region.
        iou_blind: overlap of a region over the whole recording.
        parameters: parameters of right mechanisms and of the baseline.
        selected: ids selected by BIC with independent noise; None if not evaluated.
        selected_after, curve_after: held-out rmse of force over noise, of that selection and of a Gaussian
            process.
        seconds: processor time, s.
        error: error message if the diagnosis failed, or "".
        forms: form of each concealed mechanism, in the bank of other forms.
        outside: family of the effect outside the library in that bank, or "".
        outside_size: its size in noise standard deviations.
        misstated: whether the sensors differ from muscle.toml.
        held_out_ratios: held-out error with each identified mechanism over that without it.
        residual_share: share of the misfit that the final model leaves, in the bank of other forms.
    """

    stage: str
    kind: str
    correlation: float
    trial_index: int
    seed: int
    law: str
    blocks: str
    concealed: tuple[str, ...] = ()
    sizes: tuple[float, ...] = ()
    p_value: float = 1.0
    named: tuple[str, ...] = ()
    ties: tuple[tuple[str, ...], ...] = ()
    probabilities: tuple[float, ...] = ()
    verified_ties: tuple[tuple[str, str], ...] = ()
    reported_ties: tuple[tuple[str, str], ...] = ()
    unexplained: bool = False
    unexplained_probability: float = 0.0
    unexplained_reason: str = ""
    before: dict[str, float] = field(default_factory=dict)
    after: dict[str, float] = field(default_factory=dict)
    iou: float | None = None
    iou_blind: float | None = None
    parameters: tuple[RecoveredParameter, ...] = ()
    selected: tuple[str, ...] | None = None
    selected_after: float | None = None
    curve_after: float | None = None
    form_error: float = 0.0
    seconds: float = 0.0
    error: str = ""
    bank: str = "own"
    forms: tuple[str, ...] = ()
    outside: str = ""
    outside_size: float = 0.0
    misstated: bool = False
    held_out_ratios: tuple[float, ...] = ()
    residual_share: float = 0.0

    @property
    def key(self) -> TrialKey:
        """Return the key of its task."""
        return TrialTask(
            self.stage, self.kind, self.correlation, self.trial_index, self.seed, form_error=self.form_error,
            bank=self.bank,
        ).key  # fmt: skip

    @property
    def is_detected(self) -> bool:
        """Return whether the misfit of the baseline is significant."""
        return self.p_value < DEFAULT_SETTINGS.detection_p_value

    @property
    def is_alarm(self) -> bool:
        """Return whether the diagnosis reports any misfit."""
        return self.is_detected or bool(self.named) or self.unexplained

    def matches(self, name: str, concealed_id: str) -> bool:
        """Return whether a mechanism is the injected one, or counts as its tie on this recording."""
        return name == concealed_id or (concealed_id, name) in self.verified_ties + self.reported_ties

    @property
    def effects_found(self) -> tuple[bool, ...]:
        """Return whether each injected effect is identified."""
        return tuple(any(self.matches(name, id) for name in self.named) for id in self.concealed)

    @property
    def names_right(self) -> tuple[bool, ...]:
        """Return whether each identified mechanism is right."""
        return tuple(any(self.matches(name, id) for id in self.concealed) for name in self.named)

    @property
    def is_exact(self) -> bool:
        """Return whether exactly the injected effects are identified."""
        return all(self.effects_found) and all(self.names_right)

    def format_line(self) -> str:
        """Return the trial as one JSON line without default values."""
        values = {k: v for k, v in asdict(self).items() if v != _DEFAULT_VALUES.get(k, ...)}
        return json.dumps({_FILE_KEYS.get(k, k): v for k, v in values.items()}, allow_nan=False)


#: Keys of trials.jsonl that differ from the fields: earlier names, kept so that published files stay
#: readable. A bank has only one of the two kinds of ties.
_FILE_KEYS = {
    "trial_index": "number", "parameters": "numbers",
    "verified_ties": "stand_ins", "reported_ties": "stand_ins",
}  # fmt: skip

_DEFAULT_VALUES = asdict(Trial("", "", math.nan, -1, -1, "", ""))


def parse_trial(line: str) -> Trial:
    """Return the trial of a JSON line."""
    document = json.loads(line)
    absent_ties = "reported_ties" if document.get("bank", "own") == "own" else "verified_ties"
    names = {_FILE_KEYS.get(f.name, f.name): f.name for f in fields(Trial) if f.name != absent_ties}
    values = {names[k]: _convert_to_tuples(v) for k, v in document.items() if k in names and k != "numbers"}
    parameters = tuple(RecoveredParameter(**parameter) for parameter in document.get("numbers", ()))
    return Trial(**values, parameters=parameters)


def _convert_to_tuples(value: Any) -> Any:
    return tuple(_convert_to_tuples(v) for v in value) if isinstance(value, list) else value


def run_trial(task: TrialTask) -> Trial:
    """Simulate the recording of a task, diagnose it, and compare with the injected effects."""
    start_time = time.process_time()
    ground_truth = draw_ground_truth(task)
    values: dict[str, Any] = {
        "stage": task.stage, "kind": task.kind, "correlation": task.correlation,
        "trial_index": task.trial_index, "seed": task.seed, "form_error": task.form_error,
        "law": ground_truth.case.muscle_toml.baseline,
        "blocks": find_blocks(ground_truth.case.recording).kind,
        "concealed": ground_truth.effect_ids, "sizes": ground_truth.effect_sizes,
    }  # fmt: skip
    try:
        if task.stage == "score":
            values["p_value"] = score_recording(ground_truth.case, task.trial_index).p_value
        else:
            values |= _compare_with_truth(
                ground_truth, diagnose_trial(ground_truth.case, task), task.with_competitors
            )
    except Exception as error:  # a failed diagnosis is a result of the study
        values["error"] = f"{type(error).__name__}: {error}"[:300]
    return Trial(**values, seconds=round(time.process_time() - start_time, 2))


def diagnose_trial(case: Case, task: TrialTask) -> Diagnosis:
    """Return the diagnosis of a recording with the seed of its task."""
    return diagnose(case, seed=task.trial_index)


def draw_ground_truth(task: TrialTask) -> GroundTruth:
    """Simulate the recording of a task with its injected effects."""
    words = [task.seed, list(TRIAL_KINDS).index(task.kind), task.trial_index, round(1e3 * task.correlation)]
    rng = np.random.default_rng(words)
    return inject_effects(
        TRIAL_KINDS[task.kind], rng, setup=draw_setup(rng), unmodelled=task.kind == "outside",
        correlation=task.correlation, smallest=_MIN_EFFECT_SD, largest=_MAX_EFFECT_SD,
        form_error=task.form_error, number=task.trial_index,
    )  # fmt: skip


def score_recording(case: Case, seed: int = 0) -> ResidualTest:
    """Return the significance of the baseline's misfit, without a selection of mechanisms."""
    problem = build_library_problem(case)
    return run_baseline_test(problem, problem.neutral, seed)


def _compare_with_truth(
    ground_truth: GroundTruth, diagnosis: Diagnosis, with_competitors: bool
) -> dict[str, Any]:
    names = diagnosis.named_mechanisms
    noise = _compute_noise_sd(diagnosis)
    values: dict[str, Any] = {
        "p_value": diagnosis.baseline_test.p_value,
        "named": tuple(name.id for name in names),
        "ties": tuple(tuple(name.indistinguishable) for name in names),
        "probabilities": tuple(float(name.probability) for name in names),
        "verified_ties": _find_indistinguishable(ground_truth, diagnosis),
        "unexplained": diagnosis.unexplained,
        "before": _divide_by_noise(diagnosis, diagnosis.held_out_errors.baseline_rmse, noise),
        "after": _divide_by_noise(diagnosis, diagnosis.held_out_errors.model_rmse, noise),
        "parameters": tuple(_compare_parameters(ground_truth, diagnosis)),
    }
    axes = build_axes(diagnosis.problem)
    regions = compute_true_regions(axes, ground_truth.effects, noise)
    if regions:
        claims = diagnosis.misfit_regions if diagnosis.is_detected else []
        values |= {
            "iou": compute_overlap(axes, claims, regions),
            "iou_blind": compute_blind_overlap(axes, regions),
        }
    return values | (_fit_competitors(diagnosis, noise) if with_competitors else {})


def _compute_noise_sd(diagnosis: Diagnosis) -> np.ndarray:
    """Return the effective noise of every sample, (2, n), SI."""
    out = np.ones((len(CHANNELS), diagnosis.problem.n))
    for c, channel in enumerate(diagnosis.model.noise.by_channel):
        if channel is not None:
            out[c] = np.broadcast_to(channel.sd, diagnosis.problem.n)
    return out


def _divide_by_noise(diagnosis: Diagnosis, rmse: dict[str, float], noise: np.ndarray) -> dict[str, float]:
    out = {}
    for c, channel in enumerate(CHANNELS):
        rows = diagnosis.held_out_errors.held_out_mask & np.isfinite(diagnosis.problem.measured[c])
        if channel in rmse and rows.any():
            out[channel] = rmse[channel] / float(np.sqrt(np.mean(noise[c][rows] ** 2)))
    return out


def _find_indistinguishable(ground_truth: GroundTruth, diagnosis: Diagnosis) -> tuple[tuple[str, str], ...]:
    """Return (injected, reported) pairs of ids that are indistinguishable on this recording."""
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
    """Return the parameters of right mechanisms and of the baseline with their true values."""
    problem, out = diagnosis.problem, []
    free_by_effect = {candidate.id: set(candidate.free_parameters) for candidate in ground_truth.candidates}
    free_by_mechanism = {
        candidate.id: set(candidate.free_parameters) for candidate in diagnosis.model.mechanisms
    }
    for id, numbers in diagnosis.parameters.items():
        for word, number in numbers.items() if id in free_by_effect else ():
            name = f"{id}.{word}"
            is_same_model = free_by_effect[id] == free_by_mechanism[id]
            # An estimate at a limit has no sd. The coverage of the intervals counts it with that of the fit.
            sd = diagnosis.model.sd(problem.index(name))
            out.append(_build_recovered(ground_truth, name, number.value, sd, is_same_model))
    exact = set(free_by_effect) == set(free_by_mechanism)
    # Length errors of fixed lengths have no true value.
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
    ground_truth: GroundTruth, name: str, value: float, sd: float, is_same_model: bool
) -> RecoveredParameter:
    return RecoveredParameter(
        name, float(ground_truth.true_values[name]), float(value), float(sd), bool(is_same_model)
    )


def _fit_competitors(diagnosis: Diagnosis, noise: np.ndarray) -> dict[str, Any]:
    problem, training_mask, out = diagnosis.problem, ~diagnosis.held_out_errors.held_out_mask, {}
    selection = select_by_bic(problem, training_mask)
    out["selected"] = selection.ids
    baseline = diagnosis.held_out_errors.baseline_prediction[0]
    curve = baseline + predict_discrepancy(
        build_inputs(problem), problem.measured[0] - baseline, training_mask
    )
    rows = diagnosis.held_out_errors.held_out_mask & np.isfinite(problem.measured[0])
    if rows.any():
        floor = float(np.sqrt(np.mean(noise[0][rows] ** 2)))
        for word, force in (("selected_after", selection.force), ("curve_after", curve)):
            out[word] = float(np.sqrt(np.mean((problem.measured[0] - force)[rows] ** 2))) / floor
    return out
