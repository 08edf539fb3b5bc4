"""Sold parts: sizes of the tables, their diameters from counts, and the limits of a spec."""

import math
from types import SimpleNamespace

import pytest

from pamjax.sizing.calibration import CalibrationTransfer
from pamjax.sizing.problem import build_problem, list_choices
from pamjax.sizing.requirements import build_task
from pamjax.sizing.specification.materials import list_bladders, list_threads
from pamjax.sizing.specification.parts import (
    compute_yarn_diameter,
    find_barb,
    find_sleeve,
    find_yarn_count,
    list_sleeves,
    list_tubes,
    list_yarn_counts,
)
from pamjax.sizing.specification.spec import read_spec
from pamjax.sizing.stock import list_fitting_tubes, search_stock
from tests.agreement import ROUNDING, agree

SPEC = {
    "supply": {"pressure": "6 bar"},
    "force": [{"at_least": "300 N", "contraction": 0.1}],
    "envelope": {"length": "250 mm"},
    "threads": {"kinds": "aramid", "counts": 48, "diameters": "0.3 mm"},
    "bladders": {"kinds": "latex"},
}


def list_tubes_within(**changes):
    spec = read_spec(SPEC | changes, stock=True)
    return list_fitting_tubes(spec, list_choices(spec)[0])


def test_diameter_of_a_yarn_has_the_mass_of_its_count():
    kind = list_threads()["aramid"]
    for count in list_yarn_counts("aramid"):
        diameter = compute_yarn_diameter(kind, count)
        agree(kind.area(diameter) * kind.density, count, ROUNDING)
        assert find_yarn_count(kind, diameter) == count
    assert find_yarn_count(kind, 1.01 * diameter) is None
    assert list_yarn_counts("steel") == ()


def test_parts_name_materials_of_the_tables():
    assert {tube.rubber for tube in list_tubes()} <= set(list_bladders())
    assert {sleeve.thread for sleeve in list_sleeves()} <= set(list_threads())
    for tube in list_tubes():
        assert 0 < tube.wall_tolerance < tube.wall
        assert tube.outer_diameter > 2 * tube.wall


def test_inches_of_a_size_agree_with_its_millimetres():
    tube = next(tube for tube in list_tubes() if tube.size == "1/4 x 1/32 in")
    agree(tube.inner_diameter, 25.4e-3 / 4, 1e-2)
    agree(tube.wall, 25.4e-3 / 32, 1e-2)


def test_tube_is_described_by_bore_and_wall():
    sizes = {tube.size: tube.metric_size for tube in list_tubes()}
    assert sizes["1/4 x 1/32 in"] == "bore 6.35 mm, wall 0.79 mm (1/4 x 1/32 in)"
    # A metric trade size is inner x outer diameter.
    assert sizes["6 x 9 mm"] == "bore 6 mm, wall 1.5 mm"


def test_angles_of_a_sleeve_follow_from_its_diameters():
    for sleeve in list_sleeves():
        ratio = math.cos(sleeve.angle_at_low) / math.cos(sleeve.angle_at_high)
        assert ratio == pytest.approx(sleeve.low / sleeve.high, abs=0.01)


def test_smallest_sleeve_that_covers_both_diameters_is_selected():
    first = min(list_sleeves(), key=lambda sleeve: sleeve.high)
    assert find_sleeve("pet", first.low, first.high) == first
    assert find_sleeve("pet", first.low, 1.0) is None
    assert find_sleeve("steel", first.low, first.high) is None


def test_barb_is_not_narrower_than_the_bore():
    assert find_barb(3.2e-3) == "3.2 mm (1/8 in)"
    assert find_barb(3.3e-3) == "4 mm"
    assert find_barb(1.0) is None


def test_tubes_satisfy_the_limits_of_the_spec():
    every = list_tubes_within()
    assert {tube.rubber for tube in every} == {"latex"}
    thin = list_tubes_within(limits={"wall": ["0.5 mm", "1 mm"], "diameter": ["5 mm", "10 mm"]})
    assert 0 < len(thin) < len(every)
    assert all(tube.wall <= 1.001e-3 and 4.99e-3 <= tube.outer_diameter <= 10.01e-3 for tube in thin)
    stated = list_tubes_within(bladders={"kinds": "latex", "diameters": "7.93 mm"})
    assert "1/4 x 1/32 in" in {tube.size for tube in stated}
    assert all(tube.outer_diameter == pytest.approx(7.93e-3, rel=0.02) for tube in stated)
    assert not list_tubes_within(limits={"wall": "0.4 mm"})


def test_without_a_fitting_tube_no_result_is_of_stock():
    spec = read_spec(SPEC | {"limits": {"wall": "0.4 mm"}}, stock=True)
    task = build_task(spec)
    problem = build_problem(spec, task, list_choices(spec)[0], CalibrationTransfer())
    result = SimpleNamespace(problem=problem)
    assert search_stock([result], spec, task, CalibrationTransfer(), 0) == []
