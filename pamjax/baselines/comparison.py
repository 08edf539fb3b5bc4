"""Comparison of held-out errors: diagnosed model, Sárosi's formula and a Gaussian process.

| split         | held-out rows                                       | tests         |
|---------------|-----------------------------------------------------|---------------|
| held out      | the diagnosis' own blocks, inside the range         | interpolation |
| extrapolation | the highest pressure, or the most contracted length | extrapolation |

Four models are fitted without the held-out rows. These are the baseline, the baseline with the identified
mechanisms, Sárosi's formula (force only), and the baseline with a Gaussian process on its residual. On the
first split the mechanisms are selected without these rows too. On the second they are those of the diagnosis,
and only their parameters are refitted.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.baselines.empirical import fit_sarosi
from pamjax.baselines.gaussian_process import build_inputs, predict_discrepancy
from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.crossval.held_out_errors import compute_rmse
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.misfit_weighting import fit_with_misfit_weight
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.result import Diagnosis
from pamjax.errors import BadInput
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.files import write_atomically
from pamjax.records.levels import assign_levels, find_levels
from pamjax.units import format_quantity

_GAIN_SCHEMA = "pamjax.gain/1"

_HELD_OUT_SPLIT, _EXTRAPOLATION_SPLIT = "held out", "extrapolation"
BASELINE_MODEL, SELECTED_MODEL, SAROSI_MODEL, GAUSSIAN_PROCESS_MODEL = (
    "baseline",
    "named",
    "sarosi",
    "gaussian_process",
)

#: Display titles of the models.
MODEL_TITLES = {
    BASELINE_MODEL: "baseline",
    SELECTED_MODEL: "with mechanisms",
    SAROSI_MODEL: "Sárosi's formula",
    GAUSSIAN_PROCESS_MODEL: "Gaussian process",
}

#: An error below this share of another one is clearly smaller.
_CLEARLY_SMALLER = 0.9
#: Smallest number of levels for a test of extrapolation.
_MIN_LEVELS_FOR_EXTRAPOLATION = 3
#: Smallest number of samples for a Gaussian process.
_MIN_GP_SAMPLES = 3
#: Share of the range of lengths that is held out if the recording has no separate settings.
_EXTRAPOLATION_RANGE_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class ComparisonSplit:
    """Errors of all models on one set of held-out rows.

    Attributes:
        name: "held out" or "extrapolation".
        rows_description: the held-out rows, in words.
        held_out_mask: (n,) whether a row is held out.
        rmse: root mean square error by model and channel, SI; a model that cannot be fitted is missing.
        remarks: notes on the fit, by model.
    """

    name: str
    rows_description: str
    held_out_mask: np.ndarray
    rmse: dict[str, dict[str, float]]
    remarks: dict[str, str]


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """The splits of one recording, and the noise by channel, SI, as a lower bound of the error."""

    splits: tuple[ComparisonSplit, ...]
    noise_sd: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as it is written to gain.json."""
        return {
            "schema": _GAIN_SCHEMA,
            "noise": {c: {"sd": to_display(c, v), "unit": DISPLAY_UNIT[c]} for c, v in self.noise_sd.items()},
            "splits": [
                {
                    "name": split.name,
                    "rows": split.rows_description,
                    "rmse": {
                        model: {
                            c: {"value": to_display(c, v), "unit": DISPLAY_UNIT[c]} for c, v in by.items()
                        }
                        for model, by in split.rmse.items()
                    },
                    "remarks": split.remarks,
                }
                for split in self.splits
            ],
        }

    @property
    def better_formula_rmse(self) -> float | None:
        """Return the held-out error of force by Sárosi's formula, N, if the model's is clearly larger."""
        for split in self.splits:
            model = split.rmse.get(SELECTED_MODEL, split.rmse[BASELINE_MODEL]).get("force")
            formula = split.rmse.get(SAROSI_MODEL, {}).get("force")
            if split.name == _HELD_OUT_SPLIT and model is not None and formula is not None:
                return formula if formula < _CLEARLY_SMALLER * model else None
        return None

    def __str__(self) -> str:
        """Return two lines for each channel: held-out blocks, then extrapolation."""
        lines = []
        for split in self.splits:
            for channel in (c for c in self.noise_sd if c in split.rmse[BASELINE_MODEL]):
                models = [
                    m
                    for m in split.rmse
                    if split.name != _HELD_OUT_SPLIT or m in (SAROSI_MODEL, GAUSSIAN_PROCESS_MODEL)
                ]
                scores = [_format_rmse(split, m, channel) for m in models if channel in split.rmse[m]]
                if scores:
                    lines.append(
                        f"  {_format_split(split)}, {channel}: {', '.join(scores)} {DISPLAY_UNIT[channel]}"
                    )
        remarks = {(MODEL_TITLES[m], text): None for s in self.splits for m, text in s.remarks.items()}
        lines += [f"  * {title}: {text}" for title, text in remarks]
        if self.better_formula_rmse is not None:
            lines.append("  Sárosi's formula has the smaller error on held-out rows: interpolate with it")
        return "\n".join(lines)


def _format_split(split: ComparisonSplit) -> str:
    if split.name == _HELD_OUT_SPLIT:
        return "same held-out rows"
    return f"rmse after fits without {split.rows_description}"


def _format_rmse(split: ComparisonSplit, model: str, channel: str) -> str:
    star = "*" if model in split.remarks else ""
    rmse = to_display(channel, split.rmse[model][channel])
    return (
        f"{MODEL_TITLES[model]} {rmse:.3g}{star}"
        if rmse < 1000
        else f"{MODEL_TITLES[model]} {rmse:.0f}{star}"
    )


def compare_models(diagnosis: Diagnosis, seed: int = 0) -> ModelComparison | None:
    """Compare a diagnosed model with a formula and a Gaussian process on held-out rows.

    Args:
        diagnosis: the diagnosis.
        seed: seed for the fit of the Gaussian process.

    Returns:
        the comparison; None for an isotonic test, because the formula predicts a force.
    """
    problem, errors = diagnosis.problem, diagnosis.held_out_errors
    if problem.case.recording.measures_length:
        return None
    splits = []
    if errors.held_out_mask.any():
        rows = errors.block_description.split(": ")[-1]
        splits.append(
            _evaluate_split(
                diagnosis,
                _HELD_OUT_SPLIT,
                rows,
                errors.held_out_mask,
                errors.baseline_prediction,
                errors.model_prediction,
                seed,
            )
        )
    extrapolation_rows, words = find_extrapolation_rows(problem)
    if extrapolation_rows.any():
        predictions = _predict_without_rows(diagnosis, extrapolation_rows)
        splits.append(
            _evaluate_split(diagnosis, _EXTRAPOLATION_SPLIT, words, extrapolation_rows, *predictions, seed)
        )
    noise = {}
    for c, channel in enumerate(CHANNELS):
        channel_noise, rows = diagnosis.model.noise.by_channel[c], diagnosis.model.noise.rows[c]
        if channel_noise is not None:
            noise[channel] = float(np.sqrt(np.mean(channel_noise.sd[rows] ** 2)))
    return ModelComparison(tuple(splits), noise)


def find_extrapolation_rows(problem: LibraryProblem) -> tuple[np.ndarray, str]:
    """Return the mask of the rows held out for extrapolation, (n,), and their description."""
    recording = problem.case.recording
    measured_rows = np.isfinite(problem.measured).any(axis=0)
    for channel, unit, end in ((recording.pressure, "kPa", max), (recording.length, "mm", min)):
        label = np.where(
            measured_rows, assign_levels(channel, levels := find_levels(channel, recording.has_time)), -1
        )
        level_indices = np.unique(label[label >= 0])
        if level_indices.size >= _MIN_LEVELS_FOR_EXTRAPOLATION:
            last = end(level_indices.tolist())
            kind = "the highest isobar" if unit == "kPa" else "the most contracted length"
            return label == last, f"{kind}, {format_quantity(float(levels[last]), unit, 3)}"
    low, high = (
        np.nanquantile(recording.length[measured_rows], [0.0, 1.0]) if measured_rows.any() else (0.0, 0.0)
    )
    short = measured_rows & (recording.length < low + _EXTRAPOLATION_RANGE_SHARE * (high - low))
    return short, f"lengths below {format_quantity(low + _EXTRAPOLATION_RANGE_SHARE * (high - low), 'mm', 3)}"


def _predict_without_rows(diagnosis: Diagnosis, held_out_mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the predictions of the baseline and of the selected model, refitted without some rows."""
    problem = diagnosis.problem
    baseline = fit_model(problem, ~held_out_mask, (), diagnosis.baseline.estimate.values)
    prediction = problem.predict(baseline.estimate.values)
    if not diagnosis.named_mechanisms:
        return prediction, prediction
    model = fit_with_misfit_weight(
        problem, ~held_out_mask, diagnosis.model.mechanisms, diagnosis.selection.start_values
    )
    return prediction, problem.predict(model.estimate.values)


def _evaluate_split(
    diagnosis: Diagnosis,
    name: str,
    rows: str,
    held_out_mask: np.ndarray,
    baseline_prediction: np.ndarray,
    model_prediction: np.ndarray,
    seed: int,
) -> ComparisonSplit:
    problem = diagnosis.problem
    predictions: dict[str, np.ndarray] = {BASELINE_MODEL: baseline_prediction}
    remarks: dict[str, str] = {}
    if diagnosis.named_mechanisms:
        predictions[SELECTED_MODEL] = model_prediction
    try:
        force, remark = _predict_sarosi(problem, ~held_out_mask)
        predictions[SAROSI_MODEL] = np.stack([force, np.full(problem.n, np.nan)])
        remarks |= {SAROSI_MODEL: remark} if remark else {}
    except BadInput:
        pass
    x, residual = build_inputs(problem), problem.measured - baseline_prediction
    discrepancy = [
        predict_discrepancy(x, residual[c], ~held_out_mask, seed)
        if _has_enough_samples(residual[c], ~held_out_mask)
        else residual[c] * np.nan
        for c in (0, 1)
    ]
    predictions[GAUSSIAN_PROCESS_MODEL] = baseline_prediction + np.stack(discrepancy)
    return ComparisonSplit(
        name,
        rows,
        held_out_mask,
        {m: compute_rmse(problem, v, held_out_mask) for m, v in predictions.items()},
        remarks,
    )


def _has_enough_samples(residual: np.ndarray, training_mask: np.ndarray) -> bool:
    return int(np.count_nonzero(np.isfinite(residual) & training_mask)) >= _MIN_GP_SAMPLES


def _predict_sarosi(problem: LibraryProblem, training_mask: np.ndarray) -> tuple[np.ndarray, str]:
    recording = problem.case.recording
    contraction = 1 - recording.length / problem.case.muscle_toml.rest_length.value
    force = np.where(training_mask, problem.measured[0], np.nan)
    law = fit_sarosi(recording.pressure, contraction, force)
    return law.force(recording.pressure, contraction), (
        "the exponent is at a limit of its range" if law.at_limit else ""
    )


def save_comparison(comparison: ModelComparison, folder: Path) -> Path:
    """Write gain.json and return its path."""
    path = folder / "gain.json"
    with write_atomically(path) as temporary:
        temporary.write_text(
            json.dumps(comparison.as_dict(), indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
    return path
