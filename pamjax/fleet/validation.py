"""Tests of one model on all recordings of a fleet: which recordings it does not predict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pamjax.fleet.frames import select_rows


@dataclass(frozen=True)
class ValidationSummary:
    """Recordings that the tested model does not predict.

    Attributes:
        missed: names of the recordings with an error above the noise in at least one block, or with rows
            without a solution. The one with the largest fraction of such blocks is first.
        total: number of tested recordings, without those that the model was fitted to.
    """

    missed: tuple[str, ...]
    total: int


def summarise_validation(cases: pd.DataFrame) -> ValidationSummary:
    """Return which recordings of `Fleet.cases` the tested model does not predict."""
    tested = select_rows(cases, cases["validation_blocks"].gt(0) & ~cases["validation_seen"].fillna(False))
    counts, within_noise, failed_rows = (
        tested[f"validation_{name}"].to_numpy(float)
        for name in ("blocks", "blocks_within_noise", "failed_rows")
    )
    missed_fraction = 1.0 - within_noise / counts
    names = tested["case"].astype(str).tolist()
    order = np.argsort(-missed_fraction, kind="stable")
    is_missed = (missed_fraction > 0) | (failed_rows > 0)
    return ValidationSummary(tuple(names[k] for k in order if is_missed[k]), len(names))
