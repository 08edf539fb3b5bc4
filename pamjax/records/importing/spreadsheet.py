"""Reading of one sheet of a spreadsheet (.xlsx)."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path
from typing import Any

import pandas as pd

from pamjax.errors import BadInput, suggest_word
from pamjax.records.importing.import_spec import FilesTable
from pamjax.records.importing.unit_line import add_units

#: Largest size of an unpacked file, bytes. A small archive can unpack to any size.
_MAX_UNPACKED_BYTES = 300_000_000

#: Name that pandas gives to a column without header.
_WITHOUT_HEADER = "Unnamed:"


def read_sheet(path: Path, file_format: FilesTable) -> dict[str, Any]:
    """Return the cells of a sheet by column, each (n,); a formula has the value that was saved with it.

    Args:
        path: a file in the format of Excel 2007 or later.
        file_format: `sheet`, `skip`, `header` and `units` of the file.

    Raises:
        BadInput: if the file cannot be read, has no such sheet, or if the sheet has no rows.
    """
    _check_archive(path)
    book = _open_book(path)
    with book:
        names = [str(name) for name in book.sheet_names]
        sheet = file_format.sheet or names[0]
        if sheet not in names:
            raise BadInput.from_rule(
                f"{path.name} must have a sheet `{sheet}`", "none", "[files]", suggest_word(sheet, names)
            )
        table = _parse_sheet(book, sheet, path, file_format)
    is_empty = [
        str(name).startswith(_WITHOUT_HEADER) and bool(table[name].isna().all()) for name in table.columns
    ]
    table = table.loc[:, [not empty for empty in is_empty]]
    while len(table) and table.iloc[-1].isna().all():
        table = table.iloc[:-1]
    if not len(table):
        rule = f"sheet `{sheet}` of {path.name} must contain rows of numbers"
        raise BadInput.from_rule(rule, "none", remedy="Check `sheet`, `skip` and `header` in [files].")
    return {str(name).strip(): table[name].to_numpy() for name in table.columns}


def _check_archive(path: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except zipfile.BadZipFile as error:
        raise _refuse(path, "a damaged or protected file") from error
    if size > _MAX_UNPACKED_BYTES:
        raise _refuse(path, f"a file that unpacks to {size / 1e6:.0f} MB")


def _open_book(path: Path) -> pd.ExcelFile:
    try:
        with warnings.catch_warnings():
            # Styles and extensions that the reader does not know do not matter for the numbers.
            warnings.simplefilter("ignore")
            return pd.ExcelFile(path, engine="openpyxl")
    except Exception as error:  # the reader raises errors of many kinds for a damaged file
        raise _refuse(path, "a damaged file") from error


def _parse_sheet(book: pd.ExcelFile, sheet: str, path: Path, file_format: FilesTable) -> pd.DataFrame:
    try:
        header = 0 if file_format.header else None
        table = pd.read_excel(book, sheet_name=sheet, header=header, skiprows=file_format.skipped_lines)
        if file_format.units:
            below = file_format.skip + 1
            cells = pd.read_excel(book, sheet_name=sheet, header=None, skiprows=below, nrows=1)
            table.columns = add_units([str(name) for name in table.columns], cells.iloc[0])
        return table
    except Exception as error:  # as above
        raise _refuse(path, f"a damaged sheet `{sheet}`") from error


def _refuse(path: Path, got: str) -> BadInput:
    rule = f"{path.name} must be a spreadsheet (.xlsx)"
    return BadInput.from_rule(rule, got, remedy="Save it again, or export the sheet as CSV.")
