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
EXCHANGES, SEARCHED = 20, 2

#: Smallest relative gain that counts.
GAIN = 1e-4

#: From (…, t, p, p) information at t truths to what is to be made small, (…).
Criterion = Callable[[np.ndarray], np.ndarray]


def variance_of(place: int) -> Criterion:
    """Mean over the truths of a number's variance: c-optimality."""
    return lambda information: np.linalg.inv(information)[..., place, place].mean(axis=-1)


def volume_of(places: list[int]) -> Criterion:
    """Mean over the truths of the volume of some numbers' ellipsoid, per number and squared: D-optimality."""

    def criterion(information: np.ndarray) -> np.ndarray:
        covariance = np.linalg.inv(information)[..., places, :][..., places]
        return np.exp(np.linalg.slogdet(covariance)[1].mean(axis=-1) / len(places))

    return criterion


@dataclass(frozen=True, eq=False)
class Menu:
    """What there is to choose from.

    Attributes:
        before: (t, p, p) what is known already, at each of t truths.
        each: (r, t, p, p) what each run adds.
        minutes: (r,) what each costs.
        once: (r,) whether it tells nothing more when done again.
        criterion: to be made small.
        budget: minutes.
        goal: value of the criterion that is enough.
    """

    before: np.ndarray
    each: np.ndarray
    minutes: np.ndarray
    once: np.ndarray
    criterion: Criterion
    budget: float
    goal: float = 0.0

    def known(self, counts: np.ndarray) -> np.ndarray:
        """(t, p, p) information after so many of each run."""
        return self.before + np.tensordot(counts.astype(float), self.each, axes=1)

    def value(self, counts: np.ndarray) -> float:
        """The criterion after so many of each run."""
        return float(self.criterion(self.known(counts)))

    def choose(self) -> np.ndarray:
        """(r,) how often to do each run: the fewest minutes found that reach the goal, or the best of all."""
        checks = np.flatnonzero(self.once)
        subsets = chain.from_iterable(combinations(checks, k) for k in range(len(checks) + 1))
        # A check costs much at once and pays late: a search by small steps would never take it.
        begun = [np.bincount(s, minlength=len(self.each)) for s in map(list, subsets)]
        ends = [self._filled(counts) for counts in begun if counts @ self.minutes <= self.budget]
        # The search is for the few that promise most.
        ends = [self._searched(counts) for counts in sorted(ends, key=self._rank)[:SEARCHED]]
        return min(map(self._spared, ends), key=self._rank)

    def _rank(self, counts: np.ndarray) -> tuple[float, float]:
        """What is better comes first: of those that reach the goal the shortest, then the smallest value."""
        value = self.value(counts)
        return (0.0, float(counts @ self.minutes)) if value <= self.goal else (1.0, value)

    def _filled(self, counts: np.ndarray, room: float | None = None) -> np.ndarray:
        """Add runs one at a time, by the rate of their gain; within a given room by the gain itself."""
        value, most = self.value(counts), self.budget if room is None else room
        while value > self.goal:
            fits = np.flatnonzero(~self.once & (self.minutes <= most - counts @ self.minutes + 1e-9))
            if not fits.size:
                break
            trials = self.criterion(self.known(counts) + self.each[fits])
            gains = np.log(value / trials) / (self.minutes[fits] if room is None else 1.0)
            best = int(np.argmax(gains))
            counts = counts + (np.arange(counts.size) == fits[best])
            value = float(trials[best])
        return counts

    def _searched(self, counts: np.ndarray) -> np.ndarray:
        """Take one or two runs out and fill up again, for as long as that helps."""
        for _ in range(EXCHANGES):
            # On the way to a goal an exchange may not cost minutes: there may be no need of them.
            room = float(counts @ self.minutes) if self.value(counts) <= self.goal else self.budget
            trials = [self._filled(less, room) for less in self._less(counts)]
            best = min(trials, key=self.value, default=counts)
            if self.value(best) >= self.value(counts) * (1 - GAIN):
                break
            counts = best
        return counts

    def _less(self, counts: np.ndarray) -> Iterator[np.ndarray]:
        """The design without one or two of its runs."""
        used = np.flatnonzero(counts * ~self.once)
        for out in chain(combinations(used, 1), combinations_with_replacement(used, 2)):
            less = counts - np.bincount(out, minlength=counts.size)
            if less.min() >= 0:
                yield less

    def _spared(self, counts: np.ndarray) -> np.ndarray:
        """Leave out what is not needed for the goal, longest first."""
        if self.value(counts) > self.goal:
            return counts
        for k in np.argsort(-self.minutes):
            while counts[k]:
                less = counts - (np.arange(counts.size) == k)
                if self.value(less) > self.goal:
                    break
                counts = less
        return counts
