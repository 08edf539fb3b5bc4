"""The units of a table in a line of their own, below the header."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pamjax.errors import BadInput
from pamjax.records.reading.header import COLUMN_KINDS, split_title
from pamjax.units import parse_unit

#: Marks around a unit.
_MARKS = ' \t\r\n"[]()'


def add_units(names: Sequence[str], units: Iterable[object]) -> list[str]:
    """Return the headers with the units of the line below, as in "Load [N]".

    A header with a unit of its own, and one above a blank cell, remain as they are.

    >>> add_units(["time", "Load", "test"], ["s", "[N]", ""])
    ['time [s]', 'Load [N]', 'test']
    """
    cells = ["" if unit != unit else str(unit).strip(_MARKS) for unit in units]  # NaN for a blank cell
    cells += [""] * (len(names) - len(cells))
    return [
        f"{name} [{unit}]" if unit and split_title(name)[1] is None else name
        for name, unit in zip(names, cells, strict=False)
    ]


def is_unit(cell: str) -> bool:
    """Return whether a cell contains a unit.

    >>> is_unit("[mm]"), is_unit("n/a")
    (True, False)
    """
    unit = cell.strip(_MARKS)
    return unit == "%" or (unit != "" and any(_has_kind(unit, kind) for kind in COLUMN_KINDS.values()))


def _has_kind(unit: str, kind: str) -> bool:
    try:
        parse_unit(unit, kind)
    except BadInput:
        return False
    return True
