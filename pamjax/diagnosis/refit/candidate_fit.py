"""A baseline with some forms of the library, refitted under the noise that its own residual shows."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.candidates import Form
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import Whitening, whitening
from pamjax.diagnosis.refit.errors_in_variables import unbiased
from pamjax.diagnosis.refit.least_squares import OFF_LIMIT, Refit, refit


@dataclass(frozen=True, eq=False)
class Model:
    """A baseline with names, refitted.

    Attributes:
        chosen: the forms that are in, in the order in which they came.
        white: the noise, as read off this model's residual.
        at: the refit.
        passed: χ² that noise of what was set is expected to leave beyond what the weights know of.
        between: (k, k) covariance of the numbers that moved, SI, among models that are told apart no better.
        pull: (k,) how far noise of what was set moves them, SI.
    """

    chosen: tuple[Form, ...]
    white: Whitening
    at: Refit
    passed: float = 0.0
    between: np.ndarray | float = 0.0
    pull: np.ndarray | float = 0.0

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(form.id for form in self.chosen)

    @property
    def fair(self) -> float:
        """χ² freed of what the model makes of noise: averaging neighbours explains nothing.

        Forgiven is only what is there: no model's χ² falls below what noise leaves by that.
        """
        noise = self.white.trust**2 * self.white.size - len(self.at.moved)
        return self.at.cost - min(self.passed, max(self.at.cost - noise, 0.0))

    @property
    def score(self) -> float:
        """χ² with the price of its numbers: ln n for each beyond the baseline's (Schwarz).

        What the lab's own statement of its muscle asks for is not paid twice.
        """
        extra = sum(len(form.moves) for form in self.chosen)
        expected = sum(form.expected for form in self.chosen)
        return self.fair + extra * np.log(max(self.white.size, 2)) - expected

    @property
    def likely(self) -> float:
        """The score of a model among others that see other noise: minus twice its log-likelihood, priced."""
        return self.score + self.white.volume

    @property
    def excess(self) -> float:
        """χ² beyond what noise leaves."""
        return max(self.at.misfit - self.passed - self.white.size, 0.0)

    @property
    def wider(self) -> float:
        """Factor on a variance where the model leaves more than noise."""
        return max(self.at.misfit / max(self.white.size, 1), 1.0)

    @property
    def covariance(self) -> np.ndarray:
        """Of the numbers that moved, SI, (k, k)."""
        return self.own_covariance + self.between

    @property
    def own_covariance(self) -> np.ndarray:
        """The same, of this one model: what others as good disagree about is left out."""
        return self.wider * self.at.covariance + np.multiply.outer(self.pull, self.pull)

    def sd(self, place: int) -> float:
        """Standard deviation of a number, SI; NaN where it did not move."""
        if place not in self.at.moved:
            return float("nan")
        k = self.at.moved.index(place)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))


def settle(
    found: Problem, used: np.ndarray, chosen: Sequence[Form], values: np.ndarray, rounds: int = 2
) -> Model:
    """Refit the baseline with some forms, with the noise that its own residual shows."""
    moved = moving(found, chosen)
    for _ in range(rounds):
        white = whitening(found, values, used)
        at = refit(found, white, moved, values)
        values = at.values
    return freed(found, tuple(chosen), white, at)


def freed(found: Problem, chosen: tuple[Form, ...], white: Whitening, at: Refit) -> Model:
    """A refitted model, without what it makes of noise."""
    return Model(chosen, white, *unbiased(found, white, at))


def places(found: Problem, chosen: Sequence[Form]) -> list[int]:
    """Indices of the numbers that some forms move."""
    return [found.place(name) for form in chosen for name in form.moves]


def moving(found: Problem, chosen: Sequence[Form]) -> list[int]:
    """Indices of the numbers that a refit with some forms moves: the baseline's own and theirs."""
    return sorted({*np.flatnonzero(found.own).tolist(), *places(found, chosen)})


def begun(found: Problem, values: np.ndarray, form: Form, amplitudes: np.ndarray) -> np.ndarray:
    """Values with a form switched on at its best amplitudes in the linear limit, within its limits."""
    out = values.copy()
    for name, value in form.shape.items():
        k = found.place(name)
        out[k] = np.clip(value, found.low[k], found.high[k])
    for name, value in zip(form.amplitudes, amplitudes, strict=True):
        k = found.place(name)
        # The minimiser creeps away from a limit at which it starts.
        wide = found.high[k] - found.low[k]
        out[k] = np.clip(value, found.low[k] + 1e-6 * wide, found.high[k] - OFF_LIMIT * wide)
    return out


def without(found: Problem, values: np.ndarray, form: Form) -> np.ndarray:
    """Values with a form switched off."""
    out = values.copy()
    for name in form.moves:
        k = found.place(name)
        out[k] = found.neutral[k]
    return out


def effect(found: Problem, model: Model, form: Form) -> np.ndarray:
    """What a form alone does to the recording, beyond what a refitted baseline makes up for, SI, (2, n)."""
    values = model.at.values
    for other in model.chosen:
        values = values if other is form else without(found, values, other)
    alone = found.shows(values)
    unmeasured = np.isnan(found.measured)
    as_measured = dataclasses.replace(found, measured=np.where(unmeasured, np.nan, alone))
    own = np.flatnonzero(found.own).tolist()
    bare = refit(as_measured, model.white, own, without(found, values, form))
    return alone - found.shows(bare.values)
