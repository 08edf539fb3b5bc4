"""Rows of a text file that end before the last used column, for example in a file that was cut."""

from __future__ import annotations

import csv
from collections.abc import Sequence

from pamjax.errors import compose_message
from pamjax.units import format_count


def count_cells(lines: Sequence[str], mark: str) -> list[int]:
    """Return the number of cells of each line; empty if a quoted cell has several lines.

    Args:
        lines: the lines of the file.
        mark: separator of the cells; " " is any white space.

    >>> count_cells(['1;"a;b";2', "3;4"], ";")
    [3, 2]
    """
    if mark == " ":
        return [len(line.split()) for line in lines]
    if any('"' in line for line in lines):
        counts = [len(cells) for cells in csv.reader(lines, delimiter=mark, skipinitialspace=True)]
        return counts if len(counts) == len(lines) else []
    return [line.count(mark) + 1 for line in lines]


def describe_short_rows(
    counts: Sequence[int], lines_above: int, used_count: int, column_count: int, file: str
) -> tuple[str, ...]:
    """Return a note on the rows that end before the last used column; none for complete rows.

    Args:
        counts: number of cells of each line; 0 for a blank line.
        lines_above: number of lines above the first row.
        used_count: number of columns up to the last used one.
        column_count: number of columns.
        file: name of the file.
    """
    short_rows = [k for k, count in enumerate(counts) if k >= lines_above and 0 < count < used_count]
    if not short_rows:
        return ()
    first, more = short_rows[0], len(short_rows) - 1
    others = (
        f", and {format_count(more, 'more row')} {'lacks' if more == 1 else 'lack'} cells" if more else ""
    )
    got = f"row {first + 1} of {file} has {counts[first]} of {column_count} cells{others}"
    remedy = "If the file is incomplete, copy it again."
    return (compose_message(f"{got}: the missing cells are read as not measured", remedy=remedy),)
