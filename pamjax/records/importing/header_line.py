"""The line of the header in a file with lines above it, for the remedy of a message."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pamjax.records.importing.unit_line import is_unit
from pamjax.records.reading.header import split_title

#: A number with any decimal mark, or a clock time.
_NUMBER_PATTERN = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?|\d+:\d\d(?::\d\d)?(?:[.,]\d*)?")


def suggest_header_line(lines: Sequence[str], mark: str, current: int) -> str:
    """Return the remedy if the header seems to be in a later line than the current one; else "".

    Args:
        lines: the first lines of the file.
        mark: separator of cells; a space for any blanks.
        current: index of the line that is read as header.

    >>> suggest_header_line(["bench 2", "t,F", "0,5", "1,6"], ",", 0)
    'The header seems to be in row 2: write skip = 1 in [files].'
    """
    rows = [_split_cells(line, mark) for line in lines]
    first = next((k for k in range(len(rows)) if all(map(_has_numbers, rows[k : k + 2]))), 0)
    has_units = first > 1 and _has_units(rows[first - 1]) and len(rows[first - 2]) > 1
    header = first - 1 - has_units
    if header <= current or len(rows[header]) < 2:
        return ""
    units = " and units = true" if has_units else ""
    return f"The header seems to be in row {header + 1}: write skip = {header}{units} in [files]."


def suggest_line_with(lines: Sequence[str], mark: str, start: int, column: str) -> str:
    """Return the remedy if a line from `start` on has a column with this header; else ""."""
    for k, line in enumerate(lines[start:], start):
        if any(column in (cell, split_title(cell)[0]) for cell in _split_cells(line, mark)):
            return f"Line {k + 1} has it: write skip = {k} in [files]."
    return ""


def _split_cells(line: str, mark: str) -> list[str]:
    """Return the cells of a line that are not blank."""
    cells = line.split() if mark == " " else line.split(mark)
    return [cell for cell in (cell.strip(' \t\r\n"') for cell in cells) if cell]


def _has_numbers(cells: list[str]) -> bool:
    """Return whether a row has several cells, and most of them are numbers."""
    count = sum(_NUMBER_PATTERN.fullmatch(cell) is not None for cell in cells)
    return len(cells) > 1 and 2 * count > len(cells)


def _has_units(cells: list[str]) -> bool:
    return 2 * sum(map(is_unit, cells)) > len(cells)
