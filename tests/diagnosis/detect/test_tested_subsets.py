"""Bins of a recording follow the settings, not the noise of their measurement."""

import numpy as np

from pamjax.diagnosis.detect.tested_subsets import split_range
from pamjax.diagnosis.settings import DEFAULT_SETTINGS


def test_isobar_on_the_edge_of_a_bin_is_not_split():
    rng = np.random.default_rng(0)
    # Five equal ranges from 0 to 500 kPa have edges at 100, 200, 300 and 400 kPa.
    levels = np.array([0.0, 100e3, 200e3, 300e3, 500e3])
    isobar = np.repeat(np.arange(5), 200)
    pressure = levels[isobar] + 500.0 * rng.standard_normal(isobar.size)
    masks = split_range(pressure, DEFAULT_SETTINGS.ranges_per_axis)
    assert sum(int(mask.sum()) for mask in masks) == pressure.size
    for k in range(5):
        assert sorted({bool(mask[isobar == k].all()) for mask in masks}) == [False, True]


def test_evenly_spread_rows_have_equal_bins():
    values = np.linspace(0, 1, 1001)
    shares = [mask.mean() for mask in split_range(values, 5)]
    assert np.allclose(shares, 0.2, atol=0.06)
    assert split_range(np.full(10, 3.0), 5) == []
