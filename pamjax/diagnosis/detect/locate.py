"""Location of the misfit of the baseline: boxes of pressure, contraction, time and direction of motion.

A box has one sentence, which is true in each of its parts. The mean deviation of a part can have the opposite
sign beyond noise. The sentence then states the trend, or the lowest and the highest mean with their places.
Overlapping boxes divide the excess misfit of a row in proportion to their squared deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.detect.regions import (
    LENGTHENING,
    SHORTENING,
    STILL,
    RecordingAxes,
    build_axes,
    split_range,
)
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit, compute_unabsorbed_effect
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.problem.dataset import CHANNELS

#: Models from which a box deviates, as text.
_BASELINE, _MODEL = "the baseline", "the model with the named mechanisms"

#: Directions of motion as text.
_DIRECTION_TEXTS = {SHORTENING: "shortening", STILL: "at rest", LENGTHENING: "lengthening"}


@dataclass(frozen=True)
class Box:
    """A box in channel, direction, pressure, contraction and time that contains misfit; a region in reports.

    Attributes:
        channel: "force" or "diameter".
        direction: "shortening", "lengthening" or "both".
        pressure: lowest and highest, Pa.
        contraction: lowest and highest.
        time: first and last, s; row numbers in a static table.
        share: part of the excess misfit in the box; overlapping boxes divide it.
        description: one sentence.
    """

    channel: str
    direction: str
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
        sizes = [_compute_rms(fit.noise.standardise(candidate_effect, c)) for c in range(len(CHANNELS))]
        for c, size in enumerate(sizes):
            if size > 0 and size >= settings.min_box_rms_ratio * max(sizes):
                standardised = _standardise_channel(problem, fit, candidate_effect, c)
                boxes.append(_build_box(problem, baseline, axes, c, standardised**2, candidate_effect[c]))
    return _divide_shares(problem, baseline, residual, boxes)


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
    kept = [
        b
        for b, e in zip(boxes, excess, strict=True)
        if e > settings.min_channel_excess_share * max(excess, default=0.0)
    ]
    return _divide_shares(
        problem,
        fit,
        residual,
        [_build_box(problem, fit, axes, c, weight, residual[c], reference) for c, weight in kept],
    )


def _compute_rms(standardised: np.ndarray) -> float:
    finite = standardised[np.isfinite(standardised)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0


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
    weight,
    signed,
    reference: str = _BASELINE,
) -> _UnsharedBox:
    settings = problem.settings
    rows = np.flatnonzero(np.nan_to_num(weight) > 0)
    weights = weight[rows]
    pressure, contraction, time = (
        _compute_weighted_range(settings, v[rows], weights)
        for v in (axes.pressure, axes.contraction, axes.time)
    )
    direction = _find_direction(settings, axes.direction[rows], weights)
    inside = np.isfinite(weight)
    for values, (low, high) in (
        (axes.pressure, pressure),
        (axes.contraction, contraction),
        (axes.time, time),
    ):
        inside &= (values >= low) & (values <= high)
    if direction != "both":
        inside &= axes.direction == (SHORTENING if direction == "shortening" else LENGTHENING)
    channel, channel_noise = problem.channels[c], fit.noise.by_channel[c]
    sd = np.zeros(weight.size) if channel_noise is None else channel_noise.sd
    description = _format_box(
        settings, channel, direction, pressure, contraction, signed, inside, axes, sd, reference
    )
    box = Box(channel, direction, pressure, contraction, time, 0.0, description)
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


def _find_direction(settings: DiagnosisSettings, direction: np.ndarray, weights: np.ndarray) -> str:
    sides = {sign: weights[direction == sign].sum() for sign in (SHORTENING, LENGTHENING)}
    moving = sum(sides.values())
    # At fixed length there is no direction of motion.
    if moving < settings.min_moving_misfit_share * weights.sum():
        return "both"
    if sides[SHORTENING] < settings.min_direction_share * moving:
        return "lengthening"
    return "shortening" if sides[LENGTHENING] < settings.min_direction_share * moving else "both"


def _divide_shares(
    problem: LibraryProblem, fit: ModelFit, residual: np.ndarray, regions: Sequence[_UnsharedBox]
) -> list[Box]:
    """Return the boxes with their shares of the excess squared residual, the largest first."""
    excess = []
    for c in range(len(CHANNELS)):
        standardised = _standardise_channel(problem, fit, residual, c)
        excess.append(np.where(np.isfinite(standardised), standardised**2 - 1, 0.0))
    parts = np.array([excess[problem.channels.index(r.box.channel)] @ d for r, d in _divide_rows(regions)])
    # Outside the boxes the residual may be below its noise.
    total = max(float(np.sum(excess)), float(np.clip(parts, 0.0, None).sum()))
    shares = np.clip(parts / total, 0.0, 1.0) if np.sum(excess) > 0 else np.zeros(len(regions))
    boxes = [replace(r.box, share=float(share)) for r, share in zip(regions, shares, strict=True)]
    return sorted(boxes, key=lambda box: -box.share)[: problem.settings.max_boxes]


def _divide_rows(regions: Sequence[_UnsharedBox]) -> list[tuple[_UnsharedBox, np.ndarray]]:
    """Return each region with its part of each row, (n,): 1 where no other region contains the row."""
    out = []
    for region in regions:
        same_channel = [r for r in regions if r.box.channel == region.box.channel]
        weight = sum(r.weight for r in same_channel)
        count = sum(r.inside.astype(float) for r in same_channel)
        equal_part = region.inside / np.maximum(count, 1.0)
        part = np.where(weight > 0, region.weight / np.where(weight > 0, weight, 1.0), equal_part)
        out.append((region, part))
    return out


def _format_box(
    settings: DiagnosisSettings,
    channel,
    direction,
    pressure,
    contraction,
    signed,
    inside,
    axes: RecordingAxes,
    sd,
    reference: str = _BASELINE,
) -> str:
    unit, scale = DISPLAY_UNIT[channel], to_display(channel, 1.0)
    where = f"Between {pressure[0] / 1e3:.0f} and {pressure[1] / 1e3:.0f} kPa"
    if contraction[1] - contraction[0] > 1e-3:
        where += f", {100 * contraction[0]:z.0f} to {100 * contraction[1]:z.0f} % contracted"
    parts = _split_box(settings, inside, axes)
    shortens, lengthens = (
        _compute_one_sided_rms(settings, signed[inside & (axes.direction == sign)])
        for sign in (SHORTENING, LENGTHENING)
    )
    is_mixed = any(
        _has_both_signs(signed, sd, [p for p in parts if axes.direction[p[0]] == sign])
        for sign in (SHORTENING, LENGTHENING)
    )
    is_by_direction = direction == "both" and not is_mixed
    if is_by_direction and shortens is not None and lengthens is not None and shortens * lengthens < 0:
        return (
            f"{where}, {channel} is {_format_difference(lengthens, scale, unit)} than {reference} while the"
            f" muscle lengthens and {_format_difference(shortens, scale, unit)} while it shortens."
        )
    values = signed[inside]
    typical = _compute_signed_rms(values) or 0.0
    sentence = f"{where}, {channel} is {_format_difference(typical, scale, unit)} than {reference}"
    if _compute_one_sided_rms(settings, values) is None:
        sentence = _format_trend(settings, where, channel, values, inside, axes, scale, unit, reference) or (
            f"{where}, {channel} is about {_format_size(typical, scale, unit)} higher or lower than"
            f" {reference}"
        )
    elif _has_both_signs(signed, sd, parts):
        sentence = _format_trend(settings, where, channel, values, inside, axes, scale, unit, reference) or (
            f"{where}, {channel} is {_format_extremes(settings, signed, parts, axes, scale, unit)}"
            f" than {reference}"
        )
    if direction != "both":
        sentence += f" while the muscle {'shortens' if direction == 'shortening' else 'lengthens'}"
    return f"{sentence}."


def _split_box(settings: DiagnosisSettings, inside: np.ndarray, axes: RecordingAxes) -> list[np.ndarray]:
    """Return the rows of each part of a box: ranges of pressure and of contraction in each direction."""
    rows = np.flatnonzero(inside)
    if not rows.size:
        return []
    all_rows = np.ones(rows.size, dtype=bool)
    pressure_ranges, contraction_ranges = (
        split_range(x[rows], settings.ranges_per_box) or [all_rows] for x in (axes.pressure, axes.contraction)
    )
    directions = [axes.direction[rows] == sign for sign in (SHORTENING, STILL, LENGTHENING)]
    parts = [rows[p & c & d] for p in pressure_ranges for c in contraction_ranges for d in directions]
    return [part for part in parts if part.size >= max(1, settings.min_part_share * rows.size)]


def _has_both_signs(signed: np.ndarray, sd: np.ndarray, parts: Sequence[np.ndarray]) -> bool:
    """Return whether the mean deviations of parts have both signs, beyond the noise of a sample."""
    means = [float(np.mean(signed[p])) for p in parts]
    significant = [mean for mean, p in zip(means, parts, strict=True) if abs(mean) > np.mean(sd[p])]
    return min(significant, default=0.0) < 0 < max(significant, default=0.0)


def _format_extremes(
    settings: DiagnosisSettings, signed, parts: Sequence[np.ndarray], axes: RecordingAxes, scale, unit
) -> str:
    """Return the lowest and the highest mean deviation of parts, with their places if these differ."""
    low, high = (pick(parts, key=lambda p: float(np.mean(signed[p]))) for pick in (min, max))
    rows, places = np.concatenate(parts), [[], []]
    for values, size, name in ((axes.pressure, 1e-3, "kPa"), (axes.contraction, 100, "% contracted")):
        means = [float(np.mean(values[part])) for part in (low, high)]
        if abs(means[1] - means[0]) > settings.min_part_distance_share * np.ptp(values[rows]):
            for place, x in zip(places, means, strict=True):
                place.append(f"{size * x:z.0f} {name}")
    texts = []
    for part, place in zip((low, high), places, strict=True):
        remarks = [f"near {', '.join(place)}"] if place else []
        if axes.direction[low[0]] != axes.direction[high[0]]:
            remarks.append(_DIRECTION_TEXTS[int(axes.direction[part[0]])])
        difference = _format_difference(float(np.mean(signed[part])), scale, unit)
        texts.append(difference + (f" ({', '.join(remarks)})" if remarks else ""))
    return f"between {texts[0]} and {texts[1]}"


def _format_trend(
    settings: DiagnosisSettings,
    where,
    channel,
    values,
    inside,
    axes: RecordingAxes,
    scale,
    unit,
    reference: str = _BASELINE,
) -> str:
    """Return the trend of a deviation with pressure or contraction; empty without a trend."""
    for name, along in (("pressure", axes.pressure), ("contraction", axes.contraction)):
        x = along[inside]
        if np.ptp(x) > 0 and abs(float(np.corrcoef(x, values)[0, 1])) > settings.min_trend_correlation:
            ends = (
                x <= np.quantile(x, settings.trend_end_share),
                x >= np.quantile(x, 1 - settings.trend_end_share),
            )
            low, high = (float(np.mean(values[end])) for end in ends)
            verb = "increases" if high > low else "decreases"
            first, last = (_format_difference(v, scale, unit) for v in (low, high))
            return f"{where}, {channel} relative to {reference} {verb} with {name}, from {first} to {last}"
    return ""


def _compute_signed_rms(values: np.ndarray) -> float | None:
    """Return the root mean square with the sign of the mean; None for fewer than three values."""
    if values.size < 3:
        return None
    return float(np.sign(np.mean(values)) * np.sqrt(np.mean(values**2)))


def _compute_one_sided_rms(settings: DiagnosisSettings, values: np.ndarray) -> float | None:
    """Return the signed rms of a deviation; None if its mean is small compared with its rms."""
    signed_rms = _compute_signed_rms(values)
    if signed_rms is None:
        return None
    is_one_sided = abs(float(np.mean(values))) >= settings.min_one_sided_ratio * abs(signed_rms)
    return signed_rms if is_one_sided else None


def _format_difference(value: float, scale: float, unit: str) -> str:
    return f"about {_format_size(value, scale, unit)} {'higher' if value > 0 else 'lower'}"


def _format_size(value: float, scale: float, unit: str) -> str:
    size = abs(value) * scale
    return f"{size:.0f} {unit}" if size >= 100 else f"{size:.2g} {unit}"
