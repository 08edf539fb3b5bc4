"""Predictions and derivatives at recent parameter values, computed once.

The steps of a diagnosis return to the same values. For example, a refit starts where an earlier one ended.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

import numpy as np

#: Size of the cached arrays, bytes: fourteen evaluations of 5,000 rows with six derivatives. Three times as
#: much saves two percent of the evaluations.
_MAX_BYTES = 8_000_000


@dataclass(frozen=True, eq=False)
class CachedEvaluation:
    """Results at one set of parameter values.

    Attributes:
        predictions: (2, n) predicted channels, SI, by the program that computed them: two programs agree to
            rounding only.
        derivatives: (2, n) derivatives of the prediction, SI, by index of the parameter.
    """

    predictions: Mapping[Hashable, np.ndarray] = field(default_factory=dict)
    derivatives: Mapping[int, np.ndarray] = field(default_factory=dict)

    @property
    def byte_count(self) -> int:
        """Return the size of the arrays, bytes."""
        return sum(array.nbytes for array in (*self.predictions.values(), *self.derivatives.values()))

    def merge(
        self, predictions: Mapping[Hashable, np.ndarray], derivatives: Mapping[int, np.ndarray]
    ) -> CachedEvaluation:
        """Return these results with further ones."""
        return CachedEvaluation({**self.predictions, **predictions}, {**self.derivatives, **derivatives})


class EvaluationCache:
    """The most recent evaluations; safe for several threads. A pickled cache is empty."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._evaluations: OrderedDict[Hashable, CachedEvaluation] = OrderedDict()
        self._byte_count = 0

    def __reduce__(self) -> tuple[type[EvaluationCache], tuple]:
        return EvaluationCache, ()

    def get(self, key: Hashable) -> CachedEvaluation:
        """Return the cached results of a key; empty if there are none."""
        with self._lock:
            if key not in self._evaluations:
                return CachedEvaluation()
            self._evaluations.move_to_end(key)
            return self._evaluations[key]

    def put(self, key: Hashable, evaluation: CachedEvaluation) -> None:
        """Add results to those of a key, and make their arrays read-only; drop the oldest results."""
        for array in (*evaluation.predictions.values(), *evaluation.derivatives.values()):
            array.setflags(write=False)
        with self._lock:
            before = self._evaluations.pop(key, CachedEvaluation())
            # Another thread may have added results since `get`.
            merged = before.merge(evaluation.predictions, evaluation.derivatives)
            self._evaluations[key] = merged
            self._byte_count += merged.byte_count - before.byte_count
            while self._byte_count > _MAX_BYTES and len(self._evaluations) > 1:
                self._byte_count -= self._evaluations.popitem(last=False)[1].byte_count

    def clear(self) -> None:
        """Drop all results."""
        with self._lock:
            self._evaluations.clear()
            self._byte_count = 0
