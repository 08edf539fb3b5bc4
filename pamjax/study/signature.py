"""What a mechanism would do to this recording, and how much of the misfit looks like it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.study.forms import Form
from pamjax.study.problem import Problem
from pamjax.study.refit import Refit
from pamjax.study.whiten import Whitening


@dataclass(frozen=True, eq=False)
class Signature:
    """A form before a recording.

    Attributes:
        form: which.
        gain: χ² that its best amplitudes would take away, in the linear limit.
        amplitudes: those, SI.
        directions: (k, size) unit vectors, white, freed of what the numbers that move absorb.
    """

    form: Form
    gain: float
    amplitudes: np.ndarray
    directions: np.ndarray


class Absorbed:
    """What numbers that move absorb of a direction, under their priors: least squares with prior rows."""

    def __init__(self, at: Refit) -> None:
        self.size = at.residual.size
        stacked = np.concatenate([at.jacobian, np.diag(1 / at.prior)])
        # Columns differ by many orders of magnitude; only their span counts.
        norm = np.linalg.norm(stacked, axis=0)
        stacked = stacked[:, norm > 0] / norm[norm > 0]
        left, weights, _ = np.linalg.svd(stacked, full_matrices=False)
        self.basis = left[:, weights > 1e-7]

    def out_of(self, directions: np.ndarray) -> np.ndarray:
        """(k, size) white directions, as (k, size + priors) rows without what is absorbed."""
        extended = np.zeros((*directions.shape[:-1], self.basis.shape[0]))
        extended[..., : self.size] = directions
        return extended - (extended @ self.basis) @ self.basis.T


def signatures(found: Problem, white: Whitening, at: Refit, candidates: Sequence[Form]) -> list[Signature]:
    """The signature of each form at a refit, and how much of its residual it would explain."""
    absorbed = Absorbed(at)
    residual = np.concatenate([at.residual, np.zeros(absorbed.basis.shape[0] - absorbed.size)])
    return [_signature(found, white, at, form, absorbed, residual) for form in candidates]


def _signature(found, white, at, form, absorbed, residual) -> Signature:
    places = [found.place(name) for name in form.amplitudes]
    values = at.values.copy()
    for name, value in form.shape.items():
        k = found.place(name)
        values[k] = np.clip(value, found.low[k], found.high[k])
    _, slopes = found.slopes(values, places)
    free = absorbed.out_of(np.nan_to_num(white(slopes)))
    amplitudes, gain = _best(free, residual, found.low[places] - at.values[places] < 0)
    norm = np.linalg.norm(free, axis=1, keepdims=True)
    return Signature(form, gain, amplitudes, free / np.where(norm > 0, norm, 1.0))


def _best(free: np.ndarray, residual: np.ndarray, either_sign: np.ndarray) -> tuple[np.ndarray, float]:
    """Amplitudes of least squares, none below its limit, and the χ² they take away."""
    kept = np.linalg.norm(free, axis=1) > 1e-12
    while kept.any():
        amplitudes = np.zeros(len(free))
        amplitudes[kept] = np.linalg.lstsq(free[kept].T, residual, rcond=1e-8)[0]
        wrong = kept & ~either_sign & (amplitudes <= 0)
        if not wrong.any():
            left = residual - amplitudes @ free
            return amplitudes, float(residual @ residual - left @ left)
        kept &= ~wrong
    return np.zeros(len(free)), 0.0
