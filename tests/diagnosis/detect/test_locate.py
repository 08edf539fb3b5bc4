"""What a box says of a departure that changes sign."""

import numpy as np

from pamjax.diagnosis.detect.locate import _sentence
from pamjax.diagnosis.detect.regions import LENGTHENING, SHORTENING, Axes

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


def test_a_departure_along_pressure_is_not_told_as_one_of_direction():
    """Both ways the same but for a little, whose sign is that of chance."""
    way = np.tile([SHORTENING, LENGTHENING], 20)
    pressure = np.repeat(np.linspace(1e5, 4e5, 20), 2)
    at = Axes(pressure, np.zeros(40), np.arange(40.0), way)

    def told(by_way):
        off = np.linspace(-6, 6, 20).repeat(2) + np.where(way == LENGTHENING, by_way, -by_way)
        return _sentence("force", "both", (1e5, 4e5), (0.0, 0.0), off, np.ones(40, bool), at)

    assert "force grows with pressure against the baseline, from about 5.7 N lower" in told(0.1)
    assert "while the muscle lengthens and" in told(9.0)
