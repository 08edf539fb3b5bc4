"""Cross-validation: predictions of whole blocks of a recording by fits without them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution, solve_least_squares
from pamjax.infer.form_errors.dataset_form import estimate_form, whiten_form_again
from pamjax.infer.problem.dataset import Dataset, predict_row_channels
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.records.blocks import Blocks, split_folds
from pamjax.records.case import Case


def cross_validate(
    cases: Sequence[Case],
    datasets: tuple[Dataset, ...],
    blocks_of_cases: Sequence[Blocks],
    space: ParameterSpace,
    solution: Solution,
    loss: Loss,
    fold_count: int,
    seed: int,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[list[list[np.ndarray]], list[dict[str, np.ndarray]]]:
    """Return the held-out predictions of every case, each fold by a fit without it.

    Args:
        cases: the recordings.
        datasets: their datasets, with the weights of the fit.
        blocks_of_cases: the blocks of each case; a case with a single block is not held out.
        space: the free parameters.
        solution: the solution for all rows, which is the starting point.
        loss: the loss of the fit.
        fold_count: number of folds.
        seed: seed of the assignment of blocks to folds.
        progress: called with the completed fraction.

    Returns:
        for each case the folds, as (n,) masks of held-out rows, and the predictions of those rows. These are
        by channel, SI, and NaN where no block was held out.
    """
    folds_of_cases = [split_folds(b, fold_count, seed) if len(b.names) > 1 else [] for b in blocks_of_cases]
    predictions = [
        {c: np.full(case.recording.n, np.nan) for c in case.recording.model_channels} for case in cases
    ]
    rounds = max((len(folds) for folds in folds_of_cases), default=0)
    for k in range(rounds):
        progress(k / rounds)
        held_out = [folds[k] if k < len(folds) else None for folds in folds_of_cases]
        training_datasets = tuple(map(exclude_rows, datasets, held_out))
        reduced_solution = solve_least_squares(training_datasets, space, solution.u, loss)
        values = space.to_values(reduced_solution.u)
        for dataset, mask, prediction in zip(training_datasets, held_out, predictions, strict=True):
            if mask is not None:
                predicted_channels = predict_row_channels(dataset, values) + estimate_form(dataset, values)
                _fill_predictions(prediction, predicted_channels, mask)
    return folds_of_cases, predictions


def exclude_rows(dataset: Dataset, is_excluded: np.ndarray | None) -> Dataset:
    """Return the dataset without some rows.

    Args:
        dataset: the dataset.
        is_excluded: (n,) whether a row is excluded; None for no row.
    """
    if is_excluded is None:
        return dataset
    training_mask = np.array(dataset.rows.training_mask)
    training_mask[: is_excluded.size][is_excluded] = 0.0
    training_dataset = eqx.tree_at(lambda m: m.rows.training_mask, dataset, jnp.asarray(training_mask))
    if training_dataset.whitening is not None:
        whitening = training_dataset.whitening.restrict_to_rows(training_mask > 0)
        training_dataset = eqx.tree_at(lambda m: m.whitening, training_dataset, whitening)
    return whiten_form_again(training_dataset)


def _fill_predictions(
    prediction: dict[str, np.ndarray], predicted_channels: np.ndarray, mask: np.ndarray
) -> None:
    for values, predicted in zip(prediction.values(), predicted_channels, strict=True):
        values[mask] = predicted[: mask.size][mask]
