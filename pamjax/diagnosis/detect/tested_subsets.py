"""Subsets of a recording in which a shift of the mean is tested, for misfit that no mechanism causes.

A subset is a range of pressure or of contraction, a motion (shortening, lengthening, none), or an interval of
time. Two of the first three can be combined. In each subset, a constant shift in standard deviations of the
noise is one more tested direction of the residual (`significance.py`).
"""

from __future__ import annotations

import itertools

import numpy as np

from pamjax.diagnosis.detect.recording_axes import LENGTHENING, SHORTENING, STILL, RecordingAxes, build_axes
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.problem.dataset import CHANNELS


def split_into_subsets(axes: RecordingAxes, settings: DiagnosisSettings) -> list[np.ndarray]:
    """Return the masks of all subsets, (n,) each."""
    pressures = split_range(axes.pressure, settings.ranges_per_axis)
    contractions = split_range(axes.contraction, settings.ranges_per_axis)
    motions = [axes.motion == motion for motion in (SHORTENING, STILL, LENGTHENING)]
    motions = [mask for mask in motions if mask.any()]
    intervals = split_range(axes.time, settings.time_ranges)
    intersections = [
        a & b
        for first, second in itertools.combinations((pressures, contractions, motions), 2)
        for a in first
        for b in second
    ]
    return [*pressures, *contractions, *motions, *intervals, *intersections]


def split_range(values: np.ndarray, count: int) -> list[np.ndarray]:
    """Return masks of about equally wide ranges; no mask if all values are equal."""
    low, high = np.nanmin(values), np.nanmax(values)
    if not high > low:
        return []
    edges = _place_edges(values, low + (high - low) * np.arange(1, count) / count)
    index = np.searchsorted(edges, values)
    return [index == k for k in range(count)]


def _place_edges(values: np.ndarray, regular_edges: np.ndarray) -> np.ndarray:
    """Return edges near the regular ones, each in the widest gap between values there.

    An edge on an isobar would split it by the noise of its own pressure. The model propagates this noise into
    the residual, so both parts would seem shifted, in opposite directions.
    """
    sorted_values = np.sort(values[np.isfinite(values)])
    width = regular_edges[1] - regular_edges[0] if regular_edges.size > 1 else np.ptp(sorted_values) / 2
    max_distance = 0.25 * width
    edges = []
    for edge in regular_edges:
        inside = sorted_values[(sorted_values > edge - max_distance) & (sorted_values < edge + max_distance)]
        points = np.concatenate([[edge - max_distance], inside, [edge + max_distance]])
        k = int(np.argmax(np.diff(points)))
        edges.append((points[k] + points[k + 1]) / 2)
    return np.array(edges)


def compute_subset_shifts(problem: LibraryProblem, noise: NoiseModel) -> np.ndarray:
    """Return the whitened shifts by one standard deviation in each subset and channel, (k, size)."""
    masks = split_into_subsets(build_axes(problem), problem.settings)
    out = []
    for c in range(len(CHANNELS)):
        channel = noise.by_channel[c]
        if channel is None:
            continue
        for mask in masks:
            if np.count_nonzero(mask[noise.rows[c]]) >= problem.settings.min_samples_in_subset:
                pattern = np.zeros((2, problem.n))
                pattern[c] = np.where(mask, channel.sd, 0.0)
                out.append(pattern)
    return noise.whiten(np.array(out)) if out else np.zeros((0, noise.size))
