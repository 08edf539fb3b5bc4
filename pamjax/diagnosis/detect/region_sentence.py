"""The sentence of a region: how a recording deviates from a model there.

The sentence is true in each part of the region: a range of pressure and of contraction in one motion. The
mean deviation of a part can have the opposite sign beyond noise. The sentence then states the trend, or the
lowest and the highest mean with their places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.channels import DISPLAY_UNIT, to_display
from pamjax.diagnosis.detect.recording_axes import LENGTHENING, SHORTENING, STILL, RecordingAxes
from pamjax.diagnosis.detect.tested_subsets import split_range
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings

#: Motions as text.
_MOTION_TEXTS = {SHORTENING: "shortening", STILL: "at rest", LENGTHENING: "lengthening"}


@dataclass(frozen=True, eq=False)
class RegionDeviation:
    """Deviation of a recording from a model in a region.

    Attributes:
        channel: "force" or "diameter".
        motion: "shortening", "lengthening" or "both".
        pressure: lowest and highest, Pa.
        contraction: lowest and highest.
        axes: coordinates of all rows.
        inside: (n,) whether a row is in the region.
        deviation: (n,) deviation of the channel, SI.
        sd: (n,) standard deviation of its noise, SI.
        reference: the model, in words.
        settings: thresholds of the diagnosis.
    """

    channel: str
    motion: str
    pressure: tuple[float, float]
    contraction: tuple[float, float]
    axes: RecordingAxes
    inside: np.ndarray
    deviation: np.ndarray
    sd: np.ndarray
    reference: str = "the baseline"
    settings: DiagnosisSettings = DEFAULT_SETTINGS

    @property
    def place(self) -> str:
        """Return the ranges of pressure and contraction as text."""
        text = f"Between {self.pressure[0] / 1e3:.0f} and {self.pressure[1] / 1e3:.0f} kPa"
        low, high = self.contraction
        return f"{text}, {100 * low:z.0f} to {100 * high:z.0f} % contracted" if high - low > 1e-3 else text

    def format_difference(self, value: float) -> str:
        """Return a deviation as text, as "about 12 N lower"."""
        return f"about {self.format_size(value)} {self.comparatives[0 if value > 0 else 1]}"

    @property
    def comparatives(self) -> tuple[str, str]:
        """Return the words for a positive and a negative deviation: a length is larger, not higher."""
        return ("higher", "lower") if self.channel == "force" else ("larger", "smaller")

    def format_size(self, value: float) -> str:
        """Return the size of a deviation as text, as "12 N"."""
        size, unit = abs(value) * to_display(self.channel, 1.0), DISPLAY_UNIT[self.channel]
        return f"{size:.0f} {unit}" if size >= 100 else f"{size:.2g} {unit}"

    def compute_one_sided_rms(self, rows: np.ndarray) -> float | None:
        """Return the signed rms of some rows; None if their mean is small compared with it."""
        values = self.deviation[rows]
        signed_rms = _compute_signed_rms(values)
        if signed_rms is None:
            return None
        is_one_sided = abs(float(np.mean(values))) >= self.settings.min_one_sided_ratio * abs(signed_rms)
        return signed_rms if is_one_sided else None


def format_region(region: RegionDeviation) -> str:
    """Return the sentence of a region."""
    parts = split_region(region)
    by_motion = _format_by_motion(region, parts)
    if by_motion:
        return f"{region.place}, {by_motion}."
    typical = _compute_signed_rms(region.deviation[region.inside]) or 0.0
    text = f"{region.channel} is {region.format_difference(typical)} than {region.reference}"
    if region.compute_one_sided_rms(region.inside) is None:
        text = _format_trend(region) or (
            f"{region.channel} is about {region.format_size(typical)} {' or '.join(region.comparatives)}"
            f" than {region.reference}"
        )
    elif _has_both_signs(region, parts):
        text = (
            _format_trend(region)
            or f"{region.channel} is {format_extremes(region, parts)} than {region.reference}"
        )
    if region.motion != "both":
        text += f" while the muscle {'shortens' if region.motion == 'shortening' else 'lengthens'}"
    return f"{region.place}, {text}."


def split_region(region: RegionDeviation) -> list[np.ndarray]:
    """Return the rows of each part of a region: ranges of pressure and of contraction in each motion."""
    rows, axes, settings = np.flatnonzero(region.inside), region.axes, region.settings
    if not rows.size:
        return []
    all_rows = np.ones(rows.size, dtype=bool)
    pressure_ranges, contraction_ranges = (
        split_range(x[rows], settings.ranges_per_region) or [all_rows]
        for x in (axes.pressure, axes.contraction)
    )
    motions = [axes.motion[rows] == motion for motion in (SHORTENING, STILL, LENGTHENING)]
    parts = [rows[p & c & m] for p in pressure_ranges for c in contraction_ranges for m in motions]
    return [part for part in parts if part.size >= max(1, settings.min_part_share * rows.size)]


def _format_by_motion(region: RegionDeviation, parts: Sequence[np.ndarray]) -> str:
    """Return the deviations of both motions; empty unless they have opposite signs, each in all parts."""
    shortening, lengthening = (
        region.compute_one_sided_rms(region.inside & (region.axes.motion == motion))
        for motion in (SHORTENING, LENGTHENING)
    )
    if region.motion != "both" or shortening is None or lengthening is None or shortening * lengthening >= 0:
        return ""
    if any(
        _has_both_signs(region, [part for part in parts if region.axes.motion[part[0]] == motion])
        for motion in (SHORTENING, LENGTHENING)
    ):
        return ""
    return (
        f"{region.channel} is {region.format_difference(lengthening)} than {region.reference}"
        f" while the muscle lengthens and {region.format_difference(shortening)} while it shortens"
    )


def _has_both_signs(region: RegionDeviation, parts: Sequence[np.ndarray]) -> bool:
    """Return whether the mean deviations of parts have both signs, beyond the noise of a sample."""
    means = [float(np.mean(region.deviation[part])) for part in parts]
    significant = [
        mean for mean, part in zip(means, parts, strict=True) if abs(mean) > np.mean(region.sd[part])
    ]
    return min(significant, default=0.0) < 0 < max(significant, default=0.0)


def format_extremes(region: RegionDeviation, parts: Sequence[np.ndarray]) -> str:
    """Return the lowest and the highest mean deviation of parts, with their places if these differ."""
    low, high = (pick(parts, key=lambda part: float(np.mean(region.deviation[part]))) for pick in (min, max))
    rows, places = np.concatenate(parts), [[], []]
    for values, size, name in (
        (region.axes.pressure, 1e-3, "kPa"),
        (region.axes.contraction, 100, "% contracted"),
    ):
        means = [float(np.mean(values[part])) for part in (low, high)]
        if abs(means[1] - means[0]) > region.settings.min_part_distance_share * np.ptp(values[rows]):
            for place, x in zip(places, means, strict=True):
                place.append(f"{size * x:z.0f} {name}")
    texts = []
    for part, place in zip((low, high), places, strict=True):
        remarks = [f"near {', '.join(place)}"] if place else []
        if region.axes.motion[low[0]] != region.axes.motion[high[0]]:
            remarks.append(_MOTION_TEXTS[int(region.axes.motion[part[0]])])
        difference = region.format_difference(float(np.mean(region.deviation[part])))
        texts.append(difference + (f" ({', '.join(remarks)})" if remarks else ""))
    return f"between {texts[0]} and {texts[1]}"


def _format_trend(region: RegionDeviation) -> str:
    """Return the trend of the deviation with pressure or contraction; empty without a trend."""
    values, settings = region.deviation[region.inside], region.settings
    for name, coordinate in (("pressure", region.axes.pressure), ("contraction", region.axes.contraction)):
        x = coordinate[region.inside]
        if np.ptp(x) > 0 and abs(float(np.corrcoef(x, values)[0, 1])) > settings.min_trend_correlation:
            ends = (
                x <= np.quantile(x, settings.trend_end_share),
                x >= np.quantile(x, 1 - settings.trend_end_share),
            )
            low, high = (float(np.mean(values[end])) for end in ends)
            verb = "increases" if high > low else "decreases"
            first, last = (region.format_difference(v) for v in (low, high))
            return (
                f"{region.channel} relative to {region.reference} {verb} with {name}, from {first} to {last}"
            )
    return ""


def _compute_signed_rms(values: np.ndarray) -> float | None:
    """Return the root mean square with the sign of the mean; None for fewer than three values."""
    if values.size < 3:
        return None
    return float(np.sign(np.mean(values)) * np.sqrt(np.mean(values**2)))
