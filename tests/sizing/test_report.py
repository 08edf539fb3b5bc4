"""Texts of a sizing report: margins and shortfalls of requirements, with their units."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.sizing.infeasible import Relaxation, format_shortfall
from pamjax.sizing.report import format_design_summary, format_margin, format_requirement_margin
from pamjax.sizing.requirements import Requirement
from tests.agreement import ROUNDING, agree

FORCE = Requirement("force 1", "force at least 5000 N at 20 % contraction", (0,), (5000.0,), 1, 5000.0, "N")
DIAMETER = Requirement("diameter", "diameter at most 15 mm", (0, 1), (0.015, 0.015), -1, 0.015, "mm")
MESH = Requirement(
    "mesh",
    "safety factor at least 1.5 against bulging",
    (0,),
    (1 / 1.5,),
    -1,
    1 / 1.5,
    "1",
    is_safety_factor=True,
)
FREE = Requirement("free contraction", "free contraction at least 20 %", (0,), (0.0,), 1, 1000.0, "N")
LENGTH = Requirement("length", "length at most 200 mm", (0,), (0.16,), -1, 0.16, "mm", fitting_length=0.04)


@pytest.mark.parametrize(
    ("requirement", "outputs", "margin", "shortfall"),
    [
        (FORCE, [1897.0], "62.1 % too low", "1900 N, 3100 N too low"),
        (FORCE, [100.0], "98 % too low", "100 N, 4900 N too low"),
        (DIAMETER, [0.012, 0.0394], "163 % too high", "39.4 mm, 24.4 mm too high"),
        (MESH, [1 / 0.57], "62 % too low", "a factor of 0.57, 0.93 too low"),
        (FREE, [-50.0], "50 N too low", "-50 N, 50 N too low"),
        (LENGTH, [0.2], "25 % too high", "240 mm, 40 mm too high"),
    ],
    ids=lambda value: value.key if isinstance(value, Requirement) else None,
)
def test_violation_is_reported_with_its_size(requirement, outputs, margin, shortfall):
    y = np.array(outputs)
    assert format_margin(float(requirement.compute_margins(y).min()), requirement) == margin
    assert format_shortfall(requirement, y) == shortfall


@pytest.mark.parametrize(
    ("requirement", "output", "margin"),
    [
        (FORCE, 5500.0, "margin 10 %"),
        (DIAMETER, 0.0075, "margin 100 %"),
        (MESH, 0.1 / 1.5, "margin factor 10"),
        (FREE, 51.9, "margin 51.9 N"),
    ],
    ids=lambda value: value.key if isinstance(value, Requirement) else None,
)
def test_met_requirement_is_reported_with_its_margin(requirement, output, margin):
    y = np.full(2, output)
    assert format_margin(float(requirement.compute_margins(y).min()), requirement) == margin


@pytest.mark.parametrize(("free", "text"), [(0.35, "margin 15 % contraction"), (0.212, "margin 1.2 % con")])
def test_margin_of_a_free_contraction_is_a_contraction(free, text):
    entries = SimpleNamespace(free_contraction=0.2)
    design = SimpleNamespace(
        outputs=np.array([51.9]), spec=SimpleNamespace(entries=entries), free_contraction=free
    )
    assert format_requirement_margin(design, FREE).startswith(text)


def test_output_ratio_inverts_the_margin():
    from pamjax.sizing.report import compute_output_ratio

    ratios = np.array([-0.2, 0.03, 0.1, 0.5, 2.0])
    agree(
        [compute_output_ratio(float(FORCE.compute_margins(np.array([5000 * ratio]))[0])) for ratio in ratios],
        ratios,
        ROUNDING,
    )


def format_note(*relaxations):
    """Return the report of an infeasible design with these relaxations."""
    spec = SimpleNamespace(name="it", entries=None)
    return format_design_summary(
        SimpleNamespace(spec=spec, choice="a choice", feasible=False, relaxations=relaxations)
    )  # pyright: ignore


def test_sufficient_and_insufficient_relaxations_are_separate():
    sufficient, insufficient = (
        Relaxation(FORCE, 0.5, 1800.0),
        Relaxation(DIAMETER, 0.5, None, shortfall="39.4 mm, 24.4 mm too high"),
    )
    lines = format_note(sufficient, insufficient).splitlines()
    assert "    force at least 5000 N at 20 % contraction: relax to 1800 N" in lines
    assert "  also in conflict, but removing one of these alone is not sufficient:" in lines
    assert lines[-1] == "    diameter at most 15 mm: the nearest muscle has 39.4 mm, 24.4 mm too high"
    assert "is not sufficient" not in format_note(sufficient)
    assert (
        "  removing one requirement alone is not sufficient: relax several:"
        in format_note(insufficient).splitlines()
    )
    assert (
        format_note().splitlines()[-1] == "  removing one requirement alone is not sufficient: relax several"
    )
