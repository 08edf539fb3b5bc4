"""Several recordings of one material, fitted together, and each predicted from the others.

The recordings share all parameters of a model except some of their own. A recording that is left out has no
influence on its prediction, except through the weights of the other recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.infer.fitting.cross_validation import exclude_rows
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.fitting.result import Fit
from pamjax.infer.problem.dataset import predict_row_channels
from pamjax.records.case import Case

#: Function from the indices of the fitted recordings to the predicted channel, SI, of all rows of each one.
Predictor = Callable[[Sequence[int]], list[np.ndarray]]


@dataclass(frozen=True)
class SeriesErrors:
    """Rms errors of each recording, in the unit of the channel.

    Attributes:
        fitted: with all recordings in the fit.
        left_out: with the recordings of the same group left out.
    """

    fitted: list[float]
    left_out: list[float]


def get_measured(case: Case) -> np.ndarray:
    """Return the measured channel of a recording, (n,): force, or length in an isotonic test."""
    return getattr(case.recording, case.recording.model_channels[0])


def build_model(fitted: Fit) -> Predictor:
    """Return the model with the priors and weights of a fit to all recordings."""

    def predict(kept: Sequence[int]) -> list[np.ndarray]:
        training = tuple(
            dataset if k in kept else exclude_rows(dataset, np.ones(dataset.rows.force_weight.size, bool))
            for k, dataset in enumerate(fitted.datasets)
        )
        solution = solve_least_squares(training, fitted.limited_space, fitted.solution.u, fitted.loss)
        values = fitted.space.to_values(solution.u)
        return [
            predict_row_channels(dataset, values)[0, : case_fit.case.recording.n]
            for dataset, case_fit in zip(fitted.datasets, fitted.cases, strict=True)
        ]

    return predict


def compute_contraction(case: Case) -> np.ndarray:
    """Return the contraction of each row, (n,)."""
    return 1 - case.recording.length / case.muscle_toml.rest_length.value


def compute_errors(
    cases: list[Case],
    predict: Predictor,
    groups: Sequence[Hashable],
    masks: Sequence[np.ndarray] | None = None,
) -> SeriesErrors:
    """Return the errors of a model.

    Args:
        cases: the recordings.
        predict: the model.
        groups: group of each recording; those of one group are left out together.
        masks: (n,) whether each row is compared, for each recording; None for all rows.
    """
    masks = [np.ones(case.recording.n, dtype=bool) for case in cases] if masks is None else masks
    indices = range(len(cases))
    everything = predict(indices)
    left_out = [predict([j for j in indices if groups[j] != groups[k]])[k] for k in indices]
    return SeriesErrors(_compute_rmse(cases, everything, masks), _compute_rmse(cases, left_out, masks))


def _compute_rmse(
    cases: list[Case], predictions: list[np.ndarray], masks: Sequence[np.ndarray]
) -> list[float]:
    return [
        float(np.sqrt(np.mean((get_measured(case) - prediction)[mask] ** 2)))
        for case, prediction, mask in zip(cases, predictions, masks, strict=True)
    ]


def format_table(
    names: Sequence[str],
    rows: Sequence[int],
    errors: dict[str, SeriesErrors],
    unit: str,
    scales: np.ndarray,
) -> str:
    """Return the errors as Markdown, fitted and left out.

    Args:
        names: names of the recordings.
        rows: number of rows of each recording.
        errors: the errors of each model.
        unit: unit of the cells.
        scales: (k,) size of this unit for each recording, SI.
    """
    lines = [f"| {unit} | " + " | ".join(names) + " | all rows |", "|---" * (len(names) + 2) + "|"]
    for model, both in errors.items():
        columns = [
            [*values, np.sqrt(np.average(values**2, weights=rows))]
            for values in (np.array(both.fitted) / scales, np.array(both.left_out) / scales)
        ]
        cells = [f"{fitted:.3g}, {left_out:.3g}" for fitted, left_out in zip(*columns, strict=True)]
        lines.append(f"| {model} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
