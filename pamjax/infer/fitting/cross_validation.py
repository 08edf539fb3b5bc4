"""Predict whole blocks of a recording by fits that never saw them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution, solve_least_squares
from pamjax.infer.problem.dataset import CHANNELS, Dataset, predict_rows
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
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[list[list[np.ndarray]], list[dict[str, np.ndarray]]]:
    """Fit without each fold of blocks in turn and predict it.

    Args:
        blocks_of_cases: the blocks of each case; a case with a single block is never held out.
        fold_count: number of folds.
        seed: of the deal of blocks into folds.

    Returns:
        for each case the folds, as (n,) masks of held-out rows, and the predictions of those rows
        by channel, SI, NaN where nothing was held out.
    """
    deals = [split_folds(b, fold_count, seed) if len(b.names) > 1 else [] for b in blocks_of_cases]
    unseen = [{c: np.full(case.recording.n, np.nan) for c in CHANNELS} for case in cases]
    rounds = max((len(deal) for deal in deals), default=0)
    for k in range(rounds):
        progress(k / rounds)
        held_out = [deal[k] if k < len(deal) else None for deal in deals]
        reduced_solution = solve_least_squares(
            tuple(map(exclude_rows, datasets, held_out)), space, solution.u, loss
        )
        for dataset, mask, prediction in zip(datasets, held_out, unseen, strict=True):
            if mask is not None:
                _fill_predictions(
                    prediction, predict_rows(dataset, space.to_values(reduced_solution.u)), mask
                )
    return deals, unseen


def exclude_rows(dataset: Dataset, excluded: np.ndarray | None) -> Dataset:
    """The member with some rows out of the fit's sight.

    Args:
        excluded: (n,) whether a row is held out; None for no row.
    """
    if excluded is None:
        return dataset
    training_mask = np.array(dataset.rows.training_mask)
    training_mask[: excluded.size][excluded] = 0.0
    return eqx.tree_at(lambda m: m.rows.training_mask, dataset, jnp.asarray(training_mask))


def _fill_predictions(prediction: dict[str, np.ndarray], reading, mask: np.ndarray) -> None:
    for channel, values in prediction.items():
        values[mask] = np.asarray(getattr(reading, channel))[: mask.size][mask]
