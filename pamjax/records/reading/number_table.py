"""Fast reading of a CSV file that has only numbers and blank cells below its header.

The file is read in parts of whole lines, so that the memory is that of the numbers. A part is plain if it
has only the characters of numbers, and if each line has as many cells as the header. NumPy then reads its
numbers. All other files, also those with comments between rows or with wrong cells, are read by
`text_table.py`.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pamjax.records.quotation_marks import MAX_LINE_LENGTH

#: Characters of a plain line. They exclude `nan`, `inf` and underscores, which NumPy reads as numbers.
_PLAIN_CHARACTERS = b"0123456789.+-eE, \r\n"
_COMMA, _LINE_END = b",\n"
#: The place of a blank cell between two separators.
_BLANK_CELL = re.compile(rb"(?<=[,\n])(?=[,\n])")

#: Number of bytes that are read together.
_PART_BYTES = 1 << 20

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class NumberTable:
    """A table of numbers.

    Attributes:
        header: the cells of the header.
        rows: (n,) line of each row in the file.
        numbers: the cells of each column, (n,), NaN where blank.
        body: bytes of the rows.
    """

    header: list[str]
    rows: np.ndarray
    numbers: list[np.ndarray]
    body: memoryview

    def read_numbers(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of a column, (n,), NaN where blank, and whether a cell is blank, (n,)."""
        return self.numbers[index], np.isnan(self.numbers[index])

    def read_text(self, i: int, index: int) -> str:
        """Return the text of the cell in the i-th row and a column."""
        return bytes(self.body).splitlines()[i].split(b",")[index].decode().strip()


def read_number_table(raw: bytes) -> NumberTable | None:
    """Return the table of a CSV file's bytes, or None if the file has other contents than numbers.

    Args:
        raw: bytes of the file.
    """
    plain_header = _find_header(raw)
    if plain_header is None:
        return None
    header, row, start = plain_header
    end = len(raw)
    while end > start and raw[end - 1] in b"\r\n":
        end -= 1
    # One array for each column, so that a column without a use is freed.
    row_count, n = raw.count(b"\n", start, end) + 1, 0
    numbers = [np.empty(row_count) for _ in header]
    for part in _split_parts(raw, start, end):
        part_numbers = _parse_part(part, len(header))
        # A row without any cell is no row of the table.
        if part_numbers is None or np.isnan(part_numbers).all(axis=1).any():
            return None
        for column, column_numbers in zip(numbers, part_numbers.T, strict=True):
            column[n : n + len(part_numbers)] = column_numbers
        n += len(part_numbers)
    if not n:
        return None
    return NumberTable(header, np.arange(row + 1, row + 1 + n), numbers, memoryview(raw)[start:end])


def _find_header(raw: bytes) -> tuple[list[str], int, int] | None:
    """Return the cells of the header, its line, and the place of the next line; None if it is not plain."""
    start = len(_BYTE_ORDER_MARK) if raw.startswith(_BYTE_ORDER_MARK) else 0
    row = 0
    while (end := raw.find(b"\n", start)) >= 0:
        row += 1
        try:
            line = raw[start:end].decode().removesuffix("\r")
        except UnicodeDecodeError:
            return None
        start = end + 1
        if any(mark in line for mark in "\0\r") or raw.startswith(b"PK"):
            return None
        if line.strip(" ,\t") and not line.lstrip().startswith("#"):
            cells = line.split(",")
            is_plain = cells[-1].strip() and not any(mark in line for mark in ';\t"')
            return (cells, row, start) if is_plain and len(line) <= MAX_LINE_LENGTH else None
    return None


def _split_parts(raw: bytes, start: int, end: int) -> Iterator[bytes]:
    """Yield parts of whole lines; each ends with a line end, and with no carriage return before it."""
    while start < end:
        stop = end
        if end - start > _PART_BYTES:
            # Without a line end in its first bytes, the whole rest is one part.
            stop = raw.rfind(b"\n", start, start + _PART_BYTES) + 1 or end
        part = raw[start:stop].replace(b"\r\n", b"\n")
        yield part if part.endswith(b"\n") else part + b"\n"
        start = stop


def _parse_part(part: bytes, width: int) -> np.ndarray | None:
    """Return the numbers of some lines, (n, width), NaN where blank; None if the part is not plain."""
    if part.translate(None, _PLAIN_CHARACTERS) or b"\r" in part:
        return None
    characters = np.frombuffer(part, np.uint8)
    ends = np.flatnonzero((characters == _COMMA) | (characters == _LINE_END))
    if ends.size % width:
        return None
    is_line_end = (characters[ends] == _LINE_END).reshape(-1, width)
    if not is_line_end[:, -1].all() or is_line_end[:, :-1].any():
        return None
    if np.diff(ends[width - 1 :: width], prepend=-1).max() > MAX_LINE_LENGTH:
        return None
    if np.diff(ends, prepend=-1).min() == 1:
        part = _BLANK_CELL.sub(b"nan", b"\n" + part)[1:]
    try:
        numbers = np.loadtxt(io.StringIO(part.decode()), delimiter=",", comments=None, ndmin=2)
    # A part such as `1e`, or spaces without a number.
    except ValueError:
        return None
    return numbers if numbers.shape == is_line_end.shape else None
