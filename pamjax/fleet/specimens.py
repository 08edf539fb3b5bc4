"""One estimate for each specimen: the recordings of one serial number are combined.

The estimates y ± s of the recordings of one specimen have the weights w = 1/s²:

    estimate = Σ w y / Σ w,    sd = (Σ w)^(−1/2)

A quantity of the recordings, such as the date, has the same weights. A regression on it is then that of the
single recordings. Neglected: differences between the recordings of one specimen beyond their sd.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd


@dataclass(frozen=True, eq=False)
class SpecimenEstimates:
    """Estimates of one parameter, one for each specimen.

    Attributes:
        names: name of each specimen: of its case, or its serial number with several recordings.
        cases: names of the recordings of each specimen.
        benches: bench of each specimen; None if it has none or several.
        value, sd: (n,) estimate and its sd.
        place: (r,) index of the specimen of each recording.
        weight: (r,) weight of each recording.
    """

    names: tuple[str, ...]
    cases: tuple[tuple[str, ...], ...]
    benches: tuple[str | None, ...]
    value: np.ndarray
    sd: np.ndarray
    place: np.ndarray
    weight: np.ndarray

    def average(self, quantity: np.ndarray) -> np.ndarray:
        """Return (n,) weighted means of a quantity over the recordings of each specimen.

        Args:
            quantity: (r,) values of the recordings; NaN makes the mean NaN.
        """
        return np.bincount(self.place, self.weight * quantity) / np.bincount(self.place, self.weight)


def index_specimens(cases: pd.DataFrame) -> dict[str, int]:
    """Return the index of the specimen of each case; cases of one type and serial number have the same.

    Args:
        cases: `Fleet.cases`. A case without a serial number is a specimen of its own.
    """
    index_by_key: dict[tuple[str, ...], int] = {}
    specimens = {}
    for case, kind, serial in zip(cases["case"], cases["type"].fillna(""), cases["serial"], strict=True):
        key = (case,) if pd.isna(serial) else (kind, serial)
        specimens[str(case)] = index_by_key.setdefault(key, len(index_by_key))
    return specimens


def combine_recordings(estimates: pd.DataFrame, cases: pd.DataFrame) -> SpecimenEstimates:
    """Return one estimate for each specimen.

    Args:
        estimates: columns `case`, `specimen`, `value` and `sd`, one row for each recording.
        cases: the rows of `Fleet.cases` of these recordings, in their order.
    """
    place, specimens = pd.factorize(estimates["specimen"])
    weight = estimates["sd"].to_numpy(float) ** -2.0
    groups = [np.flatnonzero(place == k) for k in range(len(specimens))]
    names, serials, benches = (cases[column].tolist() for column in ("case", "serial", "bench"))
    total = np.bincount(place, weight)
    return SpecimenEstimates(
        names=tuple(
            str(names[rows[0]]) if len(rows) == 1 else f"{serials[rows[0]]} ({len(rows)} recordings)"
            for rows in groups
        ),
        cases=tuple(tuple(str(names[k]) for k in rows) for rows in groups),
        benches=tuple(_find_common_bench([benches[k] for k in rows]) for rows in groups),
        value=np.bincount(place, weight * estimates["value"].to_numpy(float)) / total,
        sd=total**-0.5,
        place=place,
        weight=weight,
    )


def _find_common_bench(benches: list) -> str | None:
    """Return the bench of all recordings, or None without one."""
    return None if pd.isna(benches[0]) or len(set(benches)) > 1 else str(benches[0])
