"""Parts of a recording are parted by what was set, not by the noise of how it was measured."""

import numpy as np

from pamjax.diagnosis.detect.regions import RANGES_PER_AXIS, ranges


def test_an_isobar_on_an_edge_stays_whole():
    rng = np.random.default_rng(0)
    # Of five equally wide ranges over 0 to 500 kPa the edges are at 100, 200, 300 and 400 kPa.
    levels = np.array([0.0, 100e3, 200e3, 300e3, 500e3])
    isobar = np.repeat(np.arange(5), 200)
    pressure = levels[isobar] + 500.0 * rng.standard_normal(isobar.size)
    masks = ranges(pressure, RANGES_PER_AXIS)
    assert sum(int(mask.sum()) for mask in masks) == pressure.size
    for k in range(5):
        assert sorted({bool(mask[isobar == k].all()) for mask in masks}) == [False, True]


def test_what_is_spread_evenly_is_parted_evenly():
    values = np.linspace(0, 1, 1001)
    shares = [mask.mean() for mask in ranges(values, 5)]
    assert np.allclose(shares, 0.2, atol=0.06)
    assert ranges(np.full(10, 3.0), 5) == []
