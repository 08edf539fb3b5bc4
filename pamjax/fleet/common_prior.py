"""Estimates of specimens as they follow from their recordings, without a prior that several of them share.

A posterior y ± s from a prior m ± p and a recording contains the prior. If several specimens state the same
prior, for example the modulus of a data sheet, it is one statement and not one per specimen. It is then
removed, which leaves the recording's own estimate (normal approximation):

    1/l² = 1/s² − 1/p²,    estimate = l² (y/s² − m/p²)

A prior that one specimen alone states is a measurement of this specimen, for example of its thread length.
It stays in the estimate, and in one of several recordings of this specimen. A recording that has less
information than the removed prior is excluded. Parameters without a prior stay as they are.
Derived here from the product of two normal densities.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pamjax.fleet.frames import select_rows

#: Largest ratio s/p: the recording has at least as much information on the parameter as the prior.
_MAX_SD_RATIO = 0.7
#: Number of decimal digits in which two equal priors agree.
_PRIOR_DIGITS = 9


def extract_estimates(table: pd.DataFrame) -> tuple[pd.DataFrame, bool]:
    """Return the estimates of one parameter that are usable for a distribution over specimens.

    Args:
        table: rows of `Fleet.numbers` of one name and one source, with the column `specimen` from
            `index_specimens`.

    Returns:
        columns `case`, `specimen`, `value` and `sd`, and whether specimens share a prior. Estimates at a
        limit and estimates without sd are excluded, and those with less information than a removed prior.
    """
    usable = table["sd"].gt(0) & np.isfinite(table["value"]) & ~table["at_limit"].fillna(False).astype(bool)
    rows = select_rows(table, usable)
    value, sd, prior, prior_sd = (
        rows[name].to_numpy(float, copy=True) for name in ("value", "sd", "prior", "prior_sd")
    )
    is_shared, is_repeated = _find_shared_priors(rows)
    removed = is_shared | is_repeated
    kept = ~removed | (sd < _MAX_SD_RATIO * prior_sd)
    removed &= kept
    value[removed], sd[removed] = remove_prior(value[removed], sd[removed], prior[removed], prior_sd[removed])
    entries = {"case": rows["case"].astype(str).to_numpy(), "specimen": rows["specimen"].to_numpy(int)}
    estimates = pd.DataFrame({**entries, "value": value, "sd": sd})
    return select_rows(estimates, kept), bool(is_shared.any())


def _find_shared_priors(rows: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Return (r,) which recordings have the prior of another specimen, and which repeat that of their own.

    Args:
        rows: columns `specimen`, `prior` and `prior_sd`, one row for each recording.
    """
    places: dict[str, list[int]] = {}
    for k, (prior, prior_sd) in enumerate(zip(rows["prior"], rows["prior_sd"], strict=True)):
        if np.isfinite(prior) and np.isfinite(prior_sd):
            places.setdefault(f"{prior:.{_PRIOR_DIGITS - 1}e} {prior_sd:.{_PRIOR_DIGITS - 1}e}", []).append(k)
    specimen = rows["specimen"].to_numpy(int)
    is_shared, is_repeated = np.zeros((2, len(rows)), dtype=bool)
    for members in places.values():
        if len(set(specimen[members])) > 1:
            is_shared[members] = True
        else:
            is_repeated[members[1:]] = True
    return is_shared, is_repeated


def remove_prior(
    value: np.ndarray, sd: np.ndarray, prior: np.ndarray, prior_sd: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return estimate and sd of the recording alone, each (n,).

    >>> value, sd = remove_prior(np.array([1.0]), np.array([0.6]), np.array([0.0]), np.array([1.0]))
    >>> float(value[0].round(4)), float(sd[0].round(4))
    (1.5625, 0.75)
    """
    precision = sd**-2.0 - prior_sd**-2.0
    return (value / sd**2 - prior / prior_sd**2) / precision, precision**-0.5
