"""Predict whole blocks of a recording by fits that never saw them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution, solve
from pamjax.infer.problem.dataset import CHANNELS, Member, read
from pamjax.infer.problem.parameter_space import Space
from pamjax.records.blocks import Blocks, folds
from pamjax.records.case import Case


def hold_out(
    cases: Sequence[Case],
    members: tuple[Member, ...],
    found: Sequence[Blocks],
    at: Space,
    solution: Solution,
    loss: Loss,
    count: int,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[list[list[np.ndarray]], list[dict[str, np.ndarray]]]:
    """Fit without each fold of blocks in turn and predict it.

    Args:
        found: the blocks of each case; a case with a single block is never held out.
        count: number of folds.
        seed: of the deal of blocks into folds.

    Returns:
        for each case the folds, as (n,) masks of held-out rows, and the predictions of those rows
        by channel, SI, NaN where nothing was held out.
    """
    deals = [folds(b, count, seed) if len(b.names) > 1 else [] for b in found]
    unseen = [{c: np.full(case.recording.n, np.nan) for c in CHANNELS} for case in cases]
    rounds = max((len(deal) for deal in deals), default=0)
    for k in range(rounds):
        progress(k / rounds)
        out = [deal[k] if k < len(deal) else None for deal in deals]
        left = solve(tuple(map(without, members, out)), at, solution.u, loss)
        for one, mask, prediction in zip(members, out, unseen, strict=True):
            if mask is not None:
                _fill(prediction, read(one, at.values(left.u)), mask)
    return deals, unseen


def without(one: Member, out: np.ndarray | None) -> Member:
    """The member with some rows out of the fit's sight.

    Args:
        out: (n,) whether a row is held out; None for no row.
    """
    if out is None:
        return one
    used = np.array(one.rows.used)
    used[: out.size][out] = 0.0
    return eqx.tree_at(lambda m: m.rows.used, one, jnp.asarray(used))


def _fill(prediction: dict[str, np.ndarray], reading, mask: np.ndarray) -> None:
    for channel, values in prediction.items():
        values[mask] = np.asarray(getattr(reading, channel))[: mask.size][mask]
