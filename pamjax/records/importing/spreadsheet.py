"""Reading of one sheet of a spreadsheet (.xlsx)."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.errors import BadInput, suggest_word
from pamjax.records.importing.import_spec import FilesTable
from pamjax.records.importing.unit_line import add_units

#: Largest size of an unpacked file, bytes. A small archive can unpack to any size.
_MAX_UNPACKED_BYTES = 300_000_000

#: Number of lines in which a header is searched.
MAX_SEARCHED_LINES = 100

#: First part of the name of a column without header; pandas gives the same name in a text file.
WITHOUT_HEADER = "Unnamed:"


@dataclass(frozen=True)
class Sheet:
    """The cells of a sheet.

    Attributes:
        path: path of the file.
        name: name of the sheet.
        lines_above: number of lines above the first row of numbers.
        columns: cells of each column, (n,): numbers, NaN if blank, or objects if a cell is no number.
        places: index of each column in the sheet.
        first_lines: first rows of the sheet, with tabs between cells.
        other_names: names of the other sheets of the file.
    """

    path: Path
    name: str
    lines_above: int
    columns: dict[str, np.ndarray]
    places: dict[str, int]
    first_lines: list[str]
    other_names: list[str]

    def suggest_sheet(self) -> str:
        """Return the remedy if the file has other sheets; else an empty string."""
        return _suggest_sheet(self.name, self.other_names)

    def find_formulas(self, header: str) -> list[int]:
        """Return the indices of the rows in which a formula of a column has no stored value."""
        return self._formulas.get(self.places[header], [])

    @cached_property
    def _formulas(self) -> dict[int, list[int]]:
        """Rows by column; the file is read again, as formulas and as stored values."""
        rows: dict[int, list[int]] = {}
        with closing(_open_book(self.path, False)) as formulas, closing(_open_book(self.path)) as values:
            try:
                for place, line in _find_formulas(formulas[self.name], values[self.name]):
                    rows.setdefault(place, []).append(line - self.lines_above)
            except Exception as error:  # as in `_read_rows`
                raise _refuse(self.path, f"a damaged formula in sheet `{self.name}`") from error
        return {place: [row for row in lines if row >= 0] for place, lines in rows.items()}


def _find_formulas(formulas: Any, values: Any) -> Iterator[tuple[int, int]]:
    """Yield column and row of each formula without a stored value, from both views of a sheet."""
    for line, rows in enumerate(zip(_iterate_rows(formulas), _iterate_rows(values), strict=True)):
        for place, (formula, value) in enumerate(zip(*rows, strict=True)):
            # The stored value of a formula may be an empty text, of type "str".
            if formula.data_type == "f" and value.value is None and value.data_type != "str":
                yield place, line


def read_sheet(path: Path, file_format: FilesTable) -> Sheet:
    """Return the cells of a sheet by column; a formula has the value that was saved with it.

    Args:
        path: a file in the format of Excel 2007 or later.
        file_format: `sheet`, `skip`, `header` and `units` of the file.

    Raises:
        BadInput: if the file cannot be read, has no such sheet, or if the sheet has no rows.
    """
    _check_archive(path)
    with closing(_open_book(path)) as book:
        names = [sheet.title for sheet in book.worksheets]
        if not names:
            raise _refuse(path, "a file without sheets")
        name = file_format.sheet or names[0]
        if name not in names:
            raise BadInput.from_rule(
                f"{path.name} must have a sheet `{name}`", "none", "[files]", suggest_word(name, names)
            )
        rows = _read_rows(book[name], path)
    others = [other for other in names if other != name]
    if len(rows) <= file_format.lines_above:
        rule = f"sheet `{name}` of {path.name} must contain rows of numbers"
        remedy = _suggest_sheet(name, others) or "Check `sheet`, `skip` and `header` in [files]."
        raise BadInput.from_rule(rule, "none", remedy=remedy)
    return _build_sheet(path, name, rows, file_format, others)


def _suggest_sheet(name: str, others: list[str]) -> str:
    if not others:
        return ""
    listing = ", ".join(f"`{title}`" for title in (name, *others))
    return f'The file has the sheets {listing}; write, for example, sheet = "{others[0]}" in [files].'


def _build_sheet(
    path: Path, name: str, rows: list[list[Any]], file_format: FilesTable, others: list[str]
) -> Sheet:
    above = file_format.lines_above
    width = max(map(len, rows[file_format.skip :]))
    table = [row + [None] * (width - len(row)) for row in rows[file_format.skip :]]
    headers = _name_columns(table[0]) if file_format.header else [str(k) for k in range(width)]
    if file_format.units:
        headers = add_units(headers, ["" if cell is None else cell for cell in table[1]])
    columns, places = {}, {}
    for place, header in enumerate(headers):
        cells = [row[place] for row in table[above - file_format.skip :]]
        if not header.startswith(WITHOUT_HEADER) or any(cell is not None for cell in cells):
            columns[header], places[header] = _build_column(cells), place
    first_lines = ["\t".join(map(_format_cell, row)) for row in rows[:MAX_SEARCHED_LINES]]
    return Sheet(path, name, above, columns, places, first_lines, others)


def _format_cell(cell: Any) -> str:
    return "" if cell is None else " ".join(str(cell).split())


def _name_columns(cells: list[Any]) -> list[str]:
    """Return a name for each column; as in pandas, the second `Load` is `Load.1`."""
    names: list[str] = []
    for place, cell in enumerate(cells):
        header = f"{WITHOUT_HEADER} {place}" if cell is None else str(cell).strip()
        name, number = header, 0
        while name in names:
            number += 1
            name = f"{header}.{number}"
        names.append(name)
    return names


def _build_column(cells: list[Any]) -> np.ndarray:
    if all(cell is None or isinstance(cell, int | float) for cell in cells):
        # An integer may have more digits than a float can hold.
        with suppress(OverflowError):
            return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)
    column = np.empty(len(cells), dtype=object)
    column[:] = cells
    return column


def _open_book(path: Path, stored_values: bool = True) -> Any:
    """Return the workbook; its formulas are their stored values, or their texts."""
    # The library takes a tenth of a second to load, and tables of text do not need it.
    import openpyxl

    try:
        with warnings.catch_warnings():
            # Styles and extensions that the reader does not know do not matter for the numbers.
            warnings.simplefilter("ignore")
            return openpyxl.load_workbook(path, read_only=True, data_only=stored_values, keep_links=False)
    except Exception as error:  # the reader raises errors of many kinds for a damaged file
        raise _refuse(path, "a damaged file") from error


def _read_rows(sheet: Any, path: Path) -> list[list[Any]]:
    """Return the cells of each row, None if blank, without blank cells and rows at the end."""
    try:
        rows = [_read_cells(cells) for cells in _iterate_rows(sheet)]
    except Exception as error:  # as above
        raise _refuse(path, f"a damaged sheet `{sheet.title}`") from error
    while rows and not rows[-1]:
        rows.pop()
    return rows


def _iterate_rows(sheet: Any) -> Iterator[tuple[Any, ...]]:
    # The size that a file states may be wrong.
    sheet.reset_dimensions()
    with warnings.catch_warnings():
        # A number outside the limits of dates becomes an error cell.
        warnings.simplefilter("ignore")
        yield from sheet.rows


def _read_cells(cells: Iterable[Any]) -> list[Any]:
    values = [_convert_cell(cell.value) for cell in cells]
    while values and values[-1] is None:
        values.pop()
    return values


def _convert_cell(value: Any) -> Any:
    """Return a value with blank texts as None, and durations as texts such as 25:00:00.5."""
    if isinstance(value, timedelta):
        minutes, seconds = divmod(value.total_seconds(), 60)
        return f"{int(minutes) // 60}:{int(minutes) % 60:02d}:{seconds:09.6f}"
    return None if isinstance(value, str) and not value.strip() else value


def _check_archive(path: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except zipfile.BadZipFile as error:
        raise _refuse(path, "a damaged or protected file") from error
    if size > _MAX_UNPACKED_BYTES:
        raise _refuse(path, f"a file that unpacks to {size / 1e6:.0f} MB")


def _refuse(path: Path, got: str) -> BadInput:
    rule = f"{path.name} must be a spreadsheet (.xlsx)"
    return BadInput.from_rule(rule, got, remedy="Save it again, or export the sheet as CSV.")
