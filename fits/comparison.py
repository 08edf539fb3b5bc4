"""Compare: the fitted braid beside what a user would fit without pamjax, on the same rows and splits.

Every model is told the same rows (force above a threshold share of full scale, so that a slack muscle
decides nothing) and is asked for the same rows that it was not told: whole settings of length, or whole
isobars where the length strokes.

| split                   | fitted on                                 | asked for                           |
|-------------------------|-------------------------------------------|-------------------------------------|
| in sample               | all rows                                  | all rows                            |
| inner lengths held out  | all but one length between the outer two  | that one; each in turn, rows pooled |
| rest length held out    | all but the longest length                | that one                            |

The braid keeps the priors of its muscle.toml, weighed as in its fit; the rivals have none. Gaylord's law is
the braid with inextensible threads, set free of them. An error of a length setting that was held out stays
at its prior mean, zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pamjax.baselines.empirical import fit_gaylord, fit_sarosi
from pamjax.errors import BadInput, refuse
from pamjax.infer.fitting.cross_validation import exclude_rows
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.fitting.result import Fit
from pamjax.infer.problem.dataset import MAX_SLACK_FORCE_SHARE, predict_rows
from pamjax.records.case import Case
from pamjax.records.levels import assign_levels, find_levels

#: Fewer settings than this leave no inner one.
ENOUGH = 3

#: Threads of the braid that are compared where no fits are handed over.
THREADS = ("inelastic", "elastic")

#: From the mask of the rows it is told: the force, N, at every row, and a remark ("" for none).
Model = Callable[[np.ndarray], tuple[np.ndarray, str]]


@dataclass(frozen=True, eq=False)
class Split:
    """One question: the masks of rows, each predicted by a fit on all other rows.

    Attributes:
        name: as "rest length held out".
        asked: (n,) masks; for "in sample" the rows asked for are told as well.
        told: (n,) masks of the rows each fit sees, in the order of `asked`.
    """

    name: str
    asked: tuple[np.ndarray, ...]
    told: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Score:
    """How a model did on a split: rmse of force in N, None where it could not be fitted, and a remark."""

    rmse: float | None
    remark: str = ""


@dataclass(frozen=True, eq=False)
class Comparison:
    """How models did on the same rows; prints as a table.

    Attributes:
        case: name of the case.
        rows: how many rows were compared.
        threshold, full_scale: force below which a row was left out, and the largest force, N.
        scores: by model, then by split.
    """

    case: str
    rows: int
    threshold: float
    full_scale: float
    scores: dict[str, dict[str, Score]]

    def rmse(self, model: str, split: str) -> float:
        """Rmse of force, N; NaN where the model could not be fitted."""
        found = self.scores[model][split].rmse
        return np.nan if found is None else found

    def best(self, split: str) -> str:
        """The model with the least rmse on a split."""
        return min(self.scores, key=lambda model: np.nan_to_num(self.rmse(model, split), nan=np.inf))

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON; None where a model could not be fitted."""
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
            cells = (f"  {_cell(by_split[split]):>{len(split)}}" for split in splits)
            lines.append(f"  {model:<{width}}" + "".join(cells))
        remarks = dict.fromkeys(v.remark for by_split in self.scores.values() for v in by_split.values())
        return "\n".join([*lines, *(f"  * {remark}" for remark in remarks if remark)])


def compare(case: Case, fits: Sequence[Fit] = ()) -> Comparison:
    """Score the braid and its rivals on one case, in sample and with whole settings held out.

    Args:
        case: with a measured force.
        fits: of this case alone, one for each braid to compare; none fits the laws of `THREADS`.

    Raises:
        BadInput: if the case has no force.
    """
    recording = case.recording
    if "force" not in recording.channels:
        raise refuse("a comparison of forces needs a measured force", "none", f"{case.name}/recording.csv")
    there = recording.usable & np.isfinite(recording.force)
    full_scale = float(np.abs(recording.force[there]).max())
    rows = there & (recording.force >= MAX_SLACK_FORCE_SHARE * full_scale)
    fits = fits or [fit(case, law, starts=1) for law in THREADS]
    models = {_name(one): _braid(one) for one in fits} | _rivals(case)
    found = splits(case, rows)
    return Comparison(
        case=case.name,
        rows=int(rows.sum()),
        threshold=MAX_SLACK_FORCE_SHARE * full_scale,
        full_scale=full_scale,
        scores={
            name: {split.name: _score(model, split, recording.force) for split in found}
            for name, model in models.items()
        },
    )


def splits(case: Case, rows: np.ndarray) -> list[Split]:
    """The questions that a recording's settings allow: over lengths, or else over isobars.

    Args:
        rows: (n,) the rows to compare on.
    """
    recording = case.recording
    found = [Split("in sample", (rows,), (rows,))]
    for channel, inner, outer in (
        (recording.length, "inner lengths", "rest length"),
        (recording.pressure, "inner isobars", "highest isobar"),
    ):
        levels = find_levels(channel)
        label = np.where(rows, assign_levels(channel, levels), -1)
        settings = np.unique(label[label >= 0])
        if len(settings) >= ENOUGH:
            between = tuple(label == k for k in settings[1:-1])
            last = label == settings[-1]
            found.append(Split(f"{inner} held out", between, tuple(rows & ~out for out in between)))
            found.append(Split(f"{outer} held out", (last,), (rows & ~last,)))
            break
    return found


def _name(fitted: Fit) -> str:
    return ", ".join([f"braid, {fitted.law} threads", *fitted.mechanisms])


def _braid(fitted: Fit) -> Model:
    """The muscle under its priors, its samples weighed as in the fit; one program for all splits."""
    (one,) = fitted.datasets

    def model(told: np.ndarray) -> tuple[np.ndarray, str]:
        left = solve_least_squares(
            (exclude_rows(one, ~told),), fitted.limited_space, fitted.solution.u, fitted.loss
        )
        force = np.asarray(predict_rows(one, fitted.space.to_values(left.u)).force)[: told.size]
        return force, "" if left.converged else "the braid's fit did not converge"

    return model


def _rivals(case: Case) -> dict[str, Model]:
    pressure, length, force = case.recording.pressure, case.recording.length, case.recording.force
    contraction = 1 - length / case.entry.rest_length.value

    def gaylord(threshold: bool, told: np.ndarray) -> tuple[np.ndarray, str]:
        law = fit_gaylord(pressure[told], length[told], force[told], threshold=threshold)
        return law.force(pressure, length), ""

    def sarosi(told: np.ndarray) -> tuple[np.ndarray, str]:
        law = fit_sarosi(pressure[told], contraction[told], force[told])
        remark = "Sárosi's exponent at an end of its range, a parabola or a step" if law.at_limit else ""
        return law.force(pressure, contraction), remark

    return {
        "Gaylord": partial(gaylord, False),
        "Gaylord, free threshold": partial(gaylord, True),
        "Sárosi": sarosi,
    }


def _score(model: Model, split: Split, force: np.ndarray) -> Score:
    misfit, remarks = [], []
    for asked, told in zip(split.asked, split.told, strict=True):
        try:
            predicted, remark = model(told)
        except BadInput as error:
            return Score(None, str(error))
        misfit.append((force - predicted)[asked])
        remarks.append(remark)
    return Score(float(np.sqrt(np.mean(np.concatenate(misfit) ** 2))), max(remarks))


def _cell(score: Score) -> str:
    """Three digits, or a dash; a star where there is a remark."""
    star = "*" if score.remark else ""
    if score.rmse is None:
        return f"-{star}"
    return f"{score.rmse:{'.3g' if score.rmse < 1e3 else '.0f' if score.rmse < 1e5 else '.0e'}}{star}"
