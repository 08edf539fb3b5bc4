"""Result of a diagnosis, its summary on the screen, and its files diagnosis.json and prediction.csv."""

from __future__ import annotations

import io
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.crossval.held_out_errors import HeldOutErrors, compute_rmse
from pamjax.diagnosis.detect.locate import MisfitRegion
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.estimates import ParameterEstimate, ParameterShift, build_parameter_estimate
from pamjax.diagnosis.form_errors.prediction import ModelPrediction
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.next_experiment.experiment import Experiment
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.saved_model import build_model_document
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.diagnosis.select.selection import Selection
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.diagnosis.templates.template_fits import Likeness
from pamjax.diagnosis.unexplained import (
    UnexplainedReason,
    compute_unexplained_probability,
    state_unexplained_reason,
)
from pamjax.drawing import DrawableResult
from pamjax.infer.form_errors.form_model import FormErrorModel
from pamjax.infer.form_errors.parts import FormErrorPart
from pamjax.model.registry import find_mechanism
from pamjax.notebook import NotebookText
from pamjax.parameter import get_display_unit
from pamjax.records.blocks import Blocks
from pamjax.records.files import write_atomically

_DIAGNOSIS_SCHEMA = "pamjax.diagnosis/1"


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(DrawableResult, NotebookText):
    """Result of a diagnosis.

    Attributes:
        problem: the recording and the library.
        selection: the identified mechanisms, from the rows that are not held out.
        model: the model with the identified mechanisms, refitted to all rows.
        baseline: the baseline, refitted to all rows.
        baseline_test: test of the baseline's residual.
        misfit_regions: location of the misfit.
        residual_test: test of the residual of `model`.
        unexplained: whether a part of the misfit is explained by no mechanism of the library.
        likenesses: effects outside the library that this part resembles, most probable first.
        residual_regions: location of the unexplained part.
        residual_share: unexplained share of the excess misfit.
        noise_ratios: by channel, estimated over stated noise sd; None if no noise is stated.
        blocks: the blocks of the recording.
        held_out_errors: errors on held-out blocks, without and with the mechanisms.
        parameters: estimates by mechanism id and parameter name, amplitude first.
        parameter_shifts: baseline parameters without and with the mechanisms.
        notes: warnings of the case, parameters that are not determined, and parameters at their limits.
        experiments: proposed next experiments.
        unexplained_reason: why a part is unexplained; None if nothing is unexplained.
        form_errors: form errors by mechanism id; mechanisms without form error are absent.
        form_prediction: prediction with the estimated form errors; None if their most likely size is zero.
        form_error_model: form errors for other recordings, a part of model.json; None if there are none.
    """

    problem: LibraryProblem
    selection: Selection
    model: ModelFit
    baseline: ModelFit
    baseline_test: ResidualTest
    misfit_regions: list[MisfitRegion]
    residual_test: ResidualTest
    unexplained: bool
    likenesses: tuple[Likeness, ...]
    residual_regions: list[MisfitRegion]
    residual_share: float
    noise_ratios: dict[str, float | None]
    blocks: Blocks
    held_out_errors: HeldOutErrors
    parameters: dict[str, dict[str, ParameterEstimate]]
    parameter_shifts: dict[str, ParameterShift]
    notes: list[str]
    experiments: list[Experiment]
    unexplained_reason: UnexplainedReason | None = None
    form_errors: dict[str, FormErrorPart] = field(default_factory=dict)
    form_prediction: ModelPrediction | None = None
    form_error_model: FormErrorModel | None = None

    @property
    def settings(self) -> DiagnosisSettings:
        """Return the thresholds of the diagnosis."""
        return self.problem.settings

    @property
    def named_mechanisms(self) -> tuple[NamedMechanism, ...]:
        """Return the named mechanisms, most probable first; cross-validation dropped the improbable ones."""
        return self.selection.named_mechanisms

    @property
    def fails_held_out(self) -> bool:
        """Return whether the error on held-out blocks is far above the expected one."""
        ratio = self.held_out_errors.largest_error_ratio
        return bool(self.named_mechanisms) and ratio > self.settings.max_held_out_error_ratio

    @property
    def is_detected(self) -> bool:
        """Return whether the misfit of the baseline is significant."""
        return bool(self.baseline_test.p_value < self.settings.detection_p_value)

    @property
    def is_faint(self) -> bool:
        """Return whether the misfit is significant, but too small to identify a mechanism or unexplained."""
        return self.is_detected and not self.named_mechanisms and not self.unexplained

    def as_dict(self) -> dict[str, Any]:
        """Return the result as `pamjax.diagnosis/1`, the content of diagnosis.json."""
        return {
            "schema": _DIAGNOSIS_SCHEMA,
            "case": self.problem.case.name,
            "baseline": {
                "model": self.problem.law,
                "parameters": {n: _serialise_estimate(v) for n, v in get_baseline_estimates(self).items()},
                "rmse": {c: _serialise_channel_value(c, v) for c, v in _compute_baseline_rmse(self).items()},
            },
            "noise": _serialise_noise(self),
            "mismatch": {
                "detected": self.is_detected,
                "p_value": self.baseline_test.p_value,
                "where": [_serialise_region(b) for b in self.misfit_regions] if self.is_detected else [],
            },
            "missing_physics": [_serialise_mechanism(self, mechanism) for mechanism in self.named_mechanisms],
            "unexplained": {
                "detected": self.unexplained,
                "probability": compute_unexplained_probability(self),
                "p_value": self.residual_test.p_value,
                "share": self.residual_share,
                "reason": state_unexplained_reason(self),
                "likeness": [
                    {"id": likeness.id, "probability": likeness.probability, "says": likeness.description}
                    for likeness in (self.likenesses if self.unexplained else ())
                ],
                "where": [_serialise_region(b) for b in self.residual_regions] if self.unexplained else [],
            },
            "improvement": {
                "held_out": {"blocks": self.held_out_errors.block_description}
                | _serialise_held_out_errors(self.held_out_errors)
            },
            "parameters_moved": {n: _serialise_shift(m) for n, m in self.parameter_shifts.items()},
            "next_experiment": [e.as_dict() for e in self.experiments],
        }

    def to_frame(self) -> pd.DataFrame:
        """Return the parameters of the named mechanisms as a table, in display units, by name.

        Columns: value, sd (NaN at a limit), unit, at_limit, and the probability of the mechanism. The index
        has names such as "braid_friction.coefficient".
        """
        rows = {}
        for mechanism in self.named_mechanisms:
            for name, estimate in self.parameters[mechanism.id].items():
                scale, unit = get_display_unit(estimate.meaning)
                rows[f"{mechanism.id}.{name}"] = {
                    "value": estimate.value / scale,
                    "sd": estimate.sd / scale,
                    "unit": unit,
                    "at_limit": estimate.at_limit,
                    "probability": mechanism.probability,
                }
        columns = ["value", "sd", "unit", "at_limit", "probability"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    def save(self, folder: str | Path) -> list[Path]:
        """Write diagnosis.json, prediction.csv and model.json into a folder, and return their paths."""
        return save_diagnosis(self, Path(folder))

    def predictions(self) -> pd.DataFrame:
        """Return the predictions of each row without and with the mechanisms, as in prediction.csv.

        Predictions of held-out rows come from fits without these rows.
        """
        recording, errors = self.problem.case.recording, self.held_out_errors
        columns: dict[str, Any] = {
            "row": recording.row,
            "block": [self.blocks.names[k] if k >= 0 else "" for k in self.blocks.label],
            "held_out": errors.held_out_mask.astype(int),
        }
        for c, channel in enumerate(self.problem.channels):
            for suffix, prediction in (
                ("before", errors.baseline_prediction),
                ("after", errors.model_prediction),
            ):
                columns[f"{channel}_{suffix} [{DISPLAY_UNIT[channel]}]"] = to_display(channel, prediction[c])
        return pd.DataFrame(columns)

    def __str__(self) -> str:
        from pamjax.diagnosis.summary import format_summary

        return format_summary(self)


def save_diagnosis(diagnosis: Diagnosis, folder: Path) -> list[Path]:
    """Write diagnosis.json, prediction.csv and model.json, each atomically, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    document = json.dumps(diagnosis.as_dict(), indent=1, allow_nan=False) + "\n"
    table = io.StringIO()
    diagnosis.predictions().to_csv(table, index=False, float_format="%.6g")
    model = build_model_document(diagnosis.problem, diagnosis.model, diagnosis.form_error_model)
    files = {
        "diagnosis.json": document,
        "prediction.csv": table.getvalue(),
        "model.json": json.dumps(model, indent=1, allow_nan=False) + "\n",
    }
    for name, text in files.items():
        with write_atomically(folder / name) as temporary:
            temporary.write_text(text)
    return [folder / name for name in files]


def get_baseline_estimates(diagnosis: Diagnosis) -> dict[str, ParameterEstimate]:
    """Return the estimates of the baseline's parameters by name."""
    return {
        diagnosis.problem.names[k]: build_parameter_estimate(diagnosis.problem, diagnosis.baseline, k)
        for k in diagnosis.baseline.estimate.free
    }


def _serialise_estimate(estimate: ParameterEstimate) -> dict[str, Any]:
    scale, unit = get_display_unit(estimate.meaning)
    return {"value": estimate.value / scale, "sd": _replace_non_finite(estimate.sd / scale), "unit": unit}


def _replace_non_finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _serialise_channel_value(channel: str, value: float) -> dict[str, Any]:
    return {"value": to_display(channel, value), "unit": DISPLAY_UNIT[channel]}


def _compute_baseline_rmse(diagnosis: Diagnosis) -> dict[str, float]:
    problem = diagnosis.problem
    prediction = problem.predict(diagnosis.baseline.estimate.values)
    return compute_rmse(problem, prediction, np.ones(problem.n, dtype=bool))


def _serialise_noise(diagnosis: Diagnosis) -> dict[str, Any]:
    out = {}
    for c, channel in enumerate(diagnosis.problem.channels):
        channel_noise, rows = diagnosis.model.noise.by_channel[c], diagnosis.model.noise.rows[c]
        if channel_noise is None:
            continue
        out[channel] = {
            "sd": to_display(channel, diagnosis.model.noise.compute_rms_sd(c)),
            "unit": DISPLAY_UNIT[channel],
            "correlation_time_s": _compute_correlation_time(
                diagnosis.problem, rows, channel_noise.correlation
            ),
            "over_stated": diagnosis.noise_ratios.get(channel),
        }
    return out


def _compute_correlation_time(problem: LibraryProblem, rows: np.ndarray, correlation: float) -> float:
    time = problem.case.recording.time
    if time is None or correlation <= 0 or rows.size < 2:
        return 0.0
    return float(-np.median(np.diff(time[rows])) / math.log(correlation))


def _serialise_region(region: MisfitRegion) -> dict[str, Any]:
    return {
        "channel": region.channel,
        "direction": region.motion,
        "pressure_kPa": [p / 1e3 for p in region.pressure],
        "contraction": list(region.contraction),
        "time_s": list(region.time),
        "share": region.share,
        "says": region.description,
    }


def _serialise_mechanism(diagnosis: Diagnosis, mechanism: NamedMechanism) -> dict[str, Any]:
    about = find_mechanism(mechanism.id).about
    return {
        "id": mechanism.id,
        "name": about.title,
        "probability": mechanism.probability,
        "parameters": {n: _serialise_estimate(v) for n, v in diagnosis.parameters[mechanism.id].items()},
        "form_error": mechanism.form_error,
        "indistinguishable_from": list(mechanism.indistinguishable),
        "says": about.signature,
    }


def _serialise_held_out_errors(errors: HeldOutErrors) -> dict[str, Any]:
    return {
        c: {
            "rmse_before": to_display(c, errors.baseline_rmse[c]),
            "rmse_after": to_display(c, errors.model_rmse[c]),
            "rmse_equations": to_display(c, errors.equation_rmse[c]),
            "rmse_expected": to_display(c, errors.expected_rmse[c]) if c in errors.expected_rmse else None,
            "unit": DISPLAY_UNIT[c],
        }
        for c in errors.baseline_rmse
    }


def _serialise_shift(shift: ParameterShift) -> dict[str, Any]:
    scale, unit = get_display_unit(shift.meaning)
    return {
        "before": shift.baseline_value / scale,
        "after": shift.model_value / scale,
        "unit": unit,
        "shift_in_sd": _replace_non_finite(shift.shift_in_sd),
    }
