"""Location of the misfit of the baseline: boxes of pressure, contraction, time and direction of motion.

A box has one sentence (`box_sentence.py`). Overlapping boxes divide the excess misfit of a row in proportion
to their squared deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.detect.box_sentence import BoxDeviation, format_box
from pamjax.diagnosis.detect.regions import LENGTHENING, SHORTENING, RecordingAxes, build_axes
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit, compute_unabsorbed_effect
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.rms import compute_rms

#: Models from which a box deviates, as text.
_BASELINE, _MODEL = "the baseline", "the model with the named mechanisms"


@dataclass(frozen=True)
class Box:
    """A box in channel, motion, pressure, contraction and time that contains misfit; a region in reports.

    Attributes:
        channel: "force" or "diameter".
        motion: "shortening", "lengthening" or "both".
        pressure: lowest and highest, Pa.
        contraction: lowest and highest.
        time: first and last, s; row numbers in a static table.
        share: part of the excess misfit in the box; overlapping boxes divide it.
        description: one sentence.
    """

    channel: str
    motion: str
    pressure: tuple[float, float]
    contraction: tuple[float, float]
    time: tuple[float, float]
    share: float
    description: str


def locate_effects(problem: LibraryProblem, baseline: ModelFit, fit: ModelFit) -> list[Box]:
    """Return boxes of the effect of each mechanism that the baseline does not absorb, largest share first."""
    settings = problem.settings
    axes, residual = build_axes(problem), problem.measured - problem.predict(baseline.estimate.values)
    boxes = []
    for candidate in fit.mechanisms:
        candidate_effect = compute_unabsorbed_effect(problem, fit, candidate)
        standardised = [_standardise_channel(problem, fit, candidate_effect, c) for c in range(len(CHANNELS))]
        boxes += [
            _build_box(problem, baseline, axes, c, standardised[c] ** 2, candidate_effect[c])
            for c in find_changed_channels(standardised, settings)
        ]
    return _divide_shares(problem, baseline, residual, boxes)


def find_changed_channels(standardised: Sequence[np.ndarray], settings: DiagnosisSettings) -> list[int]:
    """Return the channels on which an effect is large enough for a box.

    Args:
        standardised: (n,) effect over the noise, by channel; NaN where it was not measured.
        settings: thresholds of the diagnosis.
    """
    sizes = [compute_rms(values, default=0.0) for values in standardised]
    return [
        c
        for c, (values, size) in enumerate(zip(standardised, sizes, strict=True))
        if size >= settings.min_box_rms_ratio * max(sizes) and np.nansum(values**2) >= settings.min_box_chi2
    ]


def locate_residual(problem: LibraryProblem, fit: ModelFit) -> list[Box]:
    """Return a box of the residual beyond noise for each channel, largest share first."""
    settings, reference = problem.settings, _MODEL if fit.mechanisms else _BASELINE
    axes, residual = build_axes(problem), problem.measured - problem.predict(fit.estimate.values)
    boxes, excess = [], []
    for c in range(len(CHANNELS)):
        standardised = _standardise_channel(problem, fit, residual, c)
        measured_rows = np.flatnonzero(np.isfinite(standardised))
        if measured_rows.size < settings.smoothing_rows:
            continue
        square = np.convolve(
            standardised[measured_rows] ** 2,
            np.ones(settings.smoothing_rows) / settings.smoothing_rows,
            mode="same",
        )
        # Noise alone exceeds this limit, one standard deviation of the mean square, in one of six cases.
        weight = np.full(problem.n, np.nan)
        weight[measured_rows] = np.where(square - 1 > np.sqrt(2 / settings.smoothing_rows), square - 1, 0.0)
        excess.append(np.nansum(weight))
        boxes.append((c, weight))
    reported = [
        b
        for b, e in zip(boxes, excess, strict=True)
        if e > settings.min_channel_excess_share * max(excess, default=0.0)
    ]
    return _divide_shares(
        problem,
        fit,
        residual,
        [_build_box(problem, fit, axes, c, weight, residual[c], reference) for c, weight in reported],
    )


def _standardise_channel(problem: LibraryProblem, fit: ModelFit, values: np.ndarray, c: int) -> np.ndarray:
    """Return one channel over its noise, (n,), also in held-out rows; NaN where it was not measured."""
    channel_noise = fit.noise.by_channel[c]
    if channel_noise is None:
        return np.full(problem.n, np.nan)
    return np.where(np.isfinite(problem.measured[c]), values[c] / channel_noise.sd, np.nan)


@dataclass(frozen=True, eq=False)
class _UnsharedBox:
    """A box whose share is not computed yet.

    Attributes:
        box: the box with a share of zero.
        inside: (n,) mask of its rows.
        weight: (n,) squared deviation that it describes.
    """

    box: Box
    inside: np.ndarray
    weight: np.ndarray


def _build_box(
    problem: LibraryProblem,
    fit: ModelFit,
    axes: RecordingAxes,
    c: int,
    weight: np.ndarray,
    deviation: np.ndarray,
    reference: str = _BASELINE,
) -> _UnsharedBox:
    """Return the box of a squared deviation, (n,), with the sentence of the deviation, (n,), SI."""
    settings = problem.settings
    rows = np.flatnonzero(np.nan_to_num(weight) > 0)
    weights = weight[rows]
    pressure, contraction, time = (
        _compute_weighted_range(settings, v[rows], weights)
        for v in (axes.pressure, axes.contraction, axes.time)
    )
    motion = _find_motion(settings, axes.motion[rows], weights)
    inside = np.isfinite(weight)
    for values, (low, high) in (
        (axes.pressure, pressure),
        (axes.contraction, contraction),
        (axes.time, time),
    ):
        inside &= (values >= low) & (values <= high)
    if motion != "both":
        inside &= axes.motion == (SHORTENING if motion == "shortening" else LENGTHENING)
    channel, channel_noise = problem.channels[c], fit.noise.by_channel[c]
    sd = np.zeros(weight.size) if channel_noise is None else channel_noise.sd
    sentence = format_box(
        BoxDeviation(channel, motion, pressure, contraction, axes, inside, deviation, sd, reference, settings)
    )
    box = Box(channel, motion, pressure, contraction, time, 0.0, sentence)
    return _UnsharedBox(box, inside, np.where(inside, np.nan_to_num(weight), 0.0))


def _compute_weighted_range(
    settings: DiagnosisSettings, values: np.ndarray, weights: np.ndarray
) -> tuple[float, float]:
    """Return two weighted quantiles of values: the limits of a box on one axis."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    positions = np.searchsorted(
        total, np.array((settings.box_low_quantile, settings.box_high_quantile)) * total[-1]
    )
    low, high = values[order][np.minimum(positions, len(order) - 1)]
    return float(low), float(high)


def _find_motion(settings: DiagnosisSettings, motion: np.ndarray, weights: np.ndarray) -> str:
    """Return the motion in which nearly all of some weights occur; "both" if there is none."""
    sides = {sign: weights[motion == sign].sum() for sign in (SHORTENING, LENGTHENING)}
    moving = sum(sides.values())
    # At fixed length there is no motion.
    if moving < settings.min_moving_misfit_share * weights.sum():
        return "both"
    if sides[SHORTENING] < settings.min_direction_share * moving:
        return "lengthening"
    return "shortening" if sides[LENGTHENING] < settings.min_direction_share * moving else "both"


def _divide_shares(
    problem: LibraryProblem, fit: ModelFit, residual: np.ndarray, boxes: Sequence[_UnsharedBox]
) -> list[Box]:
    """Return the boxes with their shares of the excess squared residual, the largest first."""
    excess = []
    for c in range(len(CHANNELS)):
        standardised = _standardise_channel(problem, fit, residual, c)
        excess.append(np.where(np.isfinite(standardised), standardised**2 - 1, 0.0))
    parts = np.array([excess[problem.channels.index(b.box.channel)] @ d for b, d in _divide_rows(boxes)])
    # Outside the boxes the residual may be below its noise.
    total = max(float(np.sum(excess)), float(np.clip(parts, 0.0, None).sum()))
    shares = np.clip(parts / total, 0.0, 1.0) if np.sum(excess) > 0 else np.zeros(len(boxes))
    shared_boxes = [replace(b.box, share=float(share)) for b, share in zip(boxes, shares, strict=True)]
    return sorted(shared_boxes, key=lambda box: -box.share)[: problem.settings.max_boxes]


def _divide_rows(boxes: Sequence[_UnsharedBox]) -> list[tuple[_UnsharedBox, np.ndarray]]:
    """Return each box with its part of each row, (n,): 1 where no other box contains the row."""
    out = []
    for box in boxes:
        same_channel = [b for b in boxes if b.box.channel == box.box.channel]
        weight = sum(b.weight for b in same_channel)
        count = sum(b.inside.astype(float) for b in same_channel)
        equal_part = box.inside / np.maximum(count, 1.0)
        part = np.where(weight > 0, box.weight / np.where(weight > 0, weight, 1.0), equal_part)
        out.append((box, part))
    return out
