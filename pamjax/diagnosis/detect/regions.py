"""Where to look for a misfit that no mechanism has: shifts of the mean over parts of a recording.

A part is a range of pressure, of contraction, a direction, a stretch of time, or two of the first three
together. In each, a constant shift in noise standard deviations is one more direction to look along.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.infer.problem.dataset import CHANNELS

#: Into how many ranges pressure and contraction are cut, and time.
RANGES_PER_AXIS, TIME_RANGES = 5, 20

#: Fewest samples of a part.
MIN_SAMPLES_IN_REGION = 12

#: Share of a channel's fastest usual speed above which the muscle moves.
MIN_SPEED_SHARE = 0.05

#: Standard deviations of a rate by the noise of length alone, above which the muscle moves.
MIN_SPEED_NOISE_SD = 4.5

SHORTENING, STILL, LENGTHENING = -1, 0, 1


@dataclass(frozen=True, eq=False)
class RecordingAxes:
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


def build_axes(problem: LibraryProblem) -> RecordingAxes:
    """The axes along which a misfit is located."""
    recording = problem.case.recording
    rest_length = problem.case.entry.rest_length.value
    time = recording.time if recording.time is not None else np.arange(problem.n, dtype=float)
    rate = np.asarray(problem.dataset.history.rate(problem.dataset.rows.length))[: problem.n]
    # A muscle that is held must not seem to move by the noise of its length: the residual has that noise too.
    rate_noise = np.sqrt(np.sum(np.square(np.asarray(problem.dataset.history.rate_weights)), axis=1))[
        : problem.n
    ]
    sensor = problem.case.entry.sensors
    noise = 0.0 if sensor.length_per_setting else MIN_SPEED_NOISE_SD * (sensor.length or 0.0) * rate_noise
    min_speed = np.maximum(MIN_SPEED_SHARE * float(np.nanquantile(np.abs(rate), 0.95)), noise)
    moving = np.abs(rate) > min_speed
    direction = np.where(moving, np.sign(rate), STILL).astype(int)
    return RecordingAxes(recording.pressure, 1 - recording.length / rest_length, time, direction)


def split_into_regions(axes: RecordingAxes) -> list[np.ndarray]:
    """(n,) masks of the parts of a recording."""
    pressures = ranges(axes.pressure, RANGES_PER_AXIS)
    lengths = ranges(axes.contraction, RANGES_PER_AXIS)
    directions = [axes.direction == direction for direction in (SHORTENING, STILL, LENGTHENING)]
    directions = [direction for direction in directions if direction.any()]
    stretches = ranges(axes.time, TIME_RANGES)
    crossed = [
        a & b
        for family, other in _pair_families(pressures, lengths, directions)
        for a in family
        for b in other
    ]
    return [*pressures, *lengths, *directions, *stretches, *crossed]


def _pair_families(*families):
    return [(families[i], families[k]) for i in range(len(families)) for k in range(i + 1, len(families))]


def ranges(values: np.ndarray, many: int) -> list[np.ndarray]:
    """Masks of about equally wide ranges; no mask where the values hardly differ."""
    low, high = np.nanmin(values), np.nanmax(values)
    if not high > low:
        return []
    index = np.searchsorted(_place_edges(values, low + (high - low) * np.arange(1, many) / many), values)
    return [index == k for k in range(many)]


def _place_edges(values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
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


def compute_region_shifts(problem: LibraryProblem, noise: NoiseModel) -> np.ndarray:
    """(k, size) white directions: a shift of one standard deviation in each part and channel."""
    masks = split_into_regions(build_axes(problem))
    out = []
    for c in range(len(CHANNELS)):
        channel = noise.channels[c]
        if channel is None:
            continue
        for mask in masks:
            if np.count_nonzero(mask[noise.rows[c]]) >= MIN_SAMPLES_IN_REGION:
                pattern = np.zeros((2, problem.n))
                pattern[c] = np.where(mask, channel.sd, 0.0)
                out.append(pattern)
    return noise.whiten(np.array(out)) if out else np.zeros((0, noise.size))
