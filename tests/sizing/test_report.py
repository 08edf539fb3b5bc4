"""Words of a sizing: which side of a requirement a muscle is on, and by how much, each with its unit."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.sizing.infeasible import Relaxation, format_shortfall
from pamjax.sizing.report import format_design_note, format_margin
from pamjax.sizing.requirements import Requirement
from tests.agreement import ROUNDING, agree

PULL = Requirement("force 1", "pull 5000 N at 20 %", (0,), (5000.0,), 1, 5000.0, "N")
WIDE = Requirement("diameter", "be 15 mm wide at most", (0, 1), (0.015, 0.015), -1, 0.015, "mm")
MESH = Requirement(
    "mesh", "bladder 1.5 times from bulging", (0,), (1 / 1.5,), -1, 1 / 1.5, "1", is_safety_factor=True
)
FREE = Requirement("free contraction", "contract by 20 % without load", (0,), (0.0,), 1, 1000.0, "N")
LONG = Requirement("length", "be 200 mm long at most", (0,), (0.16,), -1, 0.16, "mm", fitting_length=0.04)


@pytest.mark.parametrize(
    ("one", "shows", "room", "short"),
    [
        (PULL, [1897.0], "62.1 % short", "1900 N, 3100 N short"),
        (PULL, [100.0], "98 % short", "100 N, 4900 N short"),
        (WIDE, [0.012, 0.0394], "163 % too much", "39.4 mm, 24.4 mm too much"),
        (MESH, [1 / 0.57], "62 % short", "0.57 times, 0.93 short"),
        (FREE, [-50.0], "50 N short", "-50 N, 50 N short"),
        (LONG, [0.2], "25 % too much", "240 mm, 40 mm too much"),
    ],
    ids=lambda value: value.key if isinstance(value, Requirement) else None,
)
def test_what_is_missed_is_told_by_how_much(one, shows, room, short):
    y = np.array(shows)
    assert format_margin(float(one.compute_margins(y).min()), one) == room
    assert format_shortfall(one, y) == short


@pytest.mark.parametrize(
    ("one", "shows", "room"),
    [
        (PULL, 5500.0, "10 % to spare"),
        (WIDE, 0.0075, "100 % to spare"),
        (MESH, 0.1 / 1.5, "10 times to spare"),
        (FREE, 51.9, "51.9 N to spare"),
    ],
    ids=lambda value: value.key if isinstance(value, Requirement) else None,
)
def test_what_is_kept_has_room_to_spare(one, shows, room):
    assert format_margin(float(one.compute_margins(np.full(2, shows)).min()), one) == room


def test_a_share_is_found_again_from_its_room():
    from pamjax.sizing.report import compute_output_ratio

    shares = np.array([-0.2, 0.03, 0.1, 0.5, 2.0])
    agree(
        [compute_output_ratio(float(PULL.compute_margins(np.array([5000 * s]))[0])) for s in shares],
        shares,
        ROUNDING,
    )


def told(*gives):
    spec = SimpleNamespace(name="it", entries=None)
    return format_design_note(
        SimpleNamespace(spec=spec, choice="a choice", feasible=False, relaxations=gives)
    )  # pyright: ignore


def test_a_note_parts_what_does_alone_from_what_does_not():
    alone, short = (
        Relaxation(PULL, 0.5, 1800.0),
        Relaxation(WIDE, 0.5, None, shortfall="39.4 mm, 24.4 mm too much"),
    )
    lines = told(alone, short).splitlines()
    assert "    pull 5000 N at 20 %: 1800 N would do" in lines
    assert "  in the way as well, and not enough alone even if given up:" in lines
    assert lines[-1] == "    be 15 mm wide at most: the nearest muscle has 39.4 mm, 24.4 mm too much"
    assert "given up alone, is enough" not in told(alone)
    assert "  no one requirement, given up alone, is enough: relax several:" in told(short).splitlines()
    assert told().splitlines()[-1] == "  no one requirement, given up alone, is enough: relax several"
