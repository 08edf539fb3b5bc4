"""Conversion of units to SI; the only module that uses pint."""

from __future__ import annotations

import difflib
import math
import re
import tokenize
import unicodedata
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, TypeGuard

from pamjax.errors import BadInput

if TYPE_CHECKING:
    import numpy as np
    import pint

#: The SI unit in which each kind of quantity is kept inside pamjax.
SI_UNITS = {
    "length": "m",
    "area": "m^2",
    "volume": "m^3",
    "pressure": "Pa",
    "force": "N",
    "time": "s",
    "speed": "m/s",
    "frequency": "Hz",
    "angle": "rad",
    "count": "1",
}

#: The standard atmosphere, Pa. Gauge pressures are relative to it.
ATMOSPHERIC_PRESSURE = 101325.0

#: Factors of the most usual units by SI unit, as pint computes them. Pint takes half a second to load, a
#: large part of a short command.
USUAL_UNITS = {
    "m": {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254},
    "m^2": {"mm^2": 1e-6},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5, "psi": 6894.7572931683635},
    "N": {"N": 1.0, "kN": 1e3, "MN": 1e6, "lbf": 4.4482216152605005, "kgf": 9.80665},
    "s": {"s": 1.0, "ms": 0.001, "min": 60.0},
    "m/s": {"m/s": 1.0, "mm/s": 0.001},
    "Hz": {"Hz": 1.0},
    "rad": {"rad": 1.0, "deg": 0.017453292519943295},
}
_USUAL_FACTORS = {unit: factor for units in USUAL_UNITS.values() for unit, factor in units.items()}

#: Standard acceleration of gravity, m/s².
STANDARD_GRAVITY = 9.80665

#: Name of a unit, with a power of one or two digits.
_UNIT_NAME = r"(?:[^\W\d_]|°)[\w°]{0,29}(?:\s*(?:\^|\*\*)\s*-?\d{1,2})?"

#: Form of a unit: a product or quotient of names, or 1 over them. Other texts can stop pint's parser with any
#: error, or occupy it for hours.
_UNIT_PATTERN = re.compile(
    rf"(?:1\s*/\s*)?\(?\s*{_UNIT_NAME}"
    rf"(?:\s*[*/·\s]\s*\(?\s*{_UNIT_NAME}\s*\)?)*\s*\)?"
)

#: Numbers from the first on, with an sd from the second on, or below the third are shown with a power of ten.
_MIN_EXPONENT_NUMBER, _MIN_EXPONENT_SD, _MAX_EXPONENT_NUMBER = 1e6, 1e4, 1e-3

#: Smallest and largest magnitude of a number in SI, except 0; their squares still fit in a float.
MAGNITUDE_LIMITS = (1e-30, 1e30)

#: Units of length that some people write as a sign.
UNIT_SIGNS = {'"': "in", "\u2033": "in", "''": "in", "\u201d": "in", "'": "ft"}

#: Names of units that a mistyped unit may mean, in addition to the symbols of `suggest_units`.
UNIT_NAMES = {
    "length": ("millimetre", "millimeter", "centimetre", "centimeter", "metre", "meter", "inch", "foot"),
    "pressure": ("pascal", "kilopascal", "megapascal", "millibar"),
    "force": ("newton", "kilonewton", "pound_force", "kilogram_force"),
    "time": ("second", "millisecond", "minute", "hour"),
    "frequency": ("hertz", "kilohertz"),
    "angle": ("degree", "radian"),
}

#: Other errors that pint's parser raises, in addition to its own.
_PARSER_ERRORS = (ArithmeticError, AssertionError, LookupError, ValueError, TypeError, tokenize.TokenError)

#: Longest text of a unit.
MAX_UNIT_CHARACTERS = 60

_QUANTITY_PATTERN = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")

#: The part of a number behind a decimal comma.
_QUANTITY_COMMA_PATTERN = re.compile(r",\d")


@cache
def load_unit_registry() -> pint.UnitRegistry:
    """Return the unit registry, built at the first conversion of an unusual unit: a third of a second."""
    import pint

    # Not cached on disk: pint's cache contains paths into the environment that wrote it. Other environments
    # of the same user fail after that environment is deleted.
    return pint.UnitRegistry()


@cache
def parse_unit(unit: str, kind: str, where: str = "", number: float = 1.0) -> float:
    """Return the SI value of one `unit`.

    Args:
        unit: any unit name of pint, as "psi", "lbf", "mm^2", "deg"; "" and "1" for a pure number.
        kind: required kind of quantity, a key of `SI_UNITS`.
        where: place for the error message.
        number: the number before the unit, for the error message.

    Raises:
        BadInput: if the unit is unknown or of another kind.

    >>> round(parse_unit("psi", "pressure"), 3)
    6894.757
    """
    si = SI_UNITS[kind]
    if unit in ("", "1"):
        if kind == "count":
            return 1.0
        raise BadInput.from_rule(
            f"{_add_article(kind)} needs a unit", "none", where, f"Write one, such as {suggest_units(kind)}."
        )
    if kind == "count":
        raise BadInput.from_rule("a dimensionless value has no unit", f"{unit!r}", where, "Remove the unit.")
    return _convert_unit(unit, si, kind, where, number)


def _convert_unit(unit: str, si: str, kind: str, where: str, number: float = 1.0) -> float:
    if unit in USUAL_UNITS.get(si, ()):
        return _USUAL_FACTORS[unit]
    import pint

    try:
        if len(unit) > MAX_UNIT_CHARACTERS or not _UNIT_PATTERN.fullmatch(unit):
            raise ValueError("not the form of a unit")
        quantity = load_unit_registry().Quantity(1.0, unit)
    # Pint's parser raises errors of many types on texts that are no units.
    except (*_PARSER_ERRORS, pint.PintError) as error:
        shown = unit if len(unit) <= MAX_UNIT_CHARACTERS else f"{unit[:MAX_UNIT_CHARACTERS]}..."
        raise BadInput.from_rule(
            f"unknown unit {shown!r}", where=where, remedy=_suggest_unit(unit, kind, si)
        ) from error
    if not quantity.check(load_unit_registry().Quantity(1.0, si).dimensionality):
        rule = f"{_add_article(kind)} must have a unit of {kind}"
        if kind not in SI_UNITS:
            rule = f"this value must have a unit that converts to {si}"
        remedy = f"Use one such as {suggest_units(kind)}."
        if kind == "force" and quantity.check("[mass]"):
            weight = number * float(quantity.to("kg").magnitude) * STANDARD_GRAVITY
            remedy += f" The weight of {number:g} {unit} is {weight:.3g} N."
        raise BadInput.from_rule(rule, f"{unit!r}", where, remedy)
    if not quantity._is_multiplicative:
        raise BadInput.from_rule(
            f"the unit of {_add_article(kind)} must be a multiple of {si}",
            f"{unit!r}",
            where,
            "This unit has an offset.",
        )
    return float(quantity.to(si).magnitude)


def _suggest_unit(unit: str, kind: str, si: str) -> str:
    if kind not in SI_UNITS:
        return f"Write it in {si}."
    known_units = [name for name in re.findall(r"[^\s,]+", suggest_units(kind)) if name != "or"]
    # Compatibility form: one character such as ㎜ becomes its letters.
    plain = unicodedata.normalize("NFKC", unit[:MAX_UNIT_CHARACTERS]).strip()
    lower_case = {name.lower(): name for name in (*known_units, *UNIT_NAMES.get(kind, ()))}
    matches = difflib.get_close_matches(plain.lower(), lower_case, n=1, cutoff=0.65)
    if plain in UNIT_SIGNS and kind == "length":
        return f"Did you mean `{UNIT_SIGNS[plain]}`?"
    if matches:
        return f"Did you mean `{lower_case[matches[0]]}`?"
    return f"Write {_add_article(kind)} in {suggest_units(kind)}."


def _add_article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def suggest_units(kind: str) -> str:
    """Return common units of this kind of quantity, for error messages."""
    return {
        "length": "mm, cm, m or in",
        "area": "mm^2",
        "volume": "mL or cm^3",
        "pressure": "kPa, bar, MPa or psi",
        "force": "N, kN or lbf",
        "time": "s, ms or min",
        "speed": "mm/s",
        "frequency": "Hz or 1/s",
        "angle": "deg or rad",
        "count": "a number without a unit",
    }.get(kind, kind.removeprefix("number in "))


def parse_quantity(text: str | float, kind: str, where: str = "") -> float:
    """Return the SI value of a text such as "235.74 mm", or of a pure number if `kind` is "count".

    Raises:
        BadInput: if there is no number, the unit is missing, unknown or of another kind, or the value is not
            finite or outside `MAGNITUDE_LIMITS`.

    >>> round(parse_quantity("9.89 in", "length"), 6)
    0.251206
    """
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        return _check_magnitude(float(text) * parse_unit("", kind, where), text, where)
    match = _QUANTITY_PATTERN.match(str(text))
    if match is None:
        rule, remedy = "a quantity is a number and a unit", f"Write {suggest_units(kind)} after it."
        if kind == "count":
            rule, remedy = "a dimensionless value is a number without a unit", "Write a number."
        raise BadInput.from_rule(rule, f"{text!r}", where, remedy)
    _check_decimal_mark(match, where)
    number = float(match[1])
    factor = parse_unit(match[2], kind, where, number if kind == "force" else 1.0)
    return _check_magnitude(number * factor, text, where)


def parse_number(text: str, si: str, where: str = "") -> float:
    """Return the SI value of a text such as "5 kPa"; a pure number and 0 need no unit.

    Raises:
        BadInput: if there is no number, its unit is missing, unknown or of another dimension, or the value is
            not finite or outside `MAGNITUDE_LIMITS`.

    >>> parse_number("5 kPa", "Pa"), parse_number("0.2", "1"), parse_number("0", "N")
    (5000.0, 0.2, 0.0)
    """
    match = _QUANTITY_PATTERN.match(text)
    if match is None:
        raise BadInput.from_rule("a value is a number and a unit", f"{text!r}", where, f"Its unit is {si}.")
    _check_decimal_mark(match, where)
    unit = match[2]
    if unit in ("", "1"):
        if si != "1" and float(match[1]):
            remedy = f"Write one that converts to {si} after it."
            raise BadInput.from_rule("this value needs a unit", f"{text.strip()!r}", where, remedy)
        return _check_magnitude(float(match[1]), text, where)
    if si == "1":
        raise BadInput.from_rule("a dimensionless value has no unit", f"{unit!r}", where, "Remove the unit.")
    return _check_magnitude(float(match[1]) * _convert_unit(unit, si, f"number in {si}", where), text, where)


def _check_decimal_mark(match: re.Match[str], where: str) -> None:
    """Refuse a number with a decimal comma."""
    if _QUANTITY_COMMA_PATTERN.match(match[2]):
        text = match[0].strip()
        remedy = f'Write "{text.replace(",", ".", 1)}".'
        raise BadInput.from_rule("the decimal mark is a point", f"{text!r}", where, remedy)


def _check_magnitude(value: float, text: str | float, where: str) -> float:
    """Return the value of a text, SI, if a model can compute with it."""
    if not math.isfinite(value):
        remedy = "Remove the entry if the value is unknown."
        raise BadInput.from_rule("a quantity must be finite", f"{text!r}", where, remedy)
    if not is_representable(value):
        low, high = MAGNITUDE_LIMITS
        rule = f"a quantity must be between {low:g} and {high:g} in SI units"
        raise BadInput.from_rule(rule, f"{text!r}", where, "Check the number and its unit.")
    return value


@cache
def compute_si_factor(unit: str) -> float:
    """Return the SI value of one `unit` of any kind; for output only, because the kind is not checked."""
    if unit in ("", "1"):
        return 1.0
    if unit in _USUAL_FACTORS:
        return _USUAL_FACTORS[unit]
    return float(load_unit_registry().Quantity(1.0, unit).to_base_units().magnitude)


def is_representable(value: float | np.ndarray) -> bool | np.ndarray:
    """Return whether a number, or each of an array, is 0 or of a magnitude that a model can compute with.

    >>> is_representable(0.0), is_representable(-1e30), is_representable(1e308), is_representable(1e-320)
    (True, True, False, False)
    """
    low, high = MAGNITUDE_LIMITS
    return (value == 0.0) | ((abs(value) >= low) & (abs(value) <= high))


def format_count(count: int, noun: str) -> str:
    """Return a count and its noun as text.

    >>> format_count(1, "row"), format_count(2, "row")
    ('1 row', '2 rows')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def format_quantity(value: float, unit: str, digits: int = 4) -> str:
    """Return an SI number as text in a unit.

    >>> format_quantity(0.235744, "mm")
    '235.7 mm'
    """
    number = format_number(value / compute_si_factor(unit), digits)
    return number if unit in ("", "1") else f"{number} {unit}"


def format_number(value: float, digits: int) -> str:
    """Return a number with significant digits.

    A power of ten is written below a ten-thousandth, and from a million on if zeros would follow the digits.

    >>> format_number(123.4, 2), format_number(3.7045e9, 3), format_number(0.0012, 2)
    ('120', '3.7e9', '0.0012')
    """
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    if 1 <= abs(float(text)) < _MIN_EXPONENT_NUMBER:
        return f"{float(text):.0f}"
    mantissa, _, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}"


def format_estimate(value: float, sd: float | None, unit: str) -> str:
    """Return value ± sd in a unit, SI numbers; both have the digits that two digits of the sd need.

    >>> format_estimate(83.512e9, 3.43e9, "GPa"), format_estimate(3.7045e9, 3.2325e9, "Pa*s/m^3")
    ('83.5 ± 3.4 GPa', '(3.7 ± 3.2)e9 Pa*s/m^3')
    >>> format_estimate(-0.02, 1.3, "1")
    '0.0 ± 1.3'
    """
    if not (has_digits(sd) and math.isfinite(value)):
        return format_quantity(value, unit, 5)
    (value_text, sd_text), power = round_by_sd([value, sd], sd, unit)
    text = f"({value_text} ± {sd_text}){power}" if power else f"{value_text} ± {sd_text}"
    return text if unit in ("", "1") else f"{text} {unit}"


def has_digits(sd: float | None) -> TypeGuard[float]:
    """Return whether an sd determines the digits of a value: it is known, finite and above zero."""
    return sd is not None and math.isfinite(sd) and sd > 0


def round_by_sd(values: Sequence[float], sd: float, unit: str) -> tuple[list[str], str]:
    """Return numbers in a unit, rounded to two digits of their sd, and their common power of ten.

    Args:
        values: SI numbers.
        sd: their standard deviation, SI, above zero.
        unit: display unit.

    >>> round_by_sd([5123.0, 4876.0], 1234.0, "N"), round_by_sd([1.2e-5], 3e-7, "1")
    ((['5100', '4900'], ''), (['1.200'], 'e-5'))
    """
    scale = compute_si_factor(unit)
    values, sd = [value / scale for value in values], sd / scale
    largest = max(*map(abs, values), sd)
    power = ""
    if largest >= _MIN_EXPONENT_NUMBER or sd >= _MIN_EXPONENT_SD or largest < _MAX_EXPONENT_NUMBER:
        exponent = math.floor(math.log10(largest))
        values, sd, power = [value / 10.0**exponent for value in values], sd / 10.0**exponent, f"e{exponent}"
    decimals = 1 - math.floor(math.log10(sd))
    # A zero is added, because a rounded negative number can be -0.0.
    return [f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}" for value in values], power
