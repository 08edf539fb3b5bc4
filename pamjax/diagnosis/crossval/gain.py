"""Before and after on whole blocks that neither a fit nor a choice of mechanism has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import CandidateFit
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.blocks import Blocks

#: One block of so many is held out, and none where there are fewer than this.
HELD_OUT_INTERVAL, MIN_BLOCKS_FOR_HOLD_OUT = 5, 3


@dataclass(frozen=True, eq=False)
class Gain:
    """How much better held-out blocks are predicted.

    Attributes:
        blocks: what was held out, in words.
        held_out: (n,) whether a row was.
        before, after: (2, n) predictions of force (N) and diameter (m), by fits that saw no held-out row.
        rmse_before, rmse_after: by channel, SI, over held-out rows; a channel without one is missing.
    """

    blocks: str
    held_out: np.ndarray
    before: np.ndarray
    after: np.ndarray
    rmse_before: dict[str, float]
    rmse_after: dict[str, float]


def select_held_out_rows(blocks: Blocks) -> np.ndarray:
    """(n,) the rows to hold out: whole blocks inside the range, one of five, at least one."""
    n_blocks = len(blocks)
    if n_blocks < MIN_BLOCKS_FOR_HOLD_OUT:
        return np.zeros(blocks.label.size, dtype=bool)
    # The middle one of few readings is where a refitted baseline is right by construction.
    first = 1 if blocks.kind == "rows" and n_blocks <= HELD_OUT_INTERVAL else min(2, n_blocks // 2)
    block_labels = np.arange(n_blocks)[first::HELD_OUT_INTERVAL]
    # An end of the range is extrapolation, another question.
    block_labels = (
        block_labels[block_labels < n_blocks - 1] if n_blocks > MIN_BLOCKS_FOR_HOLD_OUT else np.array([1])
    )
    return np.isin(blocks.label, block_labels)


def compute_gain(
    problem: LibraryProblem,
    blocks: Blocks,
    held_out_rows: np.ndarray,
    baseline: CandidateFit,
    fit: CandidateFit,
) -> Gain:
    """Score a baseline and a model that were fitted without the rows in `held_out_rows`."""
    before, after = problem.predict(baseline.estimate.values), problem.predict(fit.estimate.values)
    names = [blocks.names[k] for k in np.unique(blocks.label[held_out_rows]) if k >= 0]
    words = (
        f"{len(names)} of {len(blocks)} {blocks.kind}: {', '.join(names)}"
        if names
        else "none: too few blocks"
    )
    return Gain(
        words,
        held_out_rows,
        before,
        after,
        compute_rmse(problem, before, held_out_rows),
        compute_rmse(problem, after, held_out_rows),
    )


def compute_rmse(problem: LibraryProblem, prediction: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    """Rms misfit of a prediction, (2, n), over some rows, by channel that was measured there, SI."""
    rmse_by_channel = {}
    for c, channel in enumerate(CHANNELS):
        residual = (problem.measured[c] - prediction[c])[rows]
        residual = residual[np.isfinite(residual)]
        if residual.size:
            rmse_by_channel[channel] = float(np.sqrt(np.mean(residual**2)))
    return rmse_by_channel
