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
from pamjax.diagnosis.detect.regions import LENGTHENING, SHORTENING, STILL, Axes, axes, ranges
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.refit.candidate_fit import Model, effect
from pamjax.infer.problem.dataset import CHANNELS

#: A box holds the middle of the squared misfit, between these shares of it, on each axis.
MIDDLE = (0.05, 0.95)
#: Share of the squared misfit from which a direction counts.
SIDE = 0.15
#: Rms on a channel, over that on the channel where it is largest, from which a name is located there.
CHANNEL = 0.5
#: Most boxes.
MOST = 5
#: Neighbours over which the square of a residual is averaged, so that noise is told from misfit.
GROUP = 7

#: Mean of a departure over its rms from which it has one sign.
ONE_SIDED = 0.4

#: Correlation with pressure or contraction from which a departure that changes sign has a trend.
TREND = 0.9
#: Share of the samples at either end of it that say from what to what.
END = 0.1

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
        says: one plain sentence.
    """

    channel: str
    direction: str
    pressure: tuple[float, float]
    contraction: tuple[float, float]
    time: tuple[float, float]
    share: float
    says: str


def locate_names(found: Problem, baseline: Model, model: Model) -> list[Box]:
    """Boxes of what each name does to the recording beyond what the baseline absorbs; largest share first."""
    at, residual = axes(found), found.measured - found.shows(baseline.at.values)
    boxes = []
    for form in model.chosen:
        done = effect(found, model, form)
        sizes = [_rms(model.white.standard(done, c)) for c in range(len(CHANNELS))]
        for c, size in enumerate(sizes):
            if size > 0 and size >= CHANNEL * max(sizes):
                standard = _standard(found, model, done, c)
                boxes.append(_box(baseline, at, c, standard**2, done[c]))
    return _shared(found, baseline, residual, boxes)


def locate_rest(found: Problem, model: Model) -> list[Box]:
    """Boxes of what a model leaves in the residual beyond noise, by channel; largest share first."""
    at, residual = axes(found), found.measured - found.shows(model.at.values)
    boxes, excess = [], []
    for c in range(len(CHANNELS)):
        standard = _standard(found, model, residual, c)
        there = np.flatnonzero(np.isfinite(standard))
        if there.size < GROUP:
            continue
        square = np.convolve(standard[there] ** 2, np.ones(GROUP) / GROUP, mode="same")
        # Averaged over a group, noise alone reaches this far in one of six.
        weight = np.full(found.n, np.nan)
        weight[there] = np.where(square - 1 > np.sqrt(2 / GROUP), square - 1, 0.0)
        excess.append(np.nansum(weight))
        boxes.append((c, weight))
    kept = [b for b, e in zip(boxes, excess, strict=True) if e > 0.2 * max(excess, default=0.0)]
    return _shared(found, model, residual, [_box(model, at, c, weight, residual[c]) for c, weight in kept])


def _rms(standard: np.ndarray) -> float:
    there = np.isfinite(standard)
    return float(np.sqrt(np.mean(standard[there] ** 2))) if there.any() else 0.0


def _standard(found: Problem, model: Model, values: np.ndarray, c: int) -> np.ndarray:
    """One channel over its noise at every row where it was measured, held out or not, (n,)."""
    colour = model.white.colours[c]
    if colour is None:
        return np.full(found.n, np.nan)
    return np.where(np.isfinite(found.measured[c]), values[c] / colour.sd, np.nan)


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


def _box(model: Model, at: Axes, c: int, weight, signed) -> _Region:
    rows = np.flatnonzero(np.nan_to_num(weight) > 0)
    weights = weight[rows]
    pressure, contraction, time = (_middle(v[rows], weights) for v in (at.pressure, at.contraction, at.time))
    direction = _direction(at.direction[rows], weights)
    inside = np.isfinite(weight)
    for values, (low, high) in ((at.pressure, pressure), (at.contraction, contraction), (at.time, time)):
        inside &= (values >= low) & (values <= high)
    if direction != "both":
        inside &= at.direction == (SHORTENING if direction == "shortening" else LENGTHENING)
    channel, colour = CHANNELS[c], model.white.colours[c]
    sd = np.zeros(weight.size) if colour is None else colour.sd
    says = _sentence(channel, direction, pressure, contraction, signed, inside, at, sd)
    box = Box(channel, direction, pressure, contraction, time, 0.0, says)
    return _Region(box, inside, np.where(inside, np.nan_to_num(weight), 0.0))


def _middle(values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Quantiles of values under weights."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    places = np.searchsorted(total, np.array(MIDDLE) * total[-1])
    low, high = values[order][np.minimum(places, len(order) - 1)]
    return float(low), float(high)


def _direction(direction: np.ndarray, weights: np.ndarray) -> str:
    sides = {way: weights[direction == way].sum() for way in (SHORTENING, LENGTHENING)}
    moving = sum(sides.values())
    # At fixed length there is no direction.
    if moving < 0.5 * weights.sum():
        return "both"
    if sides[SHORTENING] < SIDE * moving:
        return "lengthening"
    return "shortening" if sides[LENGTHENING] < SIDE * moving else "both"


def _shared(found: Problem, model: Model, residual: np.ndarray, regions: Sequence[_Region]) -> list[Box]:
    """Return the boxes with their parts of the excess of squared residuals; at most five, largest first."""
    excess = []
    for c in range(len(CHANNELS)):
        standard = _standard(found, model, residual, c)
        excess.append(np.where(np.isfinite(standard), standard**2 - 1, 0.0))
    parts = np.array([excess[CHANNELS.index(r.box.channel)] @ d for r, d in divided(regions)])
    # Outside the boxes the residual may be below its noise.
    total = max(float(np.sum(excess)), float(np.clip(parts, 0.0, None).sum()))
    shares = np.clip(parts / total, 0.0, 1.0) if np.sum(excess) > 0 else np.zeros(len(regions))
    boxes = [replace(r.box, share=float(share)) for r, share in zip(regions, shares, strict=True)]
    return sorted(boxes, key=lambda box: -box.share)[:MOST]


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


def _sentence(channel, direction, pressure, contraction, signed, inside, at: Axes, sd) -> str:
    unit, scale = DISPLAY_UNIT[channel], to_display(channel, 1.0)
    where = f"Between {pressure[0] / 1e3:.0f} and {pressure[1] / 1e3:.0f} kPa"
    if contraction[1] - contraction[0] > 1e-3:
        where += f", {100 * contraction[0]:z.0f} to {100 * contraction[1]:z.0f} % contracted"
    parts = _parts(inside, at)
    sides = ((SHORTENING, "shortens"), (LENGTHENING, "lengthens"))
    means = {word: _one_sided(signed[inside & (at.direction == way)]) for way, word in sides}
    mixed = any(_mixed(signed, sd, [p for p in parts if at.direction[p[0]] == way]) for way, _ in sides)
    shortens, lengthens = means["shortens"], means["lengthens"]
    by_way = direction == "both" and not mixed
    if by_way and shortens is not None and lengthens is not None and shortens * lengthens < 0:
        return (
            f"{where}, {channel} is {_amount(lengthens, scale, unit)} while the muscle lengthens and"
            f" {_amount(shortens, scale, unit)} while it shortens."
        )
    values = signed[inside]
    typical = _typical(values) or 0.0
    told = f"{where}, {channel} is {_amount(typical, scale, unit)} than the baseline says"
    if _one_sided(values) is None:
        told = _trend(where, channel, values, inside, at, scale, unit) or (
            f"{where}, {channel} departs from the baseline by about {_size(typical, scale, unit)} either way"
        )
    elif _mixed(signed, sd, parts):
        told = _trend(where, channel, values, inside, at, scale, unit) or (
            f"{where}, {channel} is {_extremes(signed, parts, at, scale, unit)} than the baseline says"
        )
    return (
        f"{told} while the muscle {'shortens' if direction == 'shortening' else 'lengthens'}."
        if (direction != "both")
        else f"{told}."
    )


def _parts(inside: np.ndarray, at: Axes) -> list[np.ndarray]:
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


def _extremes(signed, parts: Sequence[np.ndarray], at: Axes, scale, unit) -> str:
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
        amount = _amount(float(np.mean(signed[part])), scale, unit)
        said.append(amount + (f" ({', '.join(words)})" if words else ""))
    return f"between {said[0]} and {said[1]}"


def _trend(where, channel, values, inside, at: Axes, scale, unit) -> str:
    """What a departure that changes sign does along pressure, or contraction; empty where it has no trend."""
    for name, along in (("pressure", at.pressure), ("contraction", at.contraction)):
        x = along[inside]
        if np.ptp(x) > 0 and abs(float(np.corrcoef(x, values)[0, 1])) > TREND:
            ends = x <= np.quantile(x, END), x >= np.quantile(x, 1 - END)
            low, high = (float(np.mean(values[end])) for end in ends)
            way = "grows" if high > low else "falls"
            first, last = (_amount(v, scale, unit) for v in (low, high))
            return f"{where}, {channel} {way} with {name} against the baseline, from {first} to {last}"
    return ""


def _typical(values: np.ndarray) -> float | None:
    """A signed size: the root mean square with the sign of the mean; None for too few."""
    if values.size < 3:
        return None
    return float(np.sign(np.mean(values)) * np.sqrt(np.mean(values**2)))


def _one_sided(values: np.ndarray) -> float | None:
    """The signed size of a departure; None where the sign of its mean says little."""
    typical = _typical(values)
    one_sided = typical is not None and abs(float(np.mean(values))) >= ONE_SIDED * abs(typical)
    return typical if one_sided else None


def _amount(value: float, scale: float, unit: str) -> str:
    return f"about {_size(value, scale, unit)} {'higher' if value > 0 else 'lower'}"


def _size(value: float, scale: float, unit: str) -> str:
    shown = abs(value) * scale
    return f"{shown:.0f} {unit}" if shown >= 100 else f"{shown:.2g} {unit}"
