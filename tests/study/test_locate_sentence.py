"""What a box says of a departure that changes sign."""

import numpy as np

from pamjax.study.cells import Axes
from pamjax.study.locate import _sentence

PRESSURE = np.array([138e3, 276e3, 414e3, 552e3, 689e3])


def said(off):
    at = Axes(PRESSURE, np.zeros(5), np.arange(5.0), np.zeros(5, int))
    ends = (138e3, 689e3), (0.0, 0.0)
    return _sentence("diameter", "both", *ends, np.array(off) * 1e-3, np.ones(5, bool), at)


def test_a_diameter_that_grows_with_pressure_is_told_so():
    assert said([-0.47, -0.2, 0.0, 0.23, 0.42]) == (
        "Between 138 and 689 kPa, diameter grows with pressure against the baseline,"
        " from about 0.47 mm lower to about 0.42 mm higher."
    )


def test_without_a_trend_it_departs_either_way():
    assert "either way" in said([0.4, -0.4, 0.4, -0.4, 0.1])
