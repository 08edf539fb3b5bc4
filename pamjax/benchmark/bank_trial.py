"""One trial of the bank of other forms: a recording, its diagnosis, and the comparison with its key.

A name counts as right if its id is concealed, or if the diagnosis lists a concealed id among its
indistinguishable ids. The true parameters of another form have no counterpart in the fit. Therefore only
offsets, gains and delays compare their parameters.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from pamjax.benchmark.other_forms.case_files import build_bank_case
from pamjax.benchmark.other_forms.draw import BANK_KINDS, BankRecording, draw_bank_recording
from pamjax.benchmark.trial import RecoveredParameter, Trial, TrialTask, diagnose_trial
from pamjax.diagnosis.crossval.held_out_ratios import compute_held_out_ratios
from pamjax.diagnosis.result import Diagnosis
from pamjax.diagnosis.unexplained import compute_unexplained_probability, state_unexplained_reason
from pamjax.records.blocks import find_blocks


def draw_task_recording(task: TrialTask) -> BankRecording:
    """Draw the recording of a task; the same task gives the same recording."""
    words = [task.seed, list(BANK_KINDS).index(task.kind), task.trial_index, round(1e3 * task.correlation)]
    return draw_bank_recording(task.kind, task.correlation, np.random.default_rng(words))


def run_bank_trial(task: TrialTask) -> Trial:
    """Simulate the recording of a task, diagnose it, and compare with what it conceals."""
    start_time = time.process_time()
    bank_recording = draw_task_recording(task)
    case = build_bank_case(bank_recording, f"{task.kind}-{task.trial_index}")
    mechanisms = [effect for effect in bank_recording.effects if effect.in_library]
    outside = [effect for effect in bank_recording.effects if not effect.in_library]
    values: dict[str, Any] = {
        "stage": task.stage, "kind": task.kind, "correlation": task.correlation,
        "trial_index": task.trial_index, "seed": task.seed, "bank": task.bank,
        "law": case.muscle_toml.baseline, "blocks": find_blocks(case.recording).kind,
        "misstated": bank_recording.misstated,
        "concealed": tuple(effect.id for effect in mechanisms),
        "forms": tuple(effect.form for effect in mechanisms),
        "sizes": tuple(effect.size for effect in mechanisms),
        "outside": outside[0].id if outside else "", "outside_size": outside[0].size if outside else 0.0,
    }  # fmt: skip
    try:
        values |= _compare_with_key(bank_recording, diagnose_trial(case, task))
    except Exception as error:  # a failed diagnosis is a result of the study
        values["error"] = f"{type(error).__name__}: {error}"[:300]
    return Trial(**values, seconds=round(time.process_time() - start_time, 2))


def _compare_with_key(bank_recording: BankRecording, diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the fields of a trial that a diagnosis determines."""
    names = diagnosis.named_mechanisms
    concealed_ids = {effect.id for effect in bank_recording.effects if effect.in_library}
    named_ids = tuple(name.id for name in names)
    ties = tuple(tuple(name.indistinguishable) for name in names)
    return {
        "p_value": diagnosis.baseline_test.p_value,
        "named": named_ids,
        "ties": ties,
        "probabilities": tuple(float(name.probability) for name in names),
        "reported_ties": find_reported_ties(concealed_ids, named_ids, ties),
        "unexplained": bool(diagnosis.unexplained),
        "unexplained_probability": compute_unexplained_probability(diagnosis),
        "unexplained_reason": state_unexplained_reason(diagnosis),
        "parameters": tuple(_compare_usual_parameters(bank_recording, diagnosis)),
        "held_out_ratios": _list_held_out_ratios(diagnosis),
        "residual_share": round(float(diagnosis.residual_share), 4),
    }


def find_reported_ties(
    concealed_ids: set[str], named_ids: tuple[str, ...], ties: tuple[tuple[str, ...], ...]
) -> tuple[tuple[str, str], ...]:
    """Return the (concealed, named) pairs of ids in which the concealed one is a tie of the named one.

    >>> find_reported_ties({"force_gain"}, ("pressure_gain", "end_taper"), (("force_gain",), ()))
    (('force_gain', 'pressure_gain'),)
    """
    return tuple(
        (tie, name)
        for name, tied_ids in zip(named_ids, ties, strict=True)
        for tie in tied_ids
        if tie in concealed_ids and name not in concealed_ids
    )


def _compare_usual_parameters(
    bank_recording: BankRecording, diagnosis: Diagnosis
) -> list[RecoveredParameter]:
    """Return the parameters of correct mechanisms whose form is that of the fit, with their true values."""
    out = []
    for effect in bank_recording.effects:
        estimate = diagnosis.parameters.get(effect.id, {}).get(effect.amplitude)
        if effect.form != "usual" or estimate is None:
            continue
        name, true = f"{effect.id}.{effect.amplitude}", effect.parameters[effect.amplitude]
        # An estimate at a limit has no sd. The coverage of the intervals counts it with that of the fit.
        sd = diagnosis.model.sd(diagnosis.problem.index(name))
        if math.isfinite(estimate.value + sd):
            out.append(RecoveredParameter(name, true, float(estimate.value), sd, True))
    return out


def _list_held_out_ratios(diagnosis: Diagnosis) -> tuple[float, ...]:
    """Return for each named mechanism the held-out error with it over that without it."""
    names = [name.id for name in diagnosis.named_mechanisms]
    ratios = compute_held_out_ratios(
        diagnosis.problem,
        ~diagnosis.held_out_errors.held_out_mask,
        [m for m in diagnosis.model.mechanisms if m.id in names],
        diagnosis.model.estimate.values,
    )
    return tuple(ratios[id] for id in names) if ratios else ()
