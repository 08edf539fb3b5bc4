"""Estimates of specimens as they follow from their recordings, without a prior that all of them share.

A posterior y ± s from a prior m ± p and a recording contains the prior. If all specimens state the same
prior, for example the modulus of a data sheet, it is one statement and not one per specimen. It is then taken
out, which leaves the recording's own estimate (normal approximation):

    1/l² = 1/s² − 1/p²,    estimate = l² (y/s² − m/p²)

A prior that differs between specimens is a measurement of each specimen, for example of its thread length.
It stays in the estimate. A specimen whose recording has less information than the prior is left out.
Derived here from the product of two normal densities.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pamjax.fleet.frames import select_rows

#: Largest ratio s/p: the recording has at least as much information on the number as the prior.
MAX_SD_RATIO = 0.7
#: Relative difference up to which two priors are the same.
PRIOR_TOLERANCE = 1e-9


def extract_estimates(table: pd.DataFrame) -> pd.DataFrame:
    """Return the estimates of one number that are usable for a distribution over specimens.

    Args:
        table: rows of `Fleet.numbers` of one name and one source.

    Returns:
        columns `case`, `value` and `sd`; without numbers at a limit, without sd, or from the prior alone.
    """
    usable = table["sd"].gt(0) & np.isfinite(table["value"]) & ~table["at_limit"].fillna(False).astype(bool)
    rows = select_rows(table, usable)
    value, sd = rows["value"].to_numpy(float), rows["sd"].to_numpy(float)
    if has_common_prior(rows):
        prior, prior_sd = rows["prior"].to_numpy(float), rows["prior_sd"].to_numpy(float)
        determined = sd < MAX_SD_RATIO * prior_sd
        rows, value, sd = select_rows(rows, determined), value[determined], sd[determined]
        value, sd = remove_prior(value, sd, prior[determined], prior_sd[determined])
    return pd.DataFrame({"case": rows["case"].astype(str).to_numpy(), "value": value, "sd": sd})


def has_common_prior(table: pd.DataFrame) -> bool:
    """Return whether at least two specimens have one prior in common, with an sd."""
    prior, prior_sd = table["prior"].to_numpy(float), table["prior_sd"].to_numpy(float)
    if len(table) < 2 or not np.isfinite(prior_sd).all():
        return False
    tolerance = PRIOR_TOLERANCE * np.abs(prior).max()
    return bool(np.ptp(prior) <= tolerance and np.ptp(prior_sd) <= PRIOR_TOLERANCE * prior_sd.max())


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
