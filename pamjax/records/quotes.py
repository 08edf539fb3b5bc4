"""Check of quotation marks in a CSV file: an unclosed cell would include the next rows."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from pamjax.errors import refuse

#: Characters of a wrong cell that an error shows.
SHOWN = 30


def lines_of(text: str) -> list[str]:
    """Return the lines of a text, each with its own line ending."""
    return list(io.StringIO(text, newline=""))


def check_quotes(
    lines: Sequence[str], file: str, separator: str, header: str = "", *, skip_spaces: bool = False
) -> None:
    """Refuse the first line in which a quoted cell does not end.

    A quotation mark opens a quoted cell only at the beginning of the cell. A quoted cell may contain
    separators, and two quotation marks for one. It must not contain a line break.

    Args:
        lines: lines of the whole file; the row number in the message is the index in this list plus 1.
        file: file name for the message.
        separator: one character; a space means any number of spaces.
        header: header line, for the message; without it, the message has the column number from 1.
        skip_spaces: whether the reader ignores spaces before a cell and its quotation mark.

    Raises:
        BadInput: with column and row.
    """
    for row, line in enumerate(lines, 1):
        opened = _open_cell(line.rstrip("\r\n"), separator, skip_spaces) if '"' in line else None
        if opened is None:
            continue
        index, cell = opened
        titles = _cells([header], separator, skip_spaces)[0] if row > 1 and header.strip() else []
        title = titles[index].strip() if index < len(titles) else ""
        column = f"column `{title}`" if title else f"column {index + 1}"
        shown = cell if len(cell) <= SHOWN else f"{cell[:SHOWN]}…"
        raise refuse(
            "a quoted cell must end with a quotation mark in its own row",
            f"'\"{shown}'",
            f"{column}, row {row} of {file}",
            "Close the quotation mark or take it out; inside a quoted cell write two for one.",
        )


def _open_cell(line: str, separator: str, skip_spaces: bool) -> tuple[int, str] | None:
    """Return the index and the text of the line's unclosed cell; None if all cells are closed."""
    # An open cell takes the next line with it.
    rows = _cells([line, "next"], separator, skip_spaces)
    if len(rows) > 1:
        return None
    return len(rows[0]) - 1, rows[0][-1].removesuffix("next")


def _cells(lines: list[str], separator: str, skip_spaces: bool) -> list[list[str]]:
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=skip_spaces))
