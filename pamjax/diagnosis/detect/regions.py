"""Where to look for a misfit that no mechanism has: shifts of the mean over parts of a recording.

A part is a range of pressure, of contraction, a direction, a stretch of time, or two of the first three
together. In each, a constant shift in noise standard deviations is one more direction to look along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import Whitening
from pamjax.infer.problem.dataset import CHANNELS

#: Into how many ranges pressure and contraction are cut, and time.
RANGES, STRETCHES = 5, 20

#: Fewest samples of a part.
FEW = 12

#: Share of a channel's fastest usual speed above which the muscle moves.
MOVING = 0.05

#: Standard deviations of a rate by the noise of length alone, above which the muscle moves.
STEADY = 4.5

SHORTENING, STILL, LENGTHENING = -1, 0, 1


@dataclass(frozen=True, eq=False)
class Axes:
    """What a recording did, row by row.

    Attributes:
        pressure: (n,) Pa.
        contraction: (n,) 1 − length / rest length.
        time: (n,) s; the row's number in a static map.
        direction: (n,) −1 shortening, 0 still, 1 lengthening.
    """

    pressure: np.ndarray
    contraction: np.ndarray
    time: np.ndarray
    direction: np.ndarray


def axes(found: Problem) -> Axes:
    """The axes along which a misfit is located."""
    recording = found.case.recording
    rest = found.case.entry.rest_length.value
    time = recording.time if recording.time is not None else np.arange(found.n, dtype=float)
    rate = np.asarray(found.member.history.rate(found.member.rows.length))[: found.n]
    # A muscle that is held must not seem to move by the noise of its length: the residual has that noise too.
    by_noise = np.sqrt(np.sum(np.square(np.asarray(found.member.history.slope)), axis=1))[: found.n]
    sensor = found.case.entry.sensors
    noise = 0.0 if sensor.length_per_setting else STEADY * (sensor.length or 0.0) * by_noise
    slow = np.maximum(MOVING * float(np.nanquantile(np.abs(rate), 0.95)), noise)
    moving = np.abs(rate) > slow
    direction = np.where(moving, np.sign(rate), STILL).astype(int)
    return Axes(recording.pressure, 1 - recording.length / rest, time, direction)


def parts(at: Axes) -> list[np.ndarray]:
    """(n,) masks of the parts of a recording."""
    pressures = ranges(at.pressure, RANGES)
    lengths = ranges(at.contraction, RANGES)
    ways = [at.direction == way for way in (SHORTENING, STILL, LENGTHENING)]
    ways = [way for way in ways if way.any()]
    stretches = ranges(at.time, STRETCHES)
    crossed = [a & b for one, other in _pairs(pressures, lengths, ways) for a in one for b in other]
    return [*pressures, *lengths, *ways, *stretches, *crossed]


def _pairs(*families):
    return [(families[i], families[k]) for i in range(len(families)) for k in range(i + 1, len(families))]


def ranges(values: np.ndarray, many: int) -> list[np.ndarray]:
    """Masks of about equally wide ranges; no mask where the values hardly differ."""
    low, high = np.nanmin(values), np.nanmax(values)
    if not high > low:
        return []
    index = np.searchsorted(_edges(values, low + (high - low) * np.arange(1, many) / many), values)
    return [index == k for k in range(many)]


def _edges(values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Edges near the wanted ones, each in the widest gap between values there.

    An edge that fell on an isobar would part it by the noise of its own pressure, which the model carries
    into the residual: two parts that differ by nothing else would seem shifted, one up and one down.
    """
    ordered = np.sort(values[np.isfinite(values)])
    reach = 0.25 * (wanted[1] - wanted[0]) if wanted.size > 1 else 0.25 * np.ptp(ordered) / 2
    edges = []
    for edge in wanted:
        inside = ordered[(ordered > edge - reach) & (ordered < edge + reach)]
        points = np.concatenate([[edge - reach], inside, [edge + reach]])
        k = int(np.argmax(np.diff(points)))
        edges.append((points[k] + points[k + 1]) / 2)
    return np.array(edges)


def shifts(found: Problem, white: Whitening) -> np.ndarray:
    """(k, size) white directions: a shift of one standard deviation in each part and channel."""
    masks = parts(axes(found))
    out = []
    for c in range(len(CHANNELS)):
        colour = white.colours[c]
        if colour is None:
            continue
        for mask in masks:
            if np.count_nonzero(mask[white.rows[c]]) >= FEW:
                pattern = np.zeros((2, found.n))
                pattern[c] = np.where(mask, colour.sd, 0.0)
                out.append(pattern)
    return white(np.array(out)) if out else np.zeros((0, white.size))
