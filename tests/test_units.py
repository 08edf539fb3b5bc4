"""Units: the way to SI, the way back, and what is said about a bad one."""

import math

import pytest

from pamjax.errors import BadInput
from pamjax.units import (
    SI_UNITS,
    compute_si_factor,
    format_quantity,
    load_unit_registry,
    parse_number,
    parse_quantity,
    parse_unit,
    suggest_units,
)
from tests.agreement import ROUNDING, agree

# By definition: the inch is 25.4 mm, the pound 0.45359237 kg, standard gravity 9.80665 m/s².
POUND_FORCE = 0.45359237 * 9.80665


@pytest.mark.parametrize(
    ("unit", "kind", "si"),
    [
        ("in", "length", 0.0254),
        ("mm^2", "area", 1e-6),
        ("mL", "volume", 1e-6),
        ("psi", "pressure", POUND_FORCE / 0.0254**2),
        ("bar", "pressure", 1e5),
        ("lbf", "force", POUND_FORCE),
        ("min", "time", 60.0),
        ("deg", "angle", math.pi / 180),
        ("1", "count", 1.0),
        ("", "count", 1.0),
    ],
)
def test_factor(unit, kind, si):
    agree(parse_unit(unit, kind), si, ROUNDING)
    agree(compute_si_factor(unit), si, ROUNDING)


@pytest.mark.parametrize("kind", SI_UNITS)
def test_each_kind_is_one_in_si(kind):
    assert parse_unit(SI_UNITS[kind], kind) == 1.0
    assert suggest_units(kind)


def test_parse_and_show():
    agree(parse_quantity("9.89 in", "length"), 9.89 * 0.0254, ROUNDING)
    agree(parse_quantity("-.5e2kPa", "pressure"), -5e4, ROUNDING)
    assert parse_quantity(144, "count") == 144.0
    assert parse_quantity("1.09", "count") == 1.09
    assert format_quantity(0.235744, "mm") == "235.7 mm"
    assert format_quantity(1.09, "1") == "1.09"
    assert format_quantity(689.48e3, "kPa", 5) == "689.48 kPa"


@pytest.mark.parametrize(
    ("text", "kind", "complaint"),
    [
        ("9.89", "length", "a length needs a unit; got none in muscle.toml. "
            "Write one, such as mm, cm, m or in."),
        ("9.89 s", "length", "a length must have a unit of length; got 's' in muscle.toml. "
            "Use one such as mm, cm, m or in."),
        ("9.89 furz", "length", "'furz' is no unit that pamjax knows (muscle.toml). "
            "A length is written as mm, cm, m or in."),
        ("long", "length", "a quantity is a number and a unit; got 'long' in muscle.toml. "
            "Write mm, cm, m or in after it."),
        ("3 mm", "count", "this number has no unit; got 'mm' in muscle.toml. Leave the unit out."),
        (9.89, "length", "a length needs a unit; got none in muscle.toml. "
            "Write one, such as mm, cm, m or in."),
    ],
)  # fmt: skip
def test_a_bad_unit_is_told(text, kind, complaint):
    with pytest.raises(BadInput) as told:
        parse_quantity(text, kind, "muscle.toml")
    assert str(told.value) == complaint


@pytest.mark.parametrize("text", ["5", " 5 ", "-5e3", "5 1"])
def test_a_bare_number_where_a_unit_belongs_is_told(text):
    with pytest.raises(BadInput) as told:
        parse_number(text, "Pa", "--with")
    rule = "this number needs a unit; got " + repr(text.strip())
    assert str(told.value) == f"{rule} in --with. Write one that converts to Pa after it."


def test_nothing_and_a_pure_number_need_no_unit():
    assert parse_number("0", "Pa") == parse_number("-0.0", "Pa") == 0.0
    assert parse_number("0.2", "1") == 0.2


def test_units_outlive_the_environment_that_read_them_first():
    # A cache on disk is shared by all environments, and keeps paths into the first.
    assert load_unit_registry()._diskcache is None
