"""What a mechanism would do to this recording, and how much of the misfit looks like it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from pamjax.compile.parallel import abreast
from pamjax.diagnosis.library.candidates import COURSES, Form
from pamjax.diagnosis.library.library_problem import COSTLY, Problem
from pamjax.diagnosis.noise.estimate import Whitening
from pamjax.diagnosis.refit.least_squares import Refit, believed, coordinates, driven, room


@dataclass(frozen=True, eq=False)
class Signature:
    """A form before a recording.

    Attributes:
        form: which.
        gain: χ² that its best amplitudes within their limits would take away, in the linear limit.
        amplitudes: those, SI.
        directions: (k, size) unit vectors, white, freed of what the numbers that move absorb.
        either_sign: (k,) whether an amplitude may be negative: friction drives nothing.
        norm: (k,) length of what is left of a direction, white, by its amplitude, SI; one where nothing is.
    """

    form: Form
    gain: float
    amplitudes: np.ndarray
    directions: np.ndarray
    either_sign: np.ndarray
    norm: np.ndarray


class Absorbed:
    """What numbers that move absorb of a direction, under their priors: least squares with prior rows.

    Args:
        at: the refit.
        but: which of its numbers absorb nothing.
    """

    def __init__(self, at: Refit, but: Sequence[int] = ()) -> None:
        self.size = at.residual.size
        stacked = np.delete(np.concatenate([at.jacobian, np.diag(1 / at.prior)]), list(but), axis=1)
        # Columns differ by many orders of magnitude; only their span counts.
        norm = np.linalg.norm(stacked, axis=0)
        stacked = stacked[:, norm > 0] / norm[norm > 0]
        left, weights, _ = np.linalg.svd(stacked, full_matrices=False)
        self.basis = left[:, weights > 1e-7]

    def out_of(self, directions: np.ndarray) -> np.ndarray:
        """(k, size) white directions, with or without priors, as (k, size + priors) rows of what is left."""
        extended = np.zeros((*directions.shape[:-1], self.basis.shape[0]))
        extended[..., : directions.shape[-1]] = directions
        return extended - (extended @ self.basis) @ self.basis.T


def whole_residual(found: Problem, at: Refit) -> np.ndarray:
    """(size + priors,) what a refit leaves, white, and how far its numbers are from what is believed of them.

    What a form relieves a strained ruler of is part of what it explains.
    """
    moved = list(at.moved)
    mean, _ = believed(found, moved)
    return np.concatenate([at.residual, (mean - coordinates(found, moved, at.values)) / at.prior])


class _Left:
    """What a refit leaves, and what may explain it: amplitudes, and numbers that were driven to their limits.

    Such a number absorbs nothing of what would drive it further, and may come back. (In a p-value it absorbs
    as all others do: that a lab was wrong by three standard deviations is no mismatch.)
    """

    def __init__(self, found: Problem, at: Refit, absorbed: Absorbed) -> None:
        there = driven(found, at)
        self.absorbed = Absorbed(at, there.tolist()) if there.size else absorbed
        self.residual = whole_residual(found, at)
        stacked = np.concatenate([at.jacobian, np.diag(1 / at.prior)]).T
        low, high = room(found, at)
        self.driven, self.limits = self.absorbed.out_of(stacked[there]), (low[there], high[there])
        self.least = _best(self.driven, self.residual, *self.limits)[1]

    def explained(self, free: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
        """Best amplitudes of what is not absorbed, within their limits, and the χ² that they take away."""
        rows = np.concatenate([free, self.driven])
        limits = (np.concatenate(pair) for pair in zip((low, high), self.limits, strict=True))
        amplitudes, gain = _best(rows, self.residual, *limits)
        return amplitudes[: len(free)], gain - self.least


def signatures(found: Problem, white: Whitening, at: Refit, candidates: Sequence[Form]) -> list[Signature]:
    """The signature of each form at a refit, and how much of its residual it would explain."""
    absorbed = Absorbed(at)
    left = _Left(found, at, absorbed)
    slopes = _slopes(found, at, candidates)
    return [
        _signature(found, white, at, form, slopes[k], absorbed, left) for k, form in enumerate(candidates)
    ]


def _slopes(found: Problem, at: Refit, candidates: Sequence[Form]) -> dict[int, np.ndarray]:
    """Derivative of what the bench shows by each form's amplitudes, (k, 2, n), in few sweeps."""

    def at_one_point(together: list[int]) -> dict[int, np.ndarray]:
        values = at.values.copy()
        for k in together:
            for name, value in _swept(candidates[k]).items():
                place = found.place(name)
                values[place] = np.clip(value, found.low[place], found.high[place])
        names = sorted({name for k in together for name in candidates[k].amplitudes})
        slopes = dict(zip(names, found.slopes(values, map(found.place, names))[1], strict=True))
        return {
            k: np.stack([slopes[name] for name in candidates[k].amplitudes]) * _course(found, candidates[k])
            for k in together
        }

    points = abreast(at_one_point, _together(found, at, candidates))
    return {k: slope for point in points for k, slope in point.items()}


def _together(found: Problem, at: Refit, candidates: Sequence[Form]) -> list[list[int]]:
    """Which forms' derivatives are taken at one point: what is switched off has no shape for others."""
    alone, points, on = [], [], found.on(at.values)
    for k, form in enumerate(candidates):
        shape = _swept(form)
        if form.id == COSTLY or (shape and form.id in on):
            alone.append([k])
            continue
        fits = (p for p in points if all(p[1].get(name, value) == value for name, value in shape.items()))
        members, shapes = next(fits, ([], {}))
        if not members:
            points.append((members, shapes))
        members.append(k)
        shapes.update(shape)
    return alone + [members for members, _ in points]


def _swept(form: Form) -> dict[str, float]:
    """The shape at which a form's derivative is taken."""
    course = COURSES.get(form.amplitudes[0])
    return course.everywhere if course else form.shape


def _course(found: Problem, form: Form) -> np.ndarray | float:
    """What the derivative there is to be multiplied with for this form's own shape."""
    course, time = COURSES.get(form.amplitudes[0]), found.case.recording.time
    if course is None or time is None:
        return 1.0
    return course.at(time, form.shape) / course.at(time, course.everywhere)


def _signature(found, white, at, form, slopes, absorbed: Absorbed, left: _Left) -> Signature:
    places = [found.place(name) for name in form.amplitudes]
    low, high = found.low[places] - at.values[places], found.high[places] - at.values[places]
    slopes = np.nan_to_num(white(slopes))
    free = absorbed.out_of(slopes)
    loose = free if left.absorbed is absorbed else left.absorbed.out_of(slopes)
    amplitudes, gain = left.explained(loose, low, high)
    norm = np.linalg.norm(free, axis=1)
    norm = np.where(norm > 0, norm, 1.0)
    return Signature(form, gain, amplitudes, free / norm[:, None], low < 0, norm)


def _best(
    free: np.ndarray, residual: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """Amplitudes of least squares within their limits, and the χ² they take away.

    Without limits a form that hardly shows here explains anything, by an amplitude that no muscle has.
    """
    amplitudes, norm = np.zeros(len(free)), np.linalg.norm(free, axis=1)
    kept = (norm > 1e-12) & (high > low)
    if not kept.any():
        return amplitudes, 0.0
    # Columns of length one: newtons and pascals are many orders of magnitude apart.
    norm = norm[kept]
    axes, across = np.linalg.qr((free[kept] / norm[:, None]).T)
    end = lsq_linear(across, axes.T @ residual, (low[kept] * norm, high[kept] * norm), method="bvls")
    amplitudes[kept] = end.x / norm
    left = residual - amplitudes @ free
    return amplitudes, float(residual @ residual - left @ left)
