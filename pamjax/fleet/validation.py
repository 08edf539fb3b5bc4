"""Tests of one model on all recordings of a fleet: which recordings it does not predict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pamjax.fleet.frames import select_rows


@dataclass(frozen=True)
class ValidationSummary:
    """Recordings that the tested model does not predict to the noise.

    Attributes:
        missed: names of the recordings with an error above the noise in at least one block, the one with
            the largest part of such blocks first.
        total: number of tested recordings.
    """

    missed: tuple[str, ...]
    total: int


def summarise_validation(cases: pd.DataFrame) -> ValidationSummary:
    """Return which recordings of `Fleet.cases` the tested model does not predict."""
    tested = select_rows(cases, cases["validation_blocks"].gt(0))
    counts = tested["validation_blocks"].to_numpy(float)
    misses = 1.0 - tested["validation_blocks_within_noise"].to_numpy(float) / counts
    names = tested["case"].astype(str).tolist()
    order = np.argsort(-misses, kind="stable")
    return ValidationSummary(tuple(names[k] for k in order if misses[k] > 0), len(names))
