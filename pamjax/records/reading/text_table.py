"""Reading of a CSV file cell by cell: comments, quoted and blank cells, and messages for wrong rows."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass

import numpy as np

from pamjax.errors import BadInput
from pamjax.records.files import decode_text
from pamjax.records.quotation_marks import check_line_lengths, check_quotes, split_lines

NUMBER_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
#: Numbers or blanks, each in one line. Without atomic groups, a wrong cell takes exponential time.
_COLUMN_PATTERN = re.compile(rf"(?>(?>{NUMBER_PATTERN.pattern})?\n)*+", re.ASCII)


@dataclass(frozen=True)
class TextTable:
    """A table of texts.

    Attributes:
        header: the cells of the header.
        rows: (n,) line of each row in the file.
        cells: the cells of each row.
    """

    header: list[str]
    rows: np.ndarray
    cells: list[list[str]]

    def read_numbers(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of a column, (n,), NaN where not known, and whether a cell is blank, (n,).

        If a cell is no number, no number of the column is known.
        """
        texts = [row[index].strip() for row in self.cells]
        lines = "\n".join([*texts, ""])
        # A quoted cell may have several lines.
        if lines.count("\n") == len(texts) and _COLUMN_PATTERN.fullmatch(lines):
            numbers = np.array([text or "nan" for text in texts], dtype=float)
            return numbers, np.isnan(numbers)
        return np.full(len(texts), np.nan), np.array([not text for text in texts])

    def read_text(self, i: int, index: int) -> str:
        """Return the text of the cell in the i-th row and a column."""
        return self.cells[i][index].strip()


def read_text_table(raw: bytes, file: str) -> TextTable:
    """Return the table of a CSV file's bytes, without comments and blank lines.

    Args:
        raw: bytes of the file.
        file: name of the file, for error messages.

    Raises:
        BadInput: if the file has no rows, or if a row or a quoted cell is wrong.
    """
    header, lines, cells = _split_cells(decode_text(raw, file), file)
    return TextTable(header, np.array(lines), cells)


def _split_cells(text: str, file: str) -> tuple[list[str], list[int], list[list[str]]]:
    """Return the header, line number of each row, and each row's cells, without comments and blank lines."""
    # A comment may contain any characters.
    content = [line if not line.lstrip().startswith("#") else "\n" for line in split_lines(text)]
    titles = next((line for line in content if line.strip(" ,\t\r\n")), "")
    check_line_lengths(content, file)
    check_quotes(content, file, ",", titles)
    rows = list(enumerate(csv.reader(content), 1))
    rows = [(line, cells) for line, cells in rows if "".join(cells).strip()]
    rows = [(line, cells) for line, cells in rows if not cells[0].lstrip().startswith("#")]
    if not rows:
        raise BadInput.from_rule(
            f"{file} must contain a recording",
            "an empty file",
            remedy="Write a header, and one row for each sample.",
        )
    header = rows[0][1]
    _check_separator(header, file)
    if len(rows) == 1:
        got, remedy = "a header without rows", "Write one row for each sample."
        raise BadInput.from_rule(f"{file} must contain a recording", got, remedy=remedy)
    while (
        len(header) > 1 and not header[-1].strip() and not any("".join(r[1][len(header) - 1 :]) for r in rows)
    ):
        header = header[:-1]
    cells = [_check_width(header, line, row, file) for line, row in rows[1:]]
    return header, [line for line, _ in rows[1:]], cells


def _check_separator(header: list[str], file: str) -> None:
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in ",".join(header) and len(header) <= ",".join(header).count(mark):
            remedy = "Save it with commas between cells and with decimal points, or use `pamjax import`."
            raise BadInput.from_rule(
                f"the cells of {file} must be separated by commas", name, "the header", remedy
            )


def _check_width(header: list[str], line: int, row: list[str], file: str) -> list[str]:
    if len(row) == len(header):
        return row
    if len(row) > len(header) and not "".join(row[len(header) :]).strip():
        return row[: len(header)]
    surplus_remedy = "Write 0.5 instead of 0,5, or import the file with `pamjax import`."
    remedy = surplus_remedy if len(row) > len(header) else "Write a comma also for a blank cell."
    got = f"{len(row)} cells"
    raise BadInput.from_rule(
        f"each row must have as many cells as the header ({len(header)})",
        got,
        f"row {line} of {file}",
        remedy,
    )
