"""The unit of a column of a rig's file: its SI value, and messages for unknown and absolute units."""

from __future__ import annotations

from collections.abc import Iterable

from pamjax.errors import BadInput
from pamjax.records.importing.unit_line import is_unit
from pamjax.records.reading.header import ABSOLUTE_UNITS, GAUGE_UNITS, split_title
from pamjax.units import ATMOSPHERIC_PRESSURE, parse_unit


def convert_unit(name: str, kind: str, unit: str, where: str, in_header: bool) -> float:
    """Return the SI value of the unit of a channel.

    Args:
        name: name of the channel.
        kind: required kind of quantity.
        unit: the unit; of a pressure also `psig` or `barg`.
        where: place for the error message.
        in_header: whether the unit is in the header of the file, instead of [columns].

    Raises:
        BadInput: if the unit is unknown, of another kind, or of an absolute pressure.
    """
    if kind == "pressure" and unit in ABSOLUTE_UNITS:
        raise _build_absolute_error(unit, where)
    unit = GAUGE_UNITS.get(unit, unit) if kind == "pressure" else unit
    try:
        return parse_unit(unit, kind, where)
    except BadInput as error:
        if not in_header:
            raise
        raise BadInput(
            f"{error} Correct the header, or write the `unit` of `{name}` in [columns]."
        ) from error


def check_similar_headers(column: str, headers: Iterable[str], file: str) -> None:
    """Refuse an unknown unit in a header that is otherwise the required one.

    Args:
        column: the required header.
        headers: the headers of the file.
        file: name of the file.

    Raises:
        BadInput: with the unknown unit and the required one.
    """
    plain_name, required_unit = split_title(column)
    for header in headers:
        name, unit = split_title(header)
        if not unit or not required_unit or name != plain_name or unit in GAUGE_UNITS or is_unit(unit):
            continue
        where = f"column `{header}` of {file}"
        if unit in ABSOLUTE_UNITS:
            raise _build_absolute_error(unit, where)
        remedy = (
            f"Did you mean `{required_unit}`? Correct the header, or write"
            f' {{column = "{plain_name}", unit = "{required_unit}"}} in [columns].'
        )
        raise BadInput.from_rule(f"unknown unit {unit!r}", "", where, remedy)


def _build_absolute_error(unit: str, where: str) -> BadInput:
    gauge_unit = ABSOLUTE_UNITS[unit]
    atmosphere = ATMOSPHERIC_PRESSURE / parse_unit(gauge_unit, "pressure")
    remedy = (
        f'Write unit = "{gauge_unit}" in [columns]. If the sensor reads absolute pressure, write also'
        f" zero = {atmosphere:.4g}, the pressure of the atmosphere."
    )
    return BadInput.from_rule("`pressure` must be gauge pressure", f"{unit!r}", where, remedy)
