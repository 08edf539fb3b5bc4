"""The most probable values of the numbers that may move, under correlated noise and their priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import Whitening

#: Evaluations after which a refit ends.
MOST = 40

#: Share of a number's range that the baseline's own start away from its ends.
OFF_LIMIT = 0.15

#: Share of its range within which a number was driven to a limit.
AT_LIMIT = 1e-3

#: Standard deviation of a prior that knows nothing.
UNKNOWN = 1e30

#: Limits of a uniform variable, in its standard deviations.
LIMITS_APART = 12**0.5


@dataclass(frozen=True, eq=False)
class Refit:
    """Where a refit ended.

    Attributes:
        moved: indices of the numbers that moved.
        values: (p,) all numbers, SI.
        cost: χ² of whitened residual and priors.
        misfit: χ² of the whitened residual alone.
        residual: (size,) whitened residual.
        jacobian: (size, k) its derivative by the numbers that moved, in their coordinates, sign of the model.
        prior: (k,) sd of the priors in those coordinates.
        scale: (k,) derivative of value by coordinate.
    """

    moved: tuple[int, ...]
    values: np.ndarray
    cost: float
    misfit: float
    residual: np.ndarray
    jacobian: np.ndarray
    prior: np.ndarray
    scale: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Of the numbers that moved, SI, (k, k)."""
        information = self.jacobian.T @ self.jacobian + np.diag(1 / self.prior**2)
        # Scaled to a unit diagonal: newtons and pascals are many orders of magnitude apart.
        unit = np.sqrt(np.maximum(np.diag(information), 1e-300))
        inverse = np.linalg.pinv(information / np.outer(unit, unit), rcond=1e-12, hermitian=True)
        return inverse / np.outer(unit, unit) * np.outer(self.scale, self.scale)


def coordinates(found: Problem, places: Sequence[int], values: np.ndarray) -> np.ndarray:
    """Values as coordinates: their logarithm where they move on a logarithmic scale."""
    picked, log = values[list(places)], found.log[list(places)]
    return np.where(log, np.log(np.where(log, picked, 1.0)), picked)


def room(found: Problem, at: Refit) -> tuple[np.ndarray, np.ndarray]:
    """How far down and up the numbers that moved may still go, in their coordinates."""
    here = coordinates(found, at.moved, at.values)
    low, high = (coordinates(found, at.moved, edge) - here for edge in (found.low, found.high))
    return np.minimum(low, 0.0), np.maximum(high, 0.0)


def driven(found: Problem, at: Refit) -> np.ndarray:
    """Which of the numbers that moved, by their order, were driven to a limit."""
    low, high = room(found, at)
    return np.flatnonzero(np.minimum(-low, high) < AT_LIMIT * (high - low))


def believed(found: Problem, places: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of the priors in coordinates; infinite where there is none.

    What was stated is believed as stated. A shape that was not, or a logarithm, may be anywhere between its
    limits: it is believed to be its textbook's, to no better than its rms distance from all that lies there.
    """
    places = list(places)
    sd, log = found.sd[places], found.log[places]
    shape = np.array([found.meaning[k].neutral is None for k in places], dtype=bool)
    start, low, high = (
        coordinates(found, places, values)
        for values in (found.start, np.where(found.log, np.maximum(found.low, 1e-300), found.low), found.high)
    )
    between = ~np.isfinite(sd) & (log | shape)
    of_stated = np.where(log, sd / np.where(log, found.start[places], 1.0), sd)
    with np.errstate(over="ignore"):
        off = np.hypot((high - low) / LIMITS_APART, start - (low + high) / 2)
    return start, np.where(between, off, of_stated)


def refit(
    found: Problem, white: Whitening, moved: Sequence[int], values: np.ndarray, most: int = MOST
) -> Refit:
    """Let some numbers move, from where they are.

    Args:
        found: the recording before the library.
        white: its noise.
        moved: indices of the numbers that move; all others stay.
        values: (p,) where everything starts, SI.
        most: evaluations after which it ends.
    """
    moved = list(moved)
    mean, prior = believed(found, moved)
    low, high = (coordinates(found, moved, edge) for edge in (found.low, found.high))
    look = _Look(found, white, moved, values)

    def residuals(x):
        of_prior = np.where(np.isfinite(prior), (x - mean) / prior, 0.0)
        return np.concatenate([look(x).residual, of_prior])

    def jacobian(x):
        return np.concatenate([-look(x).jacobian, np.diag(np.where(np.isfinite(prior), 1 / prior, 0.0))])

    width = np.where(np.isfinite(prior), prior, 0.1 * (high - low))
    # The minimiser creeps away from a limit at which it starts: the baseline's numbers are often strained
    # to theirs by what is missing, and free again once that is named.
    inside = np.where(found.own[moved], OFF_LIMIT, 1e-6) * (high - low)
    start = np.clip(coordinates(found, moved, values), low + inside, high - inside)
    end = least_squares(
        residuals, start, jac=cast(Any, jacobian), bounds=(low, high), x_scale=width,
        ftol=1e-5, xtol=1e-7, gtol=1e-10, max_nfev=most,
    )  # fmt: skip
    return look.refit(end.x)


def standing(found: Problem, white: Whitening, moved: Sequence[int], values: np.ndarray) -> Refit:
    """What a refit would be that ended at these values; arguments as those of `refit`."""
    look = _Look(found, white, moved, values)
    return look.refit(coordinates(found, moved, values))


@dataclass(frozen=True, eq=False)
class _Seen:
    values: np.ndarray
    scale: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray


class _Look:
    """Residual and derivative at a point; the minimiser asks for them one after the other."""

    def __init__(self, found: Problem, white: Whitening, moved: Sequence[int], values: np.ndarray) -> None:
        self.found, self.white, self.moved, self.values = found, white, list(moved), values
        self.at: np.ndarray | None = None
        self.seen: _Seen | None = None

    def __call__(self, x: np.ndarray) -> _Seen:
        if self.seen is None or self.at is None or not np.array_equal(self.at, x):
            log = self.found.log[self.moved]
            trial = self.values.copy()
            trial[self.moved] = np.where(log, np.exp(np.where(log, x, 0.0)), x)
            shown, slopes = self.found.slopes(trial, self.moved)
            scale = np.where(log, trial[self.moved], 1.0)
            # A state without an answer is as bad as far off, and has no slope.
            residual = np.nan_to_num(self.white(self.found.measured - shown), nan=1e3)
            jacobian = (np.nan_to_num(self.white(slopes)) * scale[:, None]).T
            self.at, self.seen = x.copy(), _Seen(trial, scale, residual, jacobian)
        return self.seen

    def refit(self, x: np.ndarray) -> Refit:
        """As a refit that ended here."""
        mean, prior = believed(self.found, self.moved)
        of_prior = np.where(np.isfinite(prior), (x - mean) / prior, 0.0)
        here = self(x)
        misfit = float(here.residual @ here.residual)
        return Refit(
            moved=tuple(self.moved),
            values=here.values,
            cost=misfit + float(of_prior @ of_prior),
            misfit=misfit,
            residual=here.residual,
            jacobian=here.jacobian,
            prior=np.where(np.isfinite(prior), prior, UNKNOWN),
            scale=here.scale,
        )
