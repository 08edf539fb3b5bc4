"""Comparison of the fitted braid with empirical formulas, on the same rows and splits.

All models are fitted to the same rows and predict the same held-out rows. A held-out part is a whole length
setting, or a whole isobar if the length varies. Rows with a force below a share of full scale are excluded,
because the muscle may be slack.

| split                   | training rows                             | test rows                            |
|-------------------------|-------------------------------------------|--------------------------------------|
| in sample               | all rows                                  | all rows                             |
| inner lengths held out  | all but one length between the outer two  | this length, in turn; all pooled     |
| rest length held out    | all but the longest length                | the longest length                   |

The braid has the priors of muscle.toml and the sample weights of its fit; the formulas have no priors.
Gaylord's law is the braid with inextensible threads, without priors. The error of a held-out length level
has its prior mean, zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pamjax.baselines.empirical import fit_gaylord, fit_sarosi
from pamjax.errors import BadInput
from pamjax.infer.fitting.cross_validation import exclude_rows
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.fitting.result import Fit
from pamjax.infer.problem.dataset import predict_row_channels
from pamjax.infer.problem.informative_samples import MAX_SLACK_FORCE_SHARE
from pamjax.records.case import Case
from pamjax.records.levels import assign_levels, find_levels

#: Fewer levels than this leave no inner one.
ENOUGH = 3

#: Thread laws of the compared braids, if no fits are passed.
THREADS = ("inelastic", "elastic")

#: Function from the mask of the training rows to the force, N, of every row, and a remark ("" for none).
Model = Callable[[np.ndarray], tuple[np.ndarray, str]]


@dataclass(frozen=True, eq=False)
class Split:
    """A split of the rows: masks of test rows, each predicted by a fit to its training rows.

    Attributes:
        name: as "rest length held out".
        test_masks: (n,) masks; "in sample" they are also training rows.
        training_masks: (n,) masks of the rows of each fit, in the order of `test_masks`.
    """

    name: str
    test_masks: tuple[np.ndarray, ...]
    training_masks: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Score:
    """Error of a model on a split: rmse of force, N (None if the fit is not possible), and a remark."""

    rmse: float | None
    remark: str = ""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Errors of several models on the same rows; its text is a table.

    Attributes:
        case: name of the case.
        rows: number of compared rows.
        threshold, full_scale: force below which a row is excluded, and the largest force, N.
        scores: by model, then by split.
    """

    case: str
    rows: int
    threshold: float
    full_scale: float
    scores: dict[str, dict[str, Score]]

    def rmse(self, model: str, split: str) -> float:
        """Return the rmse of force, N; NaN if the model cannot be fitted."""
        value = self.scores[model][split].rmse
        return np.nan if value is None else value

    def best(self, split: str) -> str:
        """Return the model with the smallest rmse on a split."""
        return min(self.scores, key=lambda model: np.nan_to_num(self.rmse(model, split), nan=np.inf))

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as a JSON document; None if a model cannot be fitted."""
        return {
            "case": self.case,
            "rows": self.rows,
            "threshold_N": self.threshold,
            "full_scale_N": self.full_scale,
            "rmse_N": {m: {s: v.rmse for s, v in by_split.items()} for m, by_split in self.scores.items()},
        }

    def __str__(self) -> str:
        splits = list(next(iter(self.scores.values())))
        width = max(map(len, self.scores))
        lines = [
            f"{self.case}: rmse of force [N], {self.rows} rows above {self.threshold:.3g} N, "
            f"full scale {self.full_scale:.4g} N",
            "  " + " " * width + "".join(f"  {split:>{len(split)}}" for split in splits),
        ]
        for model, by_split in self.scores.items():
            cells = (f"  {_format_cell(by_split[split]):>{len(split)}}" for split in splits)
            lines.append(f"  {model:<{width}}" + "".join(cells))
        remarks = dict.fromkeys(v.remark for by_split in self.scores.values() for v in by_split.values())
        return "\n".join([*lines, *(f"  * {remark}" for remark in remarks if remark)])


def compare(case: Case, fits: Sequence[Fit] = ()) -> Comparison:
    """Return the errors of the braid and the formulas on one case, in sample and on held-out levels.

    Args:
        case: a case with a measured force.
        fits: fits of this case alone, one for each braid; without fits, the laws of `THREADS` are fitted.

    Raises:
        BadInput: if the case has no force.
    """
    recording = case.recording
    if "force" not in recording.channels:
        raise BadInput.from_rule(
            "a comparison of forces needs a measured force", "none", f"{case.name}/recording.csv"
        )
    measured_rows = recording.usable & np.isfinite(recording.force)
    full_scale = float(np.abs(recording.force[measured_rows]).max())
    rows = measured_rows & (recording.force >= MAX_SLACK_FORCE_SHARE * full_scale)
    fits = fits or [fit(case, law, starts=1) for law in THREADS]
    models = {_name_braid(fitted): _build_braid(fitted) for fitted in fits} | _build_formulas(case)
    case_splits = list_splits(case, rows)
    return Comparison(
        case=case.name,
        rows=int(rows.sum()),
        threshold=MAX_SLACK_FORCE_SHARE * full_scale,
        full_scale=full_scale,
        scores={
            name: {split.name: _compute_score(model, split, recording.force) for split in case_splits}
            for name, model in models.items()
        },
    )


def list_splits(case: Case, rows: np.ndarray) -> list[Split]:
    """Return the splits of a recording: by lengths, or by isobars if it has too few lengths.

    Args:
        case: the case.
        rows: (n,) mask of the compared rows.
    """
    recording = case.recording
    all_splits = [Split("in sample", (rows,), (rows,))]
    for channel, inner, outer in (
        (recording.length, "inner lengths", "rest length"),
        (recording.pressure, "inner isobars", "highest isobar"),
    ):
        levels = find_levels(channel)
        label = np.where(rows, assign_levels(channel, levels), -1)
        level_indices = np.unique(label[label >= 0])
        if len(level_indices) >= ENOUGH:
            between = tuple(label == k for k in level_indices[1:-1])
            last = label == level_indices[-1]
            all_splits.append(Split(f"{inner} held out", between, tuple(rows & ~out for out in between)))
            all_splits.append(Split(f"{outer} held out", (last,), (rows & ~last,)))
            break
    return all_splits


def _name_braid(fitted: Fit) -> str:
    return ", ".join([f"braid, {fitted.law} threads", *fitted.mechanisms])


def _build_braid(fitted: Fit) -> Model:
    """Return the braid with its priors and the sample weights of the fit; one program for all splits."""
    (dataset,) = fitted.datasets

    def model(rows: np.ndarray) -> tuple[np.ndarray, str]:
        training_data = exclude_rows(dataset, ~rows)
        solution = solve_least_squares((training_data,), fitted.limited_space, fitted.solution.u, fitted.loss)
        force = predict_row_channels(dataset, fitted.space.to_values(solution.u))[0, : rows.size]
        return force, "" if solution.converged else "the braid's fit did not converge"

    return model


def _build_formulas(case: Case) -> dict[str, Model]:
    pressure, length, force = case.recording.pressure, case.recording.length, case.recording.force
    contraction = 1 - length / case.muscle_toml.rest_length.value

    def gaylord(threshold: bool, rows: np.ndarray) -> tuple[np.ndarray, str]:
        law = fit_gaylord(pressure[rows], length[rows], force[rows], threshold=threshold)
        return law.force(pressure, length), ""

    def sarosi(rows: np.ndarray) -> tuple[np.ndarray, str]:
        law = fit_sarosi(pressure[rows], contraction[rows], force[rows])
        remark = "Sárosi's exponent at an end of its range, a parabola or a step" if law.at_limit else ""
        return law.force(pressure, contraction), remark

    return {
        "Gaylord": partial(gaylord, False),
        "Gaylord, free threshold": partial(gaylord, True),
        "Sárosi": sarosi,
    }


def _compute_score(model: Model, split: Split, force: np.ndarray) -> Score:
    misfit, remarks = [], []
    for test_masks, training_masks in zip(split.test_masks, split.training_masks, strict=True):
        try:
            predicted, remark = model(training_masks)
        except BadInput as error:
            return Score(None, str(error))
        misfit.append((force - predicted)[test_masks])
        remarks.append(remark)
    return Score(float(np.sqrt(np.mean(np.concatenate(misfit) ** 2))), max(remarks))


def _format_cell(score: Score) -> str:
    """Return an error with three digits, or a dash; a star if it has a remark."""
    star = "*" if score.remark else ""
    if score.rmse is None:
        return f"-{star}"
    return f"{score.rmse:{'.3g' if score.rmse < 1e3 else '.0f' if score.rmse < 1e5 else '.0e'}}{star}"
