"""Predictions and derivatives at recent parameter values, computed once.

The steps of a diagnosis return to the same values: a refit starts where an earlier one ended, and the noise
and the bias due to input noise are computed where a refit ended.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

import numpy as np

#: Size of the arrays that are kept, bytes: some hundred refits of a recording of 5,000 rows.
_MAX_BYTES = 50_000_000


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The model at one set of parameter values.

    Attributes:
        prediction: (2, n) predicted channels, SI; None if not computed.
        derivatives: (2, n) derivatives of the prediction, SI, by index of the parameter.
    """

    prediction: np.ndarray | None = None
    derivatives: Mapping[int, np.ndarray] = field(default_factory=dict)

    @property
    def byte_count(self) -> int:
        """Return the size of the arrays, bytes."""
        size = 0 if self.prediction is None else self.prediction.nbytes
        return size + sum(derivative.nbytes for derivative in self.derivatives.values())


class EvaluationCache:
    """The most recent evaluations; safe for several threads. A pickled cache is empty."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._evaluations: OrderedDict[Hashable, Evaluation] = OrderedDict()
        self._byte_count = 0

    def __reduce__(self) -> tuple[type[EvaluationCache], tuple]:
        return EvaluationCache, ()

    def get(self, key: Hashable) -> Evaluation:
        """Return what is known at these parameter values."""
        with self._lock:
            if key not in self._evaluations:
                return Evaluation()
            self._evaluations.move_to_end(key)
            return self._evaluations[key]

    def add(self, key: Hashable, prediction: np.ndarray, derivatives: Mapping[int, np.ndarray]) -> Evaluation:
        """Return what is known at these parameter values, with new results."""
        with self._lock:
            before = self._evaluations.pop(key, Evaluation())
            known_prediction = prediction if before.prediction is None else before.prediction
            evaluation = Evaluation(known_prediction, {**before.derivatives, **derivatives})
            self._evaluations[key] = evaluation
            self._byte_count += evaluation.byte_count - before.byte_count
            while self._byte_count > _MAX_BYTES and len(self._evaluations) > 1:
                self._byte_count -= self._evaluations.popitem(last=False)[1].byte_count
            return evaluation
