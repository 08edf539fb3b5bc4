"""Before and after on whole blocks that neither a fit nor a choice of mechanism has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.records.blocks import Blocks

#: One block of so many is held out, and none where there are fewer than this.
EVERY, FEWEST = 5, 3


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


def held_out(found: Blocks) -> np.ndarray:
    """(n,) the rows to hold out: whole blocks inside the range, one of five, at least one."""
    many = len(found)
    if many < FEWEST:
        return np.zeros(found.label.size, dtype=bool)
    # The middle one of few readings is where a refitted baseline is right by construction.
    first = 1 if found.kind == "rows" and many <= EVERY else min(2, many // 2)
    chosen = np.arange(many)[first::EVERY]
    # An end of the range is extrapolation, another question.
    chosen = chosen[chosen < many - 1] if many > FEWEST else np.array([1])
    return np.isin(found.label, chosen)


def gain(found: Problem, blocks: Blocks, out: np.ndarray, baseline: Model, model: Model) -> Gain:
    """Score a baseline and a model that were fitted without the rows in `out`."""
    before, after = found.shows(baseline.at.values), found.shows(model.at.values)
    names = [blocks.names[k] for k in np.unique(blocks.label[out]) if k >= 0]
    words = (
        f"{len(names)} of {len(blocks)} {blocks.kind}: {', '.join(names)}"
        if names
        else "none: too few blocks"
    )
    return Gain(words, out, before, after, rmse(found, before, out), rmse(found, after, out))


def rmse(found: Problem, prediction: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    """Rms misfit of a prediction, (2, n), over some rows, by channel that was measured there, SI."""
    scores = {}
    for c, channel in enumerate(CHANNELS):
        misfit = (found.measured[c] - prediction[c])[rows]
        misfit = misfit[np.isfinite(misfit)]
        if misfit.size:
            scores[channel] = float(np.sqrt(np.mean(misfit**2)))
    return scores
