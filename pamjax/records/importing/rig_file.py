"""Reading of a rig's file, CSV, XLSX or MAT: its columns as numbers."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pamjax.errors import BadInput, format_printable, suggest_word
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.importing.blank_cells import SAVE_REMEDY, BlankCells, is_blank_text
from pamjax.records.importing.clock_times import ClockTimeError, parse_clock_times
from pamjax.records.importing.column_unit import check_similar_headers
from pamjax.records.importing.date_column import describe_unused_dates, is_time_text, join_date_and_clock
from pamjax.records.importing.header_line import suggest_header_line, suggest_line_with
from pamjax.records.importing.import_spec import FilesTable
from pamjax.records.importing.mat_file import read_mat
from pamjax.records.importing.short_rows import count_cells, describe_short_rows
from pamjax.records.importing.spreadsheet import MAX_SEARCHED_LINES, WITHOUT_HEADER, Sheet, read_sheet
from pamjax.records.importing.unit_line import add_units, is_unit
from pamjax.records.quotation_marks import MAX_CELL_CHARACTERS, check_line_lengths, check_quotes, split_lines
from pamjax.records.reading.header import split_title
from pamjax.units import format_count

#: A number such as 1.130,0 or 1 130: the mark of thousands, and the decimal mark if there is one.
_THOUSANDS_PATTERN = re.compile(r"[+-]?\d{1,3}(?:([.,' ])\d{3})(?:\1\d{3})*(?:(?!\1)([.,])\d*)?")

_CELL_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")

#: A number with a decimal comma.
_COMMA_PATTERN = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")

_UNITS_REMEDY = "If this line contains the units, write units = true in [files]."
_ENCODING_REMEDY = 'If Excel wrote it, write encoding = "cp1252" in [files]. Otherwise save it as UTF-8.'

_SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": r"\s+"}
_TEXT_MARKS = _SEPARATORS | {"space": " "}


class RigFile:
    """The columns of one file.

    Args:
        path: a .mat or .xlsx file, or a text file with any other suffix.
        file_format: format of the file.
    """

    def __init__(self, path: Path, file_format: FilesTable) -> None:
        self.name = path.name
        #: Number of lines above the first row of numbers; the rows of a MAT file count from 1.
        self.lines_above = 0
        #: Notes for the user about the clock times.
        self._clock_notes: tuple[str, ...] = ()
        #: Number of cells of each line of a text file, 0 for a blank line.
        self._cell_counts: list[int] = []
        self._format = file_format
        #: First lines of a text file or of a sheet, and their separator.
        self._first_lines: list[str] = []
        self._mark = "\t"
        self._sheet: Sheet | None = None
        #: Numbers and blank cells of each column that was read, by header and name in messages.
        self._parsed_columns: dict[tuple[str, str], tuple[np.ndarray, list[BlankCells]]] = {}
        raw = read_bytes(path)
        if path.suffix.lower() == ".mat":
            self._columns = read_mat(path, file_format.matrix)
        elif path.suffix.lower() == ".xlsx":
            self._sheet = read_sheet(path, file_format)
            self.lines_above, self._first_lines = self._sheet.lines_above, self._sheet.first_lines
            self._columns = self._sheet.columns
        else:
            text = decode_text(raw, self.name, file_format.encoding, _ENCODING_REMEDY)
            self._columns = self._read_text(split_lines(text), file_format)

    def __getitem__(self, column: int | str) -> np.ndarray:
        """Return the numbers of a column, (n,), NaN where a cell is blank.

        Raises:
            BadInput: if there is no such column, or if it contains other text.
        """
        return self._parse_column(column)[0]

    def find_blanks(self, column: int | str) -> list[BlankCells]:
        """Return the texts and the formulas of a column that are read as blank.

        Raises:
            BadInput: as for the numbers of the column.
        """
        return self._parse_column(column)[1]

    def read_clock_times(self, column: int | str) -> np.ndarray | None:
        """Return the seconds, (n,), of a column with clock times or dates; None for a column of numbers.

        Raises:
            BadInput: if there is no such column, or if a row has no clock time of the first one's form.
        """
        header = self.find_header(column)
        texts = self._read_time_texts()
        if header not in texts:
            return None
        joined = join_date_and_clock(header, texts, self.name, self.locate_row)
        if joined is not None:
            self._clock_notes = (joined.note,) if joined.differs or header == joined.date else ()
            return joined.seconds
        self._clock_notes = describe_unused_dates(header, texts)
        try:
            return parse_clock_times(texts[header])
        except ClockTimeError as error:
            raise error.build_error(_quote_column(column), self.locate_row(error.row)) from error

    def _read_time_texts(self) -> dict[str, list[str]]:
        """Return the texts of the columns that begin with a clock time or a date, by header."""
        return {
            header: [_read_text(cell) for cell in cells]
            for header, cells in self._columns.items()
            if cells.dtype.kind not in "biuf" and len(cells) and is_time_text(_read_text(cells[0]))
        }

    def get_text(self, column: int | str, row: int) -> str:
        """Return the text of a cell, for error messages."""
        return _read_text(self._columns[self.find_header(column)][row])

    @property
    def all_notes(self) -> tuple[str, ...]:
        """Return the notes for the user, about the clock times and the columns that were read."""
        headers = [name for name in self._columns if not name.startswith(WITHOUT_HEADER)]
        used_count = max((headers.index(header) + 1 for header, _ in self._parsed_columns), default=0)
        short_rows = describe_short_rows(
            self._cell_counts, self.lines_above, used_count, len(headers), self.name
        )
        return short_rows + self._clock_notes

    def find_header(self, column: int | str) -> str:
        """Return the header of a column, with its unit if the file states one.

        Raises:
            BadInput: if there is no such column.
        """
        if isinstance(column, int):
            names = list(self._columns)
            if column > len(names):
                rule, got = f"{self.name} must have a column {column}", format_count(len(names), "column")
                remedy = self._suggest_table() or "Columns count from 1. Check `separator` in [files]."
                raise BadInput.from_rule(rule, got, remedy=remedy)
            return names[column - 1]
        plain = {split_title(name)[0]: name for name in self._columns}
        header = column if column in self._columns else plain.get(column, "")
        if not header:
            check_similar_headers(column, self._columns, self.name)
            known_line = suggest_line_with(self._first_lines, self._mark, self.lines_above, column)
            remedy = known_line or self._suggest_line() or self._suggest_name(column)
            raise BadInput.from_rule(f"{self.name} must have a column `{column}`", "none", remedy=remedy)
        return header

    def locate_row(self, index: int) -> str:
        """Return the location of a row, for error messages."""
        return f"row {index + self.lines_above + 1} of {self.name}"

    def _read_text(self, lines: list[str], file_format: FilesTable) -> dict[str, Any]:
        """Return the columns of a text file, whose comments above the header are skipped."""
        comment_lines = _count_comment_lines(lines[file_format.skip :], file_format.header)
        file_format = file_format.model_copy(update={"skip": file_format.skip + comment_lines})
        self.lines_above = file_format.lines_above
        self._first_lines = lines[:MAX_SEARCHED_LINES]
        self._mark = _TEXT_MARKS[file_format.separator]
        columns = _read_csv(lines, file_format, self.name, self._suggest_line())
        counts = count_cells(lines, self._mark)
        self._cell_counts = [n if line.strip() else 0 for n, line in zip(counts, lines, strict=False)]
        return columns

    def _suggest_line(self) -> str:
        """Return the remedy if the header seems to be in a later line; else an empty string."""
        if not self._format.header:
            return ""
        current = self.lines_above - 1 - self._format.units
        return suggest_header_line(self._first_lines, self._mark, current)

    def _suggest_table(self) -> str:
        """Return the remedy if the table seems to be in later lines or in another sheet; else ""."""
        return self._suggest_line() or (self._sheet.suggest_sheet() if self._sheet else "")

    def _suggest_name(self, column: str) -> str:
        """Return the remedy for a header that is in no line: the most similar one, and other sheets."""
        names = [name for name in self._columns if not name.startswith(WITHOUT_HEADER)]
        sheets = self._sheet.suggest_sheet() if self._sheet else ""
        return f"{suggest_word(column, names) if names else ''} {sheets}".strip()

    def _parse_column(self, column: int | str) -> tuple[np.ndarray, list[BlankCells]]:
        """Return the numbers of a column, (n,), NaN where blank, and the blank cells that are not empty."""
        shown = _quote_column(column)
        key = self.find_header(column), shown
        if key not in self._parsed_columns:
            values, texts = self._parse_cells(self._columns[key[0]], shown)
            blanks = self._find_formulas(*key, values) if np.isnan(values).any() else []
            if texts:
                row, text = next(iter(texts.items()))
                blanks.append(BlankCells(shown, self.locate_row(row), len(texts), text))
            self._parsed_columns[key] = values, blanks
        return self._parsed_columns[key]

    def _find_formulas(self, header: str, shown: str, values: np.ndarray) -> list[BlankCells]:
        """Return the formulas of a column that have no stored value."""
        rows = self._sheet.find_formulas(header) if self._sheet else []
        if not rows:
            return []
        if np.isnan(values).all():
            rule = f"column {shown} of {self.name} must have a number"
            raise BadInput.from_rule(rule, "only formulas without a stored value", remedy=SAVE_REMEDY)
        return [BlankCells(shown, self.locate_row(rows[0]), len(rows))]

    def _parse_cells(self, cells: Any, column: str) -> tuple[np.ndarray, dict[int, str]]:
        """Return the numbers of the cells, (n,), and the texts by row that state a missing value."""
        if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
            return cells.astype(float), {}
        # One cell that is no number makes a column of texts, so the marks are replaced here.
        # A spreadsheet has numbers in its other cells, which have no marks.
        raw_texts = [_read_text(cell) for cell in cells]
        blank_texts = {i: text for i, text in enumerate(raw_texts) if text and is_blank_text(text)}
        texts = [
            text if isinstance(cell, int | float) else self._replace_marks(text)
            for cell, text in zip(cells, raw_texts, strict=True)
        ]
        for i in blank_texts:
            texts[i] = ""
        invalid = [i for i, cell in enumerate(texts) if cell and not _CELL_PATTERN.fullmatch(cell)]
        if invalid:
            cell = raw_texts[invalid[0]]
            rule = f"column {column} must contain only numbers or blanks"
            got = repr(format_printable(cell, MAX_CELL_CHARACTERS))
            has_unit = invalid[0] == 0 and self._format.header and not self._format.units and is_unit(cell)
            remedy = _UNITS_REMEDY if has_unit else self._suggest_line() or _suggest_format(cell)
            raise BadInput.from_rule(rule, got, self.locate_row(invalid[0]), remedy)
        return np.array([cell or "nan" for cell in texts], dtype=float), blank_texts

    def _replace_marks(self, cell: str) -> str:
        """Return a cell without marks of thousands, and with a decimal point."""
        if self._format.thousands:
            cell = cell.replace(self._format.thousands, "")
        return cell if self._format.decimal == "." else cell.replace(".", "x").replace(",", ".")


def _read_text(cell: Any) -> str:
    return "" if pd.isna(cell) else str(cell).strip()


def _quote_column(column: int | str) -> str:
    return f"{column}" if isinstance(column, int) else f"`{column}`"


def _suggest_format(cell: str) -> str:
    """Return the remedy for a cell that is no number."""
    match = _THOUSANDS_PATTERN.fullmatch(cell)
    # No number with marks of thousands begins with zero.
    has_thousands = match and not cell.lstrip("+-").startswith("0")
    if _COMMA_PATTERN.fullmatch(cell):
        thousands = ' If it separates thousands, write thousands = "," instead.' if has_thousands else ""
        return f'If "," is the decimal mark, write decimal = "," in [files].{thousands}'
    if match and has_thousands:
        decimal = f' and decimal = "{match[2]}"' if match[2] else ""
        return f'If "{match[1]}" separates thousands, write thousands = "{match[1]}"{decimal} in [files].'
    return "Check `skip`, `header` and `decimal` in [files]."


def _count_comment_lines(lines: list[str], has_header: bool) -> int:
    """Return the number of lines above the table that begin with #, as in recording.csv.

    If numbers follow them, the last of these lines is the header.
    """
    count = next((k for k, line in enumerate(lines) if not line.lstrip().startswith("#")), len(lines))
    is_header = has_header and count < len(lines) and _CELL_PATTERN.match(lines[count].lstrip())
    return max(count - 1, 0) if is_header else count


def _read_csv(lines: list[str], file_format: FilesTable, file: str, header_remedy: str) -> dict[str, Any]:
    if not lines:
        raise BadInput.from_rule(f"{file} must have rows", "an empty file", remedy="Check the path.")
    if file_format.skip >= len(lines):
        rule = f"`skip` must be less than the number of lines of {file} ({len(lines)})"
        raise BadInput.from_rule(rule, f"{file_format.skip}", "[files]", "Count the lines above the header.")
    remedy = _suggest_separator(lines[file_format.skip :], file_format)
    # The lines above the table may contain any characters.
    lines = ["\n" if k < file_format.skip else line for k, line in enumerate(lines)]
    mark = _TEXT_MARKS[file_format.separator]
    header = "".join(lines[file_format.skip : file_format.skip + file_format.header])
    check_line_lengths(lines, file)
    check_quotes(lines, file, mark, header, skip_spaces=True)
    try:
        with warnings.catch_warnings():
            # More cells than in the header, unless the additional cells are blank.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                io.StringIO("".join(lines)),
                index_col=False,
                sep=_SEPARATORS[file_format.separator],
                decimal=file_format.decimal,
                thousands=file_format.thousands or None,
                header=0 if file_format.header else None,
                skiprows=file_format.skipped_lines,
                skip_blank_lines=False,
                skipinitialspace=True,
                # A text such as "n/a" is read as blank with a note, so pandas must not blank it.
                keep_default_na=False,
                na_values=[""],
                low_memory=False,
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        raise BadInput.from_rule(
            f"{file} must be a table",
            _format_ragged(str(error)),
            remedy=remedy or header_remedy or "Check `skip` and `separator` in [files].",
        ) from error
    if table.shape[1] == 1 and remedy:
        raise BadInput.from_rule(
            f"the cells of {file} must be separated by {file_format.separator!r}", "", "", remedy
        )
    while len(table) and table.iloc[-1].isna().all():
        table = table.iloc[:-1]
    if not len(table):
        raise BadInput.from_rule(
            f"{file} must contain rows of numbers", "none", remedy="Check `skip` and `header` in [files]."
        )
    names = [str(name).strip() for name in table.columns]
    if file_format.units:
        unit_line = "".join(lines[file_format.skip + 1 : file_format.skip + 2]).strip()
        names = add_units(names, re.split(re.escape(mark) if mark != " " else r"\s+", unit_line))
    return {name: table.iloc[:, k].to_numpy() for k, name in enumerate(names)}


def _format_ragged(message: str) -> str:
    if "does not match length of data" in message:
        return "rows with more cells than the header"
    match = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", message)
    return f"{match[3]} cells instead of {match[1]} in row {match[2]}" if match else message.strip().lower()


def _suggest_separator(lines: list[str], file_format: FilesTable) -> str:
    """Return the remedy if the first line has another separator; else an empty string."""
    line = next((line for line in lines if line.strip()), "")
    marks = {";": ";", "\t": "tab", ",": "," if file_format.decimal == "." else ""}
    other = next((name for mark, name in marks.items() if mark in line and name != file_format.separator), "")
    if not other:
        return ""
    has_decimal_commas = other != "," and any(re.search(r"\d,\d", row) for row in lines[1:3])
    decimal = ' and decimal = ","' if has_decimal_commas and file_format.decimal == "." else ""
    return f'Write separator = "{other}"{decimal} in [files].'
