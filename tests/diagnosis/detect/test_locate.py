"""Regions of a misfit: texts for misfits that change sign, and the part of the misfit in a region."""

import numpy as np
import pytest

from pamjax.diagnosis.detect.locate import (
    MisfitRegion,
    _compute_weighted_range,
    _divide_shares,
    _find_motion,
    _UnsharedRegion,
    find_changed_channels,
)
from pamjax.diagnosis.detect.recording_axes import LENGTHENING, SHORTENING, RecordingAxes
from pamjax.diagnosis.detect.region_sentence import (
    RegionDeviation,
    format_extremes,
    format_region,
    split_region,
)
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from tests.diagnosis.bank import build_plan_problem, replace_readings
from tests.diagnosis.plain_fits import build_fit

PRESSURE = np.array([138e3, 276e3, 414e3, 552e3, 689e3])


def format_diameter_region(off):
    at = RecordingAxes(PRESSURE, np.zeros(5), np.arange(5.0), np.zeros(5, int))
    ends = (138e3, 689e3), (0.0, 0.0)
    return format_region(
        RegionDeviation("diameter", "both", *ends, at, np.ones(5, bool), np.array(off) * 1e-3, np.zeros(5))
    )


def test_trend_of_the_diameter_with_pressure_is_reported():
    assert format_diameter_region([-0.47, -0.2, 0.0, 0.23, 0.42]) == (
        "Between 138 and 689 kPa, diameter relative to the baseline increases with pressure,"
        " from about 0.47 mm smaller to about 0.42 mm larger."
    )


def test_misfit_without_trend_has_both_signs():
    assert "larger or smaller" in format_diameter_region([0.4, -0.4, 0.4, -0.4, 0.1])


def test_misfit_along_pressure_is_not_reported_by_direction():
    """Both directions have almost the same misfit; the sign of their difference is random."""
    way = np.tile([SHORTENING, LENGTHENING], 20)
    pressure = np.repeat(np.linspace(1e5, 4e5, 20), 2)
    at = RecordingAxes(pressure, np.zeros(40), np.arange(40.0), way)

    def format_force_region(by_way):
        off = np.linspace(-6, 6, 20).repeat(2) + np.where(way == LENGTHENING, by_way, -by_way)
        ends = (1e5, 4e5), (0.0, 0.0)
        return format_region(
            RegionDeviation("force", "both", *ends, at, np.ones(40, bool), off, np.zeros(40))
        )

    assert (
        "force relative to the baseline increases with pressure, from about 5.7 N lower"
        in format_force_region(0.1)
    )
    assert "than the baseline while the muscle lengthens and" in format_force_region(9.0)


def at_lengths(means, noise=2.0, way=0):
    """Return the text for a hose that was inflated at four lengths, with a mean misfit at each, N."""
    rng, many = np.random.default_rng(0), 200
    pressure = np.tile(np.linspace(368e3, 624e3, many), len(means))
    contraction = np.repeat([0.0, 0.04, 0.08, 0.12][: len(means)], many)
    n = pressure.size
    at = RecordingAxes(pressure, contraction, np.arange(float(n)), np.full(n, way))
    off = np.repeat(means, many) + noise * rng.standard_normal(n)
    ends, motion = ((368e3, 624e3), (0.0, 0.12)), {0: "both", SHORTENING: "shortening"}[way]
    return format_region(
        RegionDeviation("force", motion, *ends, at, np.ones(n, bool), off, np.full(n, noise))
    )


PLACE = "Between 368 and 624 kPa, 0 to 12 % contracted, force"


def test_sign_change_along_length_is_reported_as_a_trend():
    assert at_lengths([74.0, -26.0, -78.0, -104.0]) == (
        f"{PLACE} relative to the baseline decreases with contraction,"
        " from about 74 N higher to about 104 N lower."
    )


@pytest.mark.parametrize(("way", "end"), [(0, "."), (SHORTENING, " while the muscle shortens.")])
def test_misfit_without_trend_is_reported_by_its_extremes(way, end):
    text = at_lengths([-26.0, 74.0, -104.0, -78.0], way=way)
    assert text == (
        f"{PLACE} is between about 104 N lower (near 8 % contracted) and about 74 N higher"
        f" (near 4 % contracted) than the baseline{end}"
    )


def test_sign_change_within_noise_is_ignored():
    assert at_lengths([-100.0, -100.0, -80.0, 1.0]) == f"{PLACE} is about 81 N lower than the baseline."


def test_misfit_by_direction_must_have_one_sign_at_all_lengths():
    """Friction of one sign at three lengths, and of the other sign at the fourth."""
    way = np.tile([SHORTENING, LENGTHENING], 400)
    contraction = np.repeat([0.0, 0.04, 0.08, 0.12], 200)
    at = RecordingAxes(np.full(800, 4e5), contraction, np.arange(800.0), way)

    def format_force_region(last):
        off = way * np.where(contraction == 0.12, last, 20.0) + 0.5
        ends = (4e5, 4e5), (0.0, 0.12)
        return format_region(
            RegionDeviation("force", "both", *ends, at, np.ones(800, bool), off, np.ones(800))
        )

    assert "than the baseline while the muscle lengthens and" in format_force_region(10.0)
    assert "higher or lower" in format_force_region(-10.0)


def test_regions_do_not_count_the_same_misfit_twice():
    """Two mechanisms in the same rows, one with three times the squared effect; a third covers more rows."""
    n = build_plan_problem().n
    problem = replace_readings(build_plan_problem(), np.stack([np.zeros(n), np.full(n, np.nan)]))
    rows, fit = np.arange(n), build_fit(n=n)
    standard = np.where(rows < 40, 5.0, np.where(rows < 80, 3.0, 0.1))

    def region(inside, weight):
        region = MisfitRegion("force", "both", (0.0, 1.0), (0.0, 1.0), (0.0, 1.0), 0.0, f"{weight}")
        return _UnsharedRegion(region, inside, weight * inside)

    residual = np.stack([standard, np.zeros(n)])
    regions = [region(rows < 40, 1.0), region(rows < 40, 3.0), region(rows < 80, 0.0)]
    regions = _divide_shares(problem, fit, residual, regions)
    shares = {region.description: region.share for region in regions}
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["3.0"] == pytest.approx(3 * shares["1.0"])
    assert shares["0.0"] == pytest.approx(40 * 8 / (40 * 24 + 40 * 8))
    assert [region.share for region in regions] == sorted(shares.values(), reverse=True)


def test_extremes_of_different_directions_are_reported_with_their_direction():
    way = np.repeat([SHORTENING, LENGTHENING], 100)
    at = RecordingAxes(np.full(200, 4e5), np.full(200, 0.1), np.arange(200.0), way)
    off = np.where(way == SHORTENING, -10.0, 50.0)
    ends = (4e5, 4e5), (0.1, 0.1)
    region = RegionDeviation("force", "both", *ends, at, np.ones(200, bool), off, np.zeros(200))
    assert format_extremes(region, split_region(region)) == (
        "between about 10 N lower (shortening) and about 50 N higher (lengthening)"
    )


def test_region_contains_the_middle_of_the_weight():
    values = np.linspace(0, 1, 1001)
    low, high = _compute_weighted_range(
        DEFAULT_SETTINGS, values, np.where((values > 0.2) & (values < 0.6), 1.0, 0.0)
    )
    assert (low, high) == (pytest.approx(0.22, abs=0.01), pytest.approx(0.58, abs=0.01))


@pytest.mark.parametrize(
    ("short", "long", "still", "word"),
    [(1, 1, 0, "both"), (1, 0.1, 0, "shortening"), (0.1, 1, 0, "lengthening"), (1, 0, 5, "both")],
)
def test_direction_counts_above_fifteen_percent(short, long, still, word):
    assert _find_motion(DEFAULT_SETTINGS, np.array([-1, 1, 0]), np.array([short, long, still], float)) == word


def test_an_absorbed_effect_has_no_region():
    # χ² of 400 samples: 4 at 0.1 sd, 1 at 0.05 sd. A channel that was not measured has no effect.
    unmeasured = np.full(400, np.nan)
    assert find_changed_channels([np.full(400, 0.101), unmeasured], DEFAULT_SETTINGS) == [0]
    assert find_changed_channels([np.full(400, 0.05), unmeasured], DEFAULT_SETTINGS) == []
    assert find_changed_channels([np.full(400, 3.0), np.full(400, 1.0)], DEFAULT_SETTINGS) == [0]
    assert find_changed_channels([np.full(400, 3.0), np.full(400, 2.0)], DEFAULT_SETTINGS) == [0, 1]
