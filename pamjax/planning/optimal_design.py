"""Optimal experimental design: choose runs from a menu, with a linearised model.

The information about p parameters is a (p, p) matrix, and the information of independent runs adds up:

    M = M₀ + Σ nᵣ Mᵣ

with the information before the runs M₀, the number nᵣ and the information Mᵣ of each run. The variance of
parameter k is (M⁻¹)ₖₖ (c-optimality). The volume of the confidence ellipsoid is proportional to det M^(−1/2)
(D-optimality). Runs are added one at a time, each time the run with the largest gain per minute. Then one or
two runs are exchanged for others while this improves the criterion. M is evaluated at several parameter
vectors drawn from the prior, because the true one is unknown; the criterion is the mean over them.

Limits: the search is local, so the result can be slightly worse than the optimum.
Source: V. V. Fedorov, *Theory of Optimal Experiments* (1972), for exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, combinations, combinations_with_replacement

import numpy as np

#: Largest number of exchanges, and number of starting designs that are improved by exchanges.
_MAX_EXCHANGES, _SEARCHED_STARTS = 20, 2

#: Smallest relative gain of an accepted exchange.
_MIN_GAIN = 1e-4

#: Function from (…, t, p, p) information at t parameter vectors to the value to minimise, (…).
Criterion = Callable[[np.ndarray], np.ndarray]


def build_variance_criterion(index: int) -> Criterion:
    """Return the mean variance of a parameter over the drawn parameter vectors (c-optimality)."""
    return lambda information: np.linalg.inv(information)[..., index, index].mean(axis=-1)


def build_volume_criterion(indices: list[int]) -> Criterion:
    """Return the mean squared volume of the ellipsoid of some parameters, per parameter (D-optimality)."""

    def criterion(information: np.ndarray) -> np.ndarray:
        covariance = np.linalg.inv(information)[..., indices, :][..., indices]
        return np.exp(np.linalg.slogdet(covariance)[1].mean(axis=-1) / len(indices))

    return criterion


@dataclass(frozen=True, eq=False)
class RunMenu:
    """Runs to choose from, with their information and duration.

    Attributes:
        prior_matrix: (t, p, p) information before the runs, at each of t parameter vectors.
        run_matrices: (r, t, p, p) information of each run.
        minutes: (r,) duration of each run, min.
        once_only: (r,) whether a repetition adds no information.
        criterion: function to minimise.
        budget: available time, min.
        goal: sufficient value of the criterion.
    """

    prior_matrix: np.ndarray
    run_matrices: np.ndarray
    minutes: np.ndarray
    once_only: np.ndarray
    criterion: Criterion
    budget: float
    goal: float = 0.0

    def compute_information(self, counts: np.ndarray) -> np.ndarray:
        """Return the (t, p, p) information after `counts` of each run."""
        return self.prior_matrix + np.tensordot(counts.astype(float), self.run_matrices, axes=1)

    def compute_criterion(self, counts: np.ndarray) -> float:
        """Return the criterion after `counts` of each run."""
        return float(self.criterion(self.compute_information(counts)))

    def choose_runs(self) -> np.ndarray:
        """Return the (r,) counts of the shortest design found that reaches the goal, else of the best one."""
        checks = np.flatnonzero(self.once_only)
        subsets = chain.from_iterable(combinations(checks, k) for k in range(len(checks) + 1))
        # A check is long and useful only with later runs, so the greedy search would never choose it.
        starts = [np.bincount(s, minlength=len(self.run_matrices)) for s in map(list, subsets)]
        ends = [self._fill_greedily(counts) for counts in starts if counts @ self.minutes <= self.budget]
        # Improve only the best starting designs.
        ends = [
            self._exchange_runs(counts) for counts in sorted(ends, key=self._rank_counts)[:_SEARCHED_STARTS]
        ]
        return min(map(self._drop_unneeded, ends), key=self._rank_counts)

    def _rank_counts(self, counts: np.ndarray) -> tuple[float, float]:
        """Return the sort key: designs that reach the goal by time, then the others by criterion."""
        value = self.compute_criterion(counts)
        return (0.0, float(counts @ self.minutes)) if value <= self.goal else (1.0, value)

    def _fill_greedily(self, counts: np.ndarray, max_minutes: float | None = None) -> np.ndarray:
        """Add runs one at a time, by gain per minute; with `max_minutes` by gain."""
        value, minutes_limit = (
            self.compute_criterion(counts),
            self.budget if max_minutes is None else max_minutes,
        )
        while value > self.goal:
            affordable_runs = np.flatnonzero(
                ~self.once_only & (self.minutes <= minutes_limit - counts @ self.minutes + 1e-9)
            )
            if not affordable_runs.size:
                break
            trials = self.criterion(self.compute_information(counts) + self.run_matrices[affordable_runs])
            gains = np.log(value / trials) / (self.minutes[affordable_runs] if max_minutes is None else 1.0)
            best = int(np.argmax(gains))
            counts = counts + (np.arange(counts.size) == affordable_runs[best])
            value = float(trials[best])
        return counts

    def _exchange_runs(self, counts: np.ndarray) -> np.ndarray:
        """Remove one or two runs and refill the design, while this improves it."""
        for _ in range(_MAX_EXCHANGES):
            # Once the goal is reached, an exchange must not need more time.
            max_minutes = (
                float(counts @ self.minutes) if self.compute_criterion(counts) <= self.goal else self.budget
            )
            trials = [
                self._fill_greedily(reduced_counts, max_minutes)
                for reduced_counts in self._remove_runs(counts)
            ]
            best = min(trials, key=self.compute_criterion, default=counts)
            if self.compute_criterion(best) >= self.compute_criterion(counts) * (1 - _MIN_GAIN):
                break
            counts = best
        return counts

    def _remove_runs(self, counts: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the design without one or two of its runs."""
        used_runs = np.flatnonzero(counts * ~self.once_only)
        for removed_runs in chain(combinations(used_runs, 1), combinations_with_replacement(used_runs, 2)):
            reduced_counts = counts - np.bincount(removed_runs, minlength=counts.size)
            if reduced_counts.min() >= 0:
                yield reduced_counts

    def _drop_unneeded(self, counts: np.ndarray) -> np.ndarray:
        """Remove runs that the goal does not need, longest first."""
        if self.compute_criterion(counts) > self.goal:
            return counts
        for k in np.argsort(-self.minutes):
            while counts[k]:
                reduced_counts = counts - (np.arange(counts.size) == k)
                if self.compute_criterion(reduced_counts) > self.goal:
                    break
                counts = reduced_counts
        return counts
