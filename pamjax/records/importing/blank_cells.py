"""Cells that are read as blank although they are not empty: text for a missing value, and formulas."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from pamjax.errors import BadInput, compose_message, format_printable
from pamjax.records.quotation_marks import MAX_CELL_CHARACTERS
from pamjax.units import format_count

#: Text for a missing value, and errors of spreadsheets in any language, such as #DIV/0! and #NV.
_BLANK_PATTERN = re.compile(
    r"n/?a|n\.a\.|<na>|[+-]?nan|null|none|[-–—]+|\?+|[+-]?1\.#(?:ind|qnan)|#n/a n/a|#[^\W\d][\w/]*[!?]?",
    re.IGNORECASE,
)

#: Remedy for formulas without a stored value.
SAVE_REMEDY = "Open the file in a spreadsheet program and save it, so that values are stored."


def is_blank_text(cell: str) -> bool:
    """Return whether a text states that a value is missing.

    >>> [is_blank_text(cell) for cell in ("n/a", "-", "#DIV/0!", "about 20", "#5", "-3")]
    [True, True, True, False, False, False]
    """
    return _BLANK_PATTERN.fullmatch(cell) is not None


@dataclass(frozen=True)
class BlankCells:
    """Cells of one column of a file that are read as blank although they are not empty.

    Attributes:
        column: header or number of the column, as in messages.
        where: location of the first of these cells.
        count: number of these cells.
        text: text of the first of these cells; empty for formulas without a stored value.
    """

    column: str
    where: str
    count: int
    text: str = ""

    def build_error(self, name: str) -> BadInput:
        """Return the error for a channel that must not have blanks."""
        rule = f"`{name}` must have a number in every row"
        remedy = "Write the number, or delete the row." if self.text else SAVE_REMEDY
        return BadInput.from_rule(rule, self._describe(), self.where, remedy)

    def _describe(self) -> str:
        if not self.text:
            return "a formula without a stored value"
        return repr(format_printable(self.text, MAX_CELL_CHARACTERS))


def format_notes(blanks: Iterable[BlankCells]) -> tuple[str, ...]:
    """Return one note for the texts and one for the formulas of each column, over all files."""
    groups: dict[tuple[str, bool], list[BlankCells]] = {}
    for cells in blanks:
        groups.setdefault((cells.column, bool(cells.text)), []).append(cells)
    return tuple(_format_note(cells) for cells in groups.values())


def _format_note(cells: list[BlankCells]) -> str:
    first = cells[0]
    kind = "text instead of a number" if first.text else "formulas without a stored value"
    count = format_count(sum(c.count for c in cells), "cell")
    files = f" in {len(cells)} files" if len(cells) > 1 else ""
    example = f"{first._describe()} in {first.where}" if first.text else first.where
    rule = f"column {first.column}: {kind} in {count}{files}, read as not measured (first: {example})"
    return compose_message(rule, remedy="" if first.text else SAVE_REMEDY)
