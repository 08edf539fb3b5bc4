"""Where a recording departs from its baseline: boxes of pressure, contraction, time and direction.

A sentence about a box holds in each of its parts. Where the mean departure of a part has the other sign
beyond noise, the sentence gives the trend, or the lowest and the highest mean with their places. Where boxes
overlap, they divide the excess there in proportion to the squared departure that each speaks of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.detect.regions import LENGTHENING, SHORTENING, STILL, RecordingAxes, build_axes, ranges
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, compute_effect
from pamjax.infer.problem.dataset import CHANNELS

#: A box holds the middle of the squared misfit, between these shares of it, on each axis.
BOX_QUANTILES = (0.05, 0.95)
#: Share of the squared misfit from which a direction counts.
MIN_DIRECTION_SHARE = 0.15
#: Rms on a channel, over that on the channel where it is largest, from which a name is located there.
MIN_BOX_RMS_RATIO = 0.5
#: Most boxes.
MAX_BOXES = 5
#: Neighbours over which the square of a residual is averaged, so that noise is told from misfit.
SMOOTHING_ROWS = 7

#: Mean of a departure over its rms from which it has one sign.
MIN_ONE_SIDED_RATIO = 0.4

#: Correlation with pressure or contraction from which a departure that changes sign has a trend.
MIN_TREND_CORRELATION = 0.9
#: Share of the samples at either end of it that say from what to what.
TREND_END_SHARE = 0.1

#: Into how many ranges of pressure and of contraction a box is cut, and the share of its rows from which a
#: part counts.
RANGES, PART = 5, 0.02
#: Share of a box's range by which two parts differ in place.
APART = 0.2

#: Directions in words.
WAYS = {SHORTENING: "shortening", STILL: "at rest", LENGTHENING: "lengthening"}


@dataclass(frozen=True)
class Box:
    """Where a misfit is.

    Attributes:
        channel: "force" or "diameter".
        direction: "shortening", "lengthening" or "both".
        pressure: from, to, Pa.
        contraction: from, to.
        time: from, to, s; row numbers in a static map.
        share: part of the excess misfit that is found there; boxes that overlap divide theirs.
        description: one plain sentence.
    """

    channel: str
    direction: str
    pressure: tuple[float, float]
    contraction: tuple[float, float]
    time: tuple[float, float]
    share: float
    description: str


def locate_effects(problem: LibraryProblem, baseline: CandidateFit, fit: CandidateFit) -> list[Box]:
    """Boxes of what each name does to the recording beyond what the baseline absorbs; largest share first."""
    axes, residual = build_axes(problem), problem.measured - problem.predict(baseline.estimate.values)
    boxes = []
    for candidate in fit.mechanisms:
        candidate_effect = compute_effect(problem, fit, candidate)
        sizes = [_compute_rms(fit.noise.standardise(candidate_effect, c)) for c in range(len(CHANNELS))]
        for c, size in enumerate(sizes):
            if size > 0 and size >= MIN_BOX_RMS_RATIO * max(sizes):
                standard = _standardise_channel(problem, fit, candidate_effect, c)
                boxes.append(_build_box(baseline, axes, c, standard**2, candidate_effect[c]))
    return _divide_shares(problem, baseline, residual, boxes)


def locate_residual(problem: LibraryProblem, fit: CandidateFit) -> list[Box]:
    """Boxes of what a model leaves in the residual beyond noise, by channel; largest share first."""
    axes, residual = build_axes(problem), problem.measured - problem.predict(fit.estimate.values)
    boxes, excess = [], []
    for c in range(len(CHANNELS)):
        standard = _standardise_channel(problem, fit, residual, c)
        measured_rows = np.flatnonzero(np.isfinite(standard))
        if measured_rows.size < SMOOTHING_ROWS:
            continue
        square = np.convolve(
            standard[measured_rows] ** 2, np.ones(SMOOTHING_ROWS) / SMOOTHING_ROWS, mode="same"
        )
        # Averaged over a group, noise alone reaches this far in one of six.
        weight = np.full(problem.n, np.nan)
        weight[measured_rows] = np.where(square - 1 > np.sqrt(2 / SMOOTHING_ROWS), square - 1, 0.0)
        excess.append(np.nansum(weight))
        boxes.append((c, weight))
    kept = [b for b, e in zip(boxes, excess, strict=True) if e > 0.2 * max(excess, default=0.0)]
    return _divide_shares(
        problem, fit, residual, [_build_box(fit, axes, c, weight, residual[c]) for c, weight in kept]
    )


def _compute_rms(standard: np.ndarray) -> float:
    there = np.isfinite(standard)
    return float(np.sqrt(np.mean(standard[there] ** 2))) if there.any() else 0.0


def _standardise_channel(
    problem: LibraryProblem, fit: CandidateFit, values: np.ndarray, c: int
) -> np.ndarray:
    """One channel over its noise at every row where it was measured, held out or not, (n,)."""
    channel_noise = fit.noise.channels[c]
    if channel_noise is None:
        return np.full(problem.n, np.nan)
    return np.where(np.isfinite(problem.measured[c]), values[c] / channel_noise.sd, np.nan)


@dataclass(frozen=True, eq=False)
class _Region:
    """A box before its share is known.

    Attributes:
        box: all but the share.
        inside: (n,) its rows.
        weight: (n,) squared departure that it speaks of.
    """

    box: Box
    inside: np.ndarray
    weight: np.ndarray


def _build_box(fit: CandidateFit, axes: RecordingAxes, c: int, weight, signed) -> _Region:
    rows = np.flatnonzero(np.nan_to_num(weight) > 0)
    weights = weight[rows]
    pressure, contraction, time = (
        _compute_weighted_range(v[rows], weights) for v in (axes.pressure, axes.contraction, axes.time)
    )
    direction = _find_direction(axes.direction[rows], weights)
    inside = np.isfinite(weight)
    for values, (low, high) in (
        (axes.pressure, pressure),
        (axes.contraction, contraction),
        (axes.time, time),
    ):
        inside &= (values >= low) & (values <= high)
    if direction != "both":
        inside &= axes.direction == (SHORTENING if direction == "shortening" else LENGTHENING)
    channel, colour = CHANNELS[c], fit.noise.channels[c]
    sd = np.zeros(weight.size) if colour is None else colour.sd
    says = _format_box(channel, direction, pressure, contraction, signed, inside, axes, sd)
    box = Box(channel, direction, pressure, contraction, time, 0.0, says)
    return _Region(box, inside, np.where(inside, np.nan_to_num(weight), 0.0))


def _compute_weighted_range(values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Quantiles of values under weights."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    positions = np.searchsorted(total, np.array(BOX_QUANTILES) * total[-1])
    low, high = values[order][np.minimum(positions, len(order) - 1)]
    return float(low), float(high)


def _find_direction(direction: np.ndarray, weights: np.ndarray) -> str:
    sides = {way: weights[direction == way].sum() for way in (SHORTENING, LENGTHENING)}
    moving = sum(sides.values())
    # At fixed length there is no direction.
    if moving < 0.5 * weights.sum():
        return "both"
    if sides[SHORTENING] < MIN_DIRECTION_SHARE * moving:
        return "lengthening"
    return "shortening" if sides[LENGTHENING] < MIN_DIRECTION_SHARE * moving else "both"


def _divide_shares(
    problem: LibraryProblem, fit: CandidateFit, residual: np.ndarray, regions: Sequence[_Region]
) -> list[Box]:
    """Return the boxes with their parts of the excess of squared residuals; at most five, largest first."""
    excess = []
    for c in range(len(CHANNELS)):
        standard = _standardise_channel(problem, fit, residual, c)
        excess.append(np.where(np.isfinite(standard), standard**2 - 1, 0.0))
    parts = np.array([excess[CHANNELS.index(r.box.channel)] @ d for r, d in divided(regions)])
    # Outside the boxes the residual may be below its noise.
    total = max(float(np.sum(excess)), float(np.clip(parts, 0.0, None).sum()))
    shares = np.clip(parts / total, 0.0, 1.0) if np.sum(excess) > 0 else np.zeros(len(regions))
    boxes = [replace(r.box, share=float(share)) for r, share in zip(regions, shares, strict=True)]
    return sorted(boxes, key=lambda box: -box.share)[:MAX_BOXES]


def divided(regions: Sequence[_Region]) -> list[tuple[_Region, np.ndarray]]:
    """Return each region with the part of each row that is its own, (n,): one where it is alone there."""
    out = []
    for one in regions:
        others = [r for r in regions if r.box.channel == one.box.channel]
        weight = sum(r.weight for r in others)
        count = sum(r.inside.astype(float) for r in others)
        alike = one.inside / np.maximum(count, 1.0)
        out.append((one, np.where(weight > 0, one.weight / np.where(weight > 0, weight, 1.0), alike)))
    return out


def _format_box(channel, direction, pressure, contraction, signed, inside, axes: RecordingAxes, sd) -> str:
    unit, scale = DISPLAY_UNIT[channel], to_display(channel, 1.0)
    where = f"Between {pressure[0] / 1e3:.0f} and {pressure[1] / 1e3:.0f} kPa"
    if contraction[1] - contraction[0] > 1e-3:
        where += f", {100 * contraction[0]:z.0f} to {100 * contraction[1]:z.0f} % contracted"
    parts = _parts(inside, axes)
    sides = ((SHORTENING, "shortens"), (LENGTHENING, "lengthens"))
    means = {word: _compute_one_sided_rms(signed[inside & (axes.direction == way)]) for way, word in sides}
    mixed = any(_mixed(signed, sd, [p for p in parts if axes.direction[p[0]] == way]) for way, _ in sides)
    shortens, lengthens = means["shortens"], means["lengthens"]
    by_way = direction == "both" and not mixed
    if by_way and shortens is not None and lengthens is not None and shortens * lengthens < 0:
        return (
            f"{where}, {channel} is {_format_difference(lengthens, scale, unit)} while the muscle"
            f" lengthens and"
            f" {_format_difference(shortens, scale, unit)} while it shortens."
        )
    values = signed[inside]
    typical = _compute_signed_rms(values) or 0.0
    sentence = f"{where}, {channel} is {_format_difference(typical, scale, unit)} than the baseline says"
    if _compute_one_sided_rms(values) is None:
        sentence = _format_trend(where, channel, values, inside, axes, scale, unit) or (
            f"{where}, {channel} departs from the baseline by about {_format_size(typical, scale, unit)}"
            f" either way"
        )
    elif _mixed(signed, sd, parts):
        sentence = _format_trend(where, channel, values, inside, axes, scale, unit) or (
            f"{where}, {channel} is {_extremes(signed, parts, axes, scale, unit)} than the baseline says"
        )
    return (
        f"{sentence} while the muscle {'shortens' if direction == 'shortening' else 'lengthens'}."
        if (direction != "both")
        else f"{sentence}."
    )


def _parts(inside: np.ndarray, at: RecordingAxes) -> list[np.ndarray]:
    """Return the rows of each part of a box: ranges of pressure and of contraction in each direction."""
    rows = np.flatnonzero(inside)
    if not rows.size:
        return []
    every = np.ones(rows.size, dtype=bool)
    pressures, contractions = (ranges(x[rows], RANGES) or [every] for x in (at.pressure, at.contraction))
    ways = [at.direction[rows] == way for way in (SHORTENING, STILL, LENGTHENING)]
    cut = [rows[p & c & way] for p in pressures for c in contractions for way in ways]
    return [part for part in cut if part.size >= max(1, PART * rows.size)]


def _mixed(signed: np.ndarray, sd: np.ndarray, parts: Sequence[np.ndarray]) -> bool:
    """Return whether the mean departures of parts have both signs, beyond the noise of a sample."""
    means = [float(np.mean(signed[p])) for p in parts]
    beyond = [mean for mean, p in zip(means, parts, strict=True) if abs(mean) > np.mean(sd[p])]
    return min(beyond, default=0.0) < 0 < max(beyond, default=0.0)


def _extremes(signed, parts: Sequence[np.ndarray], at: RecordingAxes, scale, unit) -> str:
    """Return the lowest and the highest mean departure of parts, with the places in which they differ."""
    low, high = (pick(parts, key=lambda p: float(np.mean(signed[p]))) for pick in (min, max))
    rows, near = np.concatenate(parts), [[], []]
    for values, size, name in ((at.pressure, 1e-3, "kPa"), (at.contraction, 100, "% contracted")):
        here = [float(np.mean(values[part])) for part in (low, high)]
        if abs(here[1] - here[0]) > APART * np.ptp(values[rows]):
            for place, x in zip(near, here, strict=True):
                place.append(f"{size * x:z.0f} {name}")
    said = []
    for part, place in zip((low, high), near, strict=True):
        words = [f"near {', '.join(place)}"] if place else []
        if at.direction[low[0]] != at.direction[high[0]]:
            words.append(WAYS[int(at.direction[part[0]])])
        amount = _format_difference(float(np.mean(signed[part])), scale, unit)
        said.append(amount + (f" ({', '.join(words)})" if words else ""))
    return f"between {said[0]} and {said[1]}"


def _format_trend(where, channel, values, inside, axes: RecordingAxes, scale, unit) -> str:
    """What a departure that changes sign does along pressure, or contraction; empty where it has no trend."""
    for name, along in (("pressure", axes.pressure), ("contraction", axes.contraction)):
        x = along[inside]
        if np.ptp(x) > 0 and abs(float(np.corrcoef(x, values)[0, 1])) > MIN_TREND_CORRELATION:
            ends = x <= np.quantile(x, TREND_END_SHARE), x >= np.quantile(x, 1 - TREND_END_SHARE)
            low, high = (float(np.mean(values[end])) for end in ends)
            way = "grows" if high > low else "falls"
            first, last = (_format_difference(v, scale, unit) for v in (low, high))
            return f"{where}, {channel} {way} with {name} against the baseline, from {first} to {last}"
    return ""


def _compute_signed_rms(values: np.ndarray) -> float | None:
    """A signed size: the root mean square with the sign of the mean; None for too few."""
    if values.size < 3:
        return None
    return float(np.sign(np.mean(values)) * np.sqrt(np.mean(values**2)))


def _compute_one_sided_rms(values: np.ndarray) -> float | None:
    """The signed size of a departure; None where the sign of its mean says little."""
    typical = _compute_signed_rms(values)
    one_sided = typical is not None and abs(float(np.mean(values))) >= MIN_ONE_SIDED_RATIO * abs(typical)
    return typical if one_sided else None


def _format_difference(value: float, scale: float, unit: str) -> str:
    return f"about {_format_size(value, scale, unit)} {'higher' if value > 0 else 'lower'}"


def _format_size(value: float, scale: float, unit: str) -> str:
    size = abs(value) * scale
    return f"{size:.0f} {unit}" if size >= 100 else f"{size:.2g} {unit}"
