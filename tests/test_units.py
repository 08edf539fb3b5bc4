"""Units: conversion to and from SI, and messages for invalid units."""

import math
import re
import subprocess
import sys

import pytest

from pamjax.errors import BadInput
from pamjax.units import (
    SI_UNITS,
    UNIT_NAMES,
    USUAL_UNITS,
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
def test_conversion_factor(unit, kind, si):
    agree(parse_unit(unit, kind), si, ROUNDING)
    agree(compute_si_factor(unit), si, ROUNDING)


@pytest.mark.parametrize(("si", "unit"), [(si, unit) for si in USUAL_UNITS for unit in USUAL_UNITS[si]])
def test_usual_unit_has_the_factor_of_pint(si, unit):
    quantity = load_unit_registry().Quantity(1.0, unit)
    assert USUAL_UNITS[si][unit] == quantity.to(si).magnitude == quantity.to_base_units().magnitude


def test_usual_units_do_not_load_pint():
    program = (
        "import sys; from pamjax.units import parse_quantity, format_quantity;"
        " format_quantity(parse_quantity('3 mm', 'length'), 'in'); print('pint' in sys.modules);"
        " parse_quantity('3 km', 'length'); print('pint' in sys.modules)"
    )
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "True"]


@pytest.mark.parametrize("kind", SI_UNITS)
def test_si_unit_has_factor_one(kind):
    assert parse_unit(SI_UNITS[kind], kind) == 1.0
    assert suggest_units(kind)


def test_quantities_are_parsed_and_formatted():
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
        ("9.89 furz", "length", "unknown unit 'furz' (muscle.toml). "
            "Write a length in mm, cm, m or in."),
        ("long", "length", "a quantity is a number and a unit; got 'long' in muscle.toml. "
            "Write mm, cm, m or in after it."),
        ("many", "count", "a dimensionless value is a number without a unit; got 'many' in muscle.toml. "
            "Write a number."),
        ("3 mm", "count", "a dimensionless value has no unit; got 'mm' in muscle.toml. Remove the unit."),
        (9.89, "length", "a length needs a unit; got none in muscle.toml. "
            "Write one, such as mm, cm, m or in."),
    ],
)  # fmt: skip
def test_invalid_unit_is_refused(text, kind, complaint):
    with pytest.raises(BadInput) as error:
        parse_quantity(text, kind, "muscle.toml")
    assert str(error.value) == complaint


@pytest.mark.parametrize(
    "unit",
    [
        *('"', "㎜", "mm/", "m(", "m/0", "(m**0)", "m*" * 5000, "m^", "*m"),
        # Powers of powers occupy pint for hours.
        *("9**9**9**9", "10**10**10 m", "2**1000000000 m"),
    ],
)
def test_text_that_is_no_unit_is_refused_at_once(unit):
    with pytest.raises(
        BadInput, match=r"^unknown unit .* (Write a length in mm, cm, m or in\.|Did you mean `(mm|m|in)`\?)$"
    ) as error:
        parse_unit(unit, "length")
    assert len(str(error.value)) < 150


@pytest.mark.parametrize(
    ("unit", "kind", "si"),
    [
        ("°", "angle", math.pi / 180),
        ("N/mm²", "pressure", 1e6),
        ("N mm^-2", "pressure", 1e6),
        ("kgf/cm**2", "pressure", 98066.5),
        ("N/(m*m)", "pressure", 1.0),
        ("1/min", "frequency", 1 / 60),
        ("m·s^-1", "speed", 1.0),
    ],
)
def test_compound_units_are_accepted(unit, kind, si):
    agree(parse_unit(unit, kind), si, 1e-9)


def test_unit_in_another_case_is_suggested():
    with pytest.raises(BadInput, match=r"unknown unit .PSI.\. Did you mean `psi`\?"):
        parse_unit("PSI", "pressure")


@pytest.mark.parametrize(
    ("unit", "kind", "nearest"),
    [
        ("newtn", "force", "newton"),
        ("Newtons", "force", "newton"),
        ("kilopascl", "pressure", "kilopascal"),
        ("milimeter", "length", "millimeter"),
        ("secnd", "time", "second"),
    ],
)
def test_misspelt_name_of_a_unit_is_corrected(unit, kind, nearest):
    with pytest.raises(BadInput, match=rf"unknown unit '{unit}'\. Did you mean `{nearest}`\?"):
        parse_unit(unit, kind)


@pytest.mark.parametrize(("kind", "names"), UNIT_NAMES.items())
def test_each_suggested_name_of_a_unit_is_accepted(kind, names):
    assert all(parse_unit(name, kind) > 0 for name in names)


@pytest.mark.parametrize("text", ["5", " 5 ", "-5e3", "5 1"])
def test_number_without_its_unit_is_refused(text):
    with pytest.raises(BadInput) as error:
        parse_number(text, "Pa", "--with")
    rule = "this value needs a unit; got " + repr(text.strip())
    assert str(error.value) == f"{rule} in --with. Write one that converts to Pa after it."


def test_zero_and_dimensionless_numbers_need_no_unit():
    assert parse_number("0", "Pa") == parse_number("-0.0", "Pa") == 0.0
    assert parse_number("0.2", "1") == 0.2


def test_unit_registry_has_no_cache_on_disk():
    # All environments would share a cache on disk, which stores paths of the first one.
    assert load_unit_registry()._diskcache is None


@pytest.mark.parametrize("text", ["1e308 kPa", "-1e31 Pa", "1e-31 Pa"])
def test_quantity_that_no_model_can_use_is_refused(text):
    for parse in (lambda: parse_quantity(text, "pressure", "x"), lambda: parse_number(text, "Pa", "x")):
        with pytest.raises(BadInput, match="a quantity must be "):
            parse()


def test_number_that_is_not_finite_is_refused():
    with pytest.raises(BadInput, match=r"a quantity must be finite; got nan in minutes\."):
        parse_quantity(float("nan"), "count", "minutes")
    assert parse_quantity("0 kPa", "pressure") == 0.0


def test_unclosed_bracket_of_a_unit_is_refused():
    with pytest.raises(BadInput, match="unknown unit"):
        parse_quantity("5 (mm", "length")


@pytest.mark.parametrize("text", ["267,2 mm", "1,5", "-0,5e3 mm"])
def test_decimal_comma_is_explained(text):
    message = f"the decimal mark is a point; got '{text}' in a.toml. Write \"{text.replace(',', '.')}\"."
    for parse in (parse_quantity, parse_number):
        with pytest.raises(BadInput, match=f"^{re.escape(message)}$"):
            parse(text, "length" if parse is parse_quantity else "m", "a.toml")
    agree(parse_quantity("267.2 mm", "length"), 0.2672, ROUNDING)
