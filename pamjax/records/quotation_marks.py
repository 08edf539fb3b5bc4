"""Check of quotation marks in a CSV file: an unclosed cell would include the next rows."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from pamjax.errors import BadInput

#: Maximum number of characters of a cell in an error message.
MAX_CELL_CHARACTERS = 30

#: Longest line of a table; Python's reader refuses longer cells.
MAX_LINE_LENGTH = 100_000


def split_lines(text: str) -> list[str]:
    """Return the lines of a text, each with its own line ending."""
    return list(io.StringIO(text, newline=""))


def check_line_lengths(lines: Sequence[str], file: str) -> None:
    """Refuse the first line that is too long for a row of a table.

    Raises:
        BadInput: with the row.
    """
    for row, line in enumerate(lines, 1):
        if len(line) > MAX_LINE_LENGTH:
            rule = f"a row must have at most {MAX_LINE_LENGTH} characters"
            remedy = "Check the line breaks of the file."
            raise BadInput.from_rule(rule, f"{len(line)}", f"row {row} of {file}", remedy)


def check_quotes(
    lines: Sequence[str], file: str, separator: str, header: str = "", *, skip_spaces: bool = False
) -> None:
    """Refuse the first line in which a quoted cell does not end.

    A quotation mark opens a quoted cell only at the beginning of the cell. A quoted cell may contain
    separators, and two quotation marks in place of each one. It must not contain a line break.

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
        open_cell = _find_open_cell(line.rstrip("\r\n"), separator, skip_spaces) if '"' in line else None
        if open_cell is None:
            continue
        index, cell = open_cell
        titles = _split_cells([header], separator, skip_spaces)[0] if row > 1 and header.strip() else []
        title = titles[index].strip() if index < len(titles) else ""
        column = f"column `{title}`" if title else f"column {index + 1}"
        shown_text = cell if len(cell) <= MAX_CELL_CHARACTERS else f"{cell[:MAX_CELL_CHARACTERS]}…"
        raise BadInput.from_rule(
            "a quoted cell must end with a quotation mark in the same row",
            f"'\"{shown_text}'",
            f"{column}, row {row} of {file}",
            "Close or remove the quotation mark; inside a quoted cell, double it.",
        )


def _find_open_cell(line: str, separator: str, skip_spaces: bool) -> tuple[int, str] | None:
    """Return the index and the text of the line's unclosed cell; None if all cells are closed."""
    # An unclosed cell includes the next line.
    rows = _split_cells([line, "next"], separator, skip_spaces)
    if len(rows) > 1:
        return None
    return len(rows[0]) - 1, rows[0][-1].removesuffix("next")


def _split_cells(lines: list[str], separator: str, skip_spaces: bool) -> list[list[str]]:
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=skip_spaces))
