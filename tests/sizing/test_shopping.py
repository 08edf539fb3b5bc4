"""Shopping list: quantities of all muscles, and forces of the tests on arrival from closed forms."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from pamjax.sizing.problem import list_choices
from pamjax.sizing.shopping import format_sleeve, list_checks, list_parts
from pamjax.sizing.specification.parts import list_tubes
from pamjax.sizing.specification.spec import read_spec
from pamjax.sizing.tolerances import BuildErrors
from tests.sizing.specification.test_parts import SPEC


def build_design(tube=True, parallel=1):
    """Return what the shopping list needs of a design: an aramid braid on a latex tube of 7.93 x 0.79 mm."""
    spec = read_spec(SPEC, stock=True)
    size = next(tube for tube in list_tubes() if tube.size == "1/4 x 1/32 in")
    choice = replace(list_choices(spec)[0], tube=size if tube else None, parallel=parallel)
    diameter, wall = (size.outer_diameter, size.wall) if tube else (9e-3, 0.5e-3)
    numbers = {
        "rest_length": 0.2, "thread_length": 0.21, "turns": 3.0, "diameter": diameter, "wall": wall,
        "bore": diameter - 2 * wall, "thread_area": choice.thread.area(choice.diameter), "braid_angle": 1.2,
    }  # fmt: skip
    return SimpleNamespace(
        spec=SimpleNamespace(fittings=0.02), choice=choice, numbers=numbers, errors=BuildErrors(wall=4e-5),
        problem=SimpleNamespace(build=choice.make_build()), output=lambda name: 15e-3,
    )  # fmt: skip


def test_quantities_include_fittings_allowances_and_all_muscles():
    for muscles in (1, 2):
        tube, thread, barbs, clamps = list_parts(build_design(parallel=muscles))
        # Tube: 200 mm, two fittings of 20 mm and 200 mm for tests; bobbin: 210 mm and 200 mm at the ends.
        assert tube.quantity == ("0.5 m" if muscles == 1 else "0.7 m")
        assert thread.quantity == ("19.7 m" if muscles == 1 else "39.4 m")
        assert f"48 threads of {'0.5' if muscles == 1 else '0.9'} m" in thread.remark
        assert barbs.quantity == clamps.quantity == str(2 * muscles)
    assert tube.name == "latex tube, bore 6.35 mm, wall 0.79 mm (1/4 x 1/32 in)"
    assert barbs.name == "hose barbs for 6.4 mm (1/4 in) tube"


def test_mass_of_the_thread_is_length_times_area_times_density():
    design = build_design()
    kind, area = design.choice.thread, design.numbers["thread_area"]
    mass = float(re.search(r"([\d.]+) g", list_parts(design)[1].remark)[1])
    assert mass == pytest.approx(1e3 * 48 * 0.41 * area * kind.density, rel=0.05)


def test_tube_without_a_size_must_be_made():
    tube = list_parts(build_design(tube=False))[0]
    assert tube.remark == "to be made: no size of the table"
    assert "outer diameter 9 mm, wall 0.5 mm" in tube.name


def test_forces_of_the_tests_on_arrival_agree_with_hand_computation():
    checks = list_checks(build_design())
    tube_force, yarn_force = (
        float(re.search(r"([\d.]+) N \(range", check)[1]) for check in (checks[1], checks[3])
    )
    # Neo-Hookean latex of 0.4 MPa: F = μ A (λ − 1/λ²) at λ = 1.2.
    area = math.pi / 4 * (7.93e-3**2 - 6.35e-3**2)
    assert tube_force == pytest.approx(0.4e6 * area * (1.2 - 1 / 1.44), rel=0.03)
    # Aramid of 112 GPa, 0.3 mm, 70 % solid: F = E A ε at 0.5 %.
    assert yarn_force == pytest.approx(112e9 * 0.7 * math.pi / 4 * 0.3e-3**2 * 0.005, rel=0.03)
    assert "± 0.18 mm" in checks[0]
    assert "± 0.069 mm" in list_checks(build_design(tube=False))[0]


def test_sleeve_is_named_only_if_one_covers_the_diameters():
    design = build_design()
    assert "A polyester sleeve for" in format_sleeve(design)
    design.output = lambda name: 1.0
    assert format_sleeve(design) == ""
