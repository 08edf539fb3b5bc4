"""Choose runs: exact optimal design over a menu, in the linear limit.

What is known of p numbers is a matrix; runs add to it. With M = M₀ + Σ nᵣ Mᵣ the variance of a number is
(M⁻¹)ₖₖ, and the volume of all of them is det M^(−1/2). The runs are chosen one at a time, each time the one
that gains most for its minutes; then runs are exchanged, one for another, as long as that helps. Where the
truth is not known, M is taken at several truths and the criterion is their mean.

Source: V. V. Fedorov, *Theory of Optimal Experiments* (1972), for exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, combinations, combinations_with_replacement

import numpy as np

#: Exchanges after which it ends, and of how many sets of checks the search is made.
MAX_EXCHANGES, SEARCHED_STARTS = 20, 2

#: Smallest relative gain that counts.
MIN_GAIN = 1e-4

#: From (…, t, p, p) information at t truths to what is to be made small, (…).
Criterion = Callable[[np.ndarray], np.ndarray]


def build_variance_criterion(index: int) -> Criterion:
    """Mean over the truths of a number's variance: c-optimality."""
    return lambda information: np.linalg.inv(information)[..., index, index].mean(axis=-1)


def build_volume_criterion(indices: list[int]) -> Criterion:
    """Mean over the truths of the volume of some numbers' ellipsoid, per number and squared: D-optimality."""

    def criterion(information: np.ndarray) -> np.ndarray:
        covariance = np.linalg.inv(information)[..., indices, :][..., indices]
        return np.exp(np.linalg.slogdet(covariance)[1].mean(axis=-1) / len(indices))

    return criterion


@dataclass(frozen=True, eq=False)
class RunMenu:
    """What there is to choose from.

    Attributes:
        prior_matrix: (t, p, p) what is known already, at each of t truths.
        run_matrices: (r, t, p, p) what each run adds.
        minutes: (r,) what each costs.
        once_only: (r,) whether it tells nothing more when done again.
        criterion: to be made small.
        budget: minutes.
        goal: value of the criterion that is enough.
    """

    prior_matrix: np.ndarray
    run_matrices: np.ndarray
    minutes: np.ndarray
    once_only: np.ndarray
    criterion: Criterion
    budget: float
    goal: float = 0.0

    def compute_information(self, counts: np.ndarray) -> np.ndarray:
        """(t, p, p) information after so many of each run."""
        return self.prior_matrix + np.tensordot(counts.astype(float), self.run_matrices, axes=1)

    def compute_criterion(self, counts: np.ndarray) -> float:
        """The criterion after so many of each run."""
        return float(self.criterion(self.compute_information(counts)))

    def choose_runs(self) -> np.ndarray:
        """(r,) how often to do each run: the fewest minutes found that reach the goal, or the best of all."""
        checks = np.flatnonzero(self.once_only)
        subsets = chain.from_iterable(combinations(checks, k) for k in range(len(checks) + 1))
        # A check costs much at once and pays late: a search by small steps would never take it.
        starts = [np.bincount(s, minlength=len(self.run_matrices)) for s in map(list, subsets)]
        ends = [self._fill_greedily(counts) for counts in starts if counts @ self.minutes <= self.budget]
        # The search is for the few that promise most.
        ends = [
            self._exchange_runs(counts) for counts in sorted(ends, key=self._rank_counts)[:SEARCHED_STARTS]
        ]
        return min(map(self._drop_unneeded, ends), key=self._rank_counts)

    def _rank_counts(self, counts: np.ndarray) -> tuple[float, float]:
        """What is better comes first: of those that reach the goal the shortest, then the smallest value."""
        value = self.compute_criterion(counts)
        return (0.0, float(counts @ self.minutes)) if value <= self.goal else (1.0, value)

    def _fill_greedily(self, counts: np.ndarray, max_minutes: float | None = None) -> np.ndarray:
        """Add runs one at a time, by the rate of their gain; within a given room by the gain itself."""
        value, minutes_limit = (
            self.compute_criterion(counts),
            self.budget if max_minutes is None else max_minutes,
        )
        while value > self.goal:
            fits = np.flatnonzero(
                ~self.once_only & (self.minutes <= minutes_limit - counts @ self.minutes + 1e-9)
            )
            if not fits.size:
                break
            trials = self.criterion(self.compute_information(counts) + self.run_matrices[fits])
            gains = np.log(value / trials) / (self.minutes[fits] if max_minutes is None else 1.0)
            best = int(np.argmax(gains))
            counts = counts + (np.arange(counts.size) == fits[best])
            value = float(trials[best])
        return counts

    def _exchange_runs(self, counts: np.ndarray) -> np.ndarray:
        """Take one or two runs out and fill up again, for as long as that helps."""
        for _ in range(MAX_EXCHANGES):
            # On the way to a goal an exchange may not cost minutes: there may be no need of them.
            max_minutes = (
                float(counts @ self.minutes) if self.compute_criterion(counts) <= self.goal else self.budget
            )
            trials = [self._fill_greedily(reduced, max_minutes) for reduced in self._remove_runs(counts)]
            best = min(trials, key=self.compute_criterion, default=counts)
            if self.compute_criterion(best) >= self.compute_criterion(counts) * (1 - MIN_GAIN):
                break
            counts = best
        return counts

    def _remove_runs(self, counts: np.ndarray) -> Iterator[np.ndarray]:
        """The design without one or two of its runs."""
        used = np.flatnonzero(counts * ~self.once_only)
        for removed in chain(combinations(used, 1), combinations_with_replacement(used, 2)):
            reduced = counts - np.bincount(removed, minlength=counts.size)
            if reduced.min() >= 0:
                yield reduced

    def _drop_unneeded(self, counts: np.ndarray) -> np.ndarray:
        """Leave out what is not needed for the goal, longest first."""
        if self.compute_criterion(counts) > self.goal:
            return counts
        for k in np.argsort(-self.minutes):
            while counts[k]:
                reduced = counts - (np.arange(counts.size) == k)
                if self.compute_criterion(reduced) > self.goal:
                    break
                counts = reduced
        return counts
