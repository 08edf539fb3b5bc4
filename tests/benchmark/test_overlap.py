"""True regions contain the middle of an effect; the overlap of two regions is their shared part."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.overlap import compute_blind_overlap, compute_overlap, compute_true_regions
from pamjax.diagnosis.detect.locate import MisfitRegion
from pamjax.diagnosis.detect.recording_axes import RecordingAxes

#: A hundred pressures; at each, strokes that shorten and lengthen.
GRID = np.meshgrid(np.linspace(0, 1e5, 101), np.linspace(0, 0.3, 61), [-1, 1], indexing="ij")
AT = RecordingAxes(
    GRID[0].ravel(), GRID[1].ravel(), np.linspace(0, 100, GRID[0].size), GRID[2].ravel().astype(int)
)
WHOLE = MisfitRegion("force", "both", (0, 1e5), (0, 0.3), (0, 100), 1.0, "")


def effect(weight):
    out = np.zeros((1, 2, AT.pressure.size))
    out[0, 0] = weight
    return out


def regions(weight):
    return compute_true_regions(AT, effect(weight), np.ones((2, AT.pressure.size)))


def test_true_region_contains_the_effect():
    (region,) = regions((AT.pressure > 5e4) & (AT.contraction < 0.1) & (AT.motion == 1))
    assert (region.channel, region.motion) == ("force", "lengthening")
    assert region.pressure == pytest.approx((5.25e4, 9.75e4), abs=1.5e3)
    assert region.contraction == pytest.approx((0.005, 0.095), abs=0.006)


def test_true_region_is_weighted_by_the_squared_effect():
    (region,) = regions(AT.pressure)
    # ∫ p² dp: a fraction s is below s^(1/3) of the range.
    assert region.pressure == pytest.approx((1e5 * 0.05 ** (1 / 3), 1e5 * 0.95 ** (1 / 3)), abs=1.5e3)
    assert region.motion == "both"


def test_overlap_is_one_for_the_same_region_and_zero_for_another_channel():
    (region,) = regions(AT.pressure > 5e4)
    assert compute_overlap(AT, [region], [region]) == pytest.approx(1.0)
    assert compute_overlap(AT, [replace(region, channel="diameter")], [region]) == 0.0
    assert compute_overlap(AT, [], [region]) == 0.0


def test_overlap_is_the_product_over_the_axes():
    quarter = replace(WHOLE, pressure=(0, 5e4), contraction=(0, 0.15))
    assert compute_overlap(AT, [quarter], [WHOLE]) == pytest.approx(0.25)
    assert compute_overlap(AT, [replace(quarter, motion="shortening")], [WHOLE]) == pytest.approx(0.125)
    assert compute_blind_overlap(AT, [quarter]) == pytest.approx(0.25)
    assert (
        compute_overlap(AT, [replace(WHOLE, pressure=(0, 4e4))], [replace(WHOLE, pressure=(6e4, 1e5))]) == 0.0
    )
