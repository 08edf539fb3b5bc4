"""A Gaussian process on what the baseline leaves: the flexible curve that naming physics is held against.

    measured = baseline(pressure, length) + δ(pressure, contraction, direction, speed) + noise
    δ ~ GP(0, s² exp(−½ Σ (Δx_i / ℓ_i)²))

with s, ℓ and the noise at their greatest marginal likelihood. It learns any smooth misfit where it has
data and returns to the baseline where it has none. It has no memory: of the past it knows the direction.
Source: M. C. Kennedy, A. O'Hagan, J. R. Statist. Soc. B 63, 425 (2001); the baseline is refitted first, on
its own, and the two are not inferred together.
"""

from __future__ import annotations

import warnings
from typing import Any, cast

import numpy as np

from pamjax.diagnosis.detect.regions import SHORTENING, axes
from pamjax.diagnosis.library.library_problem import Problem

#: Most rows it learns from, evenly picked: its cost is their cube.
LEARNT = 300

#: Limits of its length scales, in standard deviations of an input.
SHORTEST, FARTHEST = 0.03, 100.0

#: Share of a channel's fastest usual rate above which it moves.
MOVING = 0.05

#: Speeds that differ by less than this factor are one.
SPEEDS = 1.5


def inputs(found: Problem) -> np.ndarray:
    """(n, k) standardised: pressure, contraction, direction; speed too where there are several."""
    at = axes(found)
    pressure = np.asarray(found.member.history.rate(found.member.rows.pressure))[: found.n]
    length = np.asarray(found.member.history.rate(found.member.rows.length))[: found.n]
    # Where the length is held, what climbs and falls is the pressure.
    strokes = bool(np.any(at.direction != 0))
    rate, way = (length, at.direction / SHORTENING) if strokes else (pressure, _sign(pressure))
    columns = [at.pressure, at.contraction, way]
    speeds = np.abs(rate)[way != 0]
    if speeds.size and np.quantile(speeds, 0.9) > SPEEDS * np.quantile(speeds, 0.3):
        columns.append(np.arcsinh(np.abs(rate) / max(float(np.median(speeds)), 1e-300)))
    kept = [c for c in columns if np.nanstd(c) > 0]
    return np.stack([(c - np.nanmean(c)) / np.nanstd(c) for c in kept], axis=1)


def _sign(rate: np.ndarray) -> np.ndarray:
    fast = float(np.nanquantile(np.abs(rate), 0.95)) if rate.size else 0.0
    return np.where(np.abs(rate) > MOVING * fast, np.sign(rate), 0.0)


def widest_gap(values: np.ndarray) -> float:
    """The widest distance between neighbours among some values: the shortest length scale worth asking for.

    A shorter one fits each isobar by itself and knows nothing of one between them: no curve that anybody
    would draw.

    >>> widest_gap(np.array([0.0, 1.0, 1.01, 3.0]))
    1.99
    """
    return float(np.clip(np.max(np.diff(np.sort(values)), initial=SHORTEST), SHORTEST, FARTHEST / 2))


def discrepancy(x: np.ndarray, left: np.ndarray, told: np.ndarray, seed: int = 0) -> np.ndarray:
    """What the baseline leaves, learnt from some rows, at every row.

    Args:
        x: (n, k) inputs, standardised.
        left: (n,) measured minus baseline, any unit.
        told: (n,) rows it may learn from.
        seed: of the start of its second search.

    Returns:
        (n,) δ in the unit of `left`; NaN where an input is not known.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from threadpoolctl import threadpool_limits

    known = np.all(np.isfinite(x), axis=1)
    rows = np.flatnonzero(told & known & np.isfinite(left))
    rows = rows[np.unique(np.linspace(0, rows.size - 1, min(LEARNT, rows.size)).astype(int))]
    out = np.full(left.size, np.nan)
    size = float(np.sqrt(np.mean(left[rows] ** 2))) or 1.0
    nearest = [(widest_gap(x[rows, k]), FARTHEST) for k in range(x.shape[1])]
    start = np.clip(1.0, *np.array(nearest).T)
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(cast(Any, start), cast(Any, nearest))
    process = GaussianProcessRegressor(
        kernel + WhiteKernel(0.01, (1e-8, 10.0)), n_restarts_optimizer=1, random_state=seed
    )
    # One thread: for matrices as small as these, several spend their time on waiting for each other.
    with warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
        # A length scale at its limit says that an input does not matter, or matters from row to row.
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(x[rows], left[rows] / size)
    out[known] = size * np.asarray(process.predict(x[known]))
    return out
