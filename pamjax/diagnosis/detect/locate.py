"""Location of the misfit of the baseline: regions of pressure, contraction, time and direction of motion.

A region has one sentence (`region_sentence.py`). Overlapping regions divide the excess misfit of a row in
proportion to their squared deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.diagnosis.detect.recording_axes import LENGTHENING, SHORTENING, RecordingAxes, build_axes
from pamjax.diagnosis.detect.region_sentence import RegionDeviation, format_region
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit, compute_unabsorbed_effect
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.rms import compute_rms

#: Models from which a region deviates, as text.
_BASELINE, _MODEL = "the baseline", "the model with the named mechanisms"


@dataclass(frozen=True)
class MisfitRegion:
    """A region in channel, motion, pressure, contraction and time that contains misfit.

    Attributes:
        channel: "force" or "diameter".
        motion: "shortening", "lengthening" or "both".
        pressure: lowest and highest, Pa.
        contraction: lowest and highest.
        time: first and last, s; row numbers in a static table.
        share: part of the excess misfit in the region; overlapping regions divide it.
        description: one sentence.
    """

    channel: str
    motion: str
    pressure: tuple[float, float]
    contraction: tuple[float, float]
    time: tuple[float, float]
    share: float
    description: str


def locate_effects(problem: LibraryProblem, baseline: ModelFit, fit: ModelFit) -> list[MisfitRegion]:
    """Return regions of the unabsorbed effect of each mechanism, largest share first."""
    settings = problem.settings
    axes, residual = build_axes(problem), problem.measured - problem.predict(baseline.estimate.values)
    regions = []
    for candidate in fit.mechanisms:
        candidate_effect = compute_unabsorbed_effect(problem, fit, candidate)
        standardised = [_standardise_channel(problem, fit, candidate_effect, c) for c in range(len(CHANNELS))]
        regions += [
            _build_region(problem, baseline, axes, c, standardised[c] ** 2, candidate_effect[c])
            for c in find_changed_channels(standardised, settings)
        ]
    return _divide_shares(problem, baseline, residual, regions)


def find_changed_channels(standardised: Sequence[np.ndarray], settings: DiagnosisSettings) -> list[int]:
    """Return the channels on which an effect is large enough for a region.

    Args:
        standardised: (n,) effect over the noise, by channel; NaN where it was not measured.
        settings: thresholds of the diagnosis.
    """
    sizes = [compute_rms(values, default=0.0) for values in standardised]
    return [
        c
        for c, (values, size) in enumerate(zip(standardised, sizes, strict=True))
        if size >= settings.min_region_rms_ratio * max(sizes)
        and np.nansum(values**2) >= settings.min_region_chi2
    ]


def locate_residual(problem: LibraryProblem, fit: ModelFit) -> list[MisfitRegion]:
    """Return a region of the residual beyond noise for each channel, largest share first."""
    settings, reference = problem.settings, _MODEL if fit.mechanisms else _BASELINE
    axes, residual = build_axes(problem), problem.measured - problem.predict(fit.estimate.values)
    regions, excess = [], []
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
        regions.append((c, weight))
    reported = [
        b
        for b, e in zip(regions, excess, strict=True)
        if e > settings.min_channel_excess_share * max(excess, default=0.0)
    ]
    return _divide_shares(
        problem,
        fit,
        residual,
        [_build_region(problem, fit, axes, c, weight, residual[c], reference) for c, weight in reported],
    )


def _standardise_channel(problem: LibraryProblem, fit: ModelFit, values: np.ndarray, c: int) -> np.ndarray:
    """Return one channel over its noise, (n,), also in held-out rows; NaN where it was not measured."""
    channel_noise = fit.noise.by_channel[c]
    if channel_noise is None:
        return np.full(problem.n, np.nan)
    return np.where(np.isfinite(problem.measured[c]), values[c] / channel_noise.sd, np.nan)


@dataclass(frozen=True, eq=False)
class _UnsharedRegion:
    """A region whose share is not computed yet.

    Attributes:
        region: the region with a share of zero.
        inside: (n,) mask of its rows.
        weight: (n,) squared deviation that it describes.
    """

    region: MisfitRegion
    inside: np.ndarray
    weight: np.ndarray


def _build_region(
    problem: LibraryProblem,
    fit: ModelFit,
    axes: RecordingAxes,
    c: int,
    weight: np.ndarray,
    deviation: np.ndarray,
    reference: str = _BASELINE,
) -> _UnsharedRegion:
    """Return the region of a squared deviation, (n,), with the sentence of the deviation, (n,), SI."""
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
    sentence = format_region(
        RegionDeviation(
            channel, motion, pressure, contraction, axes, inside, deviation, sd, reference, settings
        )
    )
    region = MisfitRegion(channel, motion, pressure, contraction, time, 0.0, sentence)
    return _UnsharedRegion(region, inside, np.where(inside, np.nan_to_num(weight), 0.0))


def _compute_weighted_range(
    settings: DiagnosisSettings, values: np.ndarray, weights: np.ndarray
) -> tuple[float, float]:
    """Return two weighted quantiles of values: the limits of a region on one axis."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    positions = np.searchsorted(
        total, np.array((settings.region_low_quantile, settings.region_high_quantile)) * total[-1]
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
    problem: LibraryProblem, fit: ModelFit, residual: np.ndarray, regions: Sequence[_UnsharedRegion]
) -> list[MisfitRegion]:
    """Return the regions with their shares of the excess squared residual, the largest first."""
    excess = []
    for c in range(len(CHANNELS)):
        standardised = _standardise_channel(problem, fit, residual, c)
        excess.append(np.where(np.isfinite(standardised), standardised**2 - 1, 0.0))
    parts = np.array([excess[problem.channels.index(b.region.channel)] @ d for b, d in _divide_rows(regions)])
    # Outside the regions the residual may be below its noise.
    total = max(float(np.sum(excess)), float(np.clip(parts, 0.0, None).sum()))
    shares = np.clip(parts / total, 0.0, 1.0) if np.sum(excess) > 0 else np.zeros(len(regions))
    shared_regions = [replace(b.region, share=float(share)) for b, share in zip(regions, shares, strict=True)]
    return sorted(shared_regions, key=lambda region: -region.share)[: problem.settings.max_regions]


def _divide_rows(regions: Sequence[_UnsharedRegion]) -> list[tuple[_UnsharedRegion, np.ndarray]]:
    """Return each region with its part of each row, (n,): 1 where no other region contains the row."""
    out = []
    for region in regions:
        same_channel = [b for b in regions if b.region.channel == region.region.channel]
        weight = sum(b.weight for b in same_channel)
        count = sum(b.inside.astype(float) for b in same_channel)
        equal_part = region.inside / np.maximum(count, 1.0)
        part = np.where(weight > 0, region.weight / np.where(weight > 0, weight, 1.0), equal_part)
        out.append((region, part))
    return out
