"""Reading of a rig's file, CSV or MAT: its columns as numbers."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pamjax.errors import refuse, suggest_word
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.importing.import_spec import FilesTable
from pamjax.records.quotes import check_line_lengths, check_quotes, split_lines
from pamjax.records.reading.header import split_title

_CELL_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan", re.IGNORECASE)

SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": r"\s+"}


class RigFile:
    """The columns of one file.

    Args:
        path: a .mat file, or a text file with any other suffix.
        file_format: format of the file.
    """

    def __init__(self, path: Path, file_format: FilesTable) -> None:
        self.name = path.name
        #: Number of lines above the first row of numbers; the rows of a MAT file count from 1.
        self.lines_above = 0
        raw = read_bytes(path)
        if path.suffix.lower() == ".mat":
            self._columns = _read_mat(raw, file_format.matrix, self.name)
        else:
            self.lines_above = file_format.skip + file_format.header
            self._columns = _read_csv(decode_text(raw, self.name), file_format, self.name)

    def __getitem__(self, column: int | str) -> np.ndarray:
        """Return the numbers of a column, (n,), NaN where a cell is blank.

        Raises:
            BadInput: if there is no such column, or if it contains other text.
        """
        if isinstance(column, int):
            names = list(self._columns)
            if column > len(names):
                rule = f"{self.name} must have a column {column}"
                got = f"{len(names)} columns"
                raise refuse(rule, got, remedy="Columns count from 1. Check `separator` in [files].")
            return self._parse_cells(self._columns[names[column - 1]], f"{column}")
        plain = {split_title(name)[0]: name for name in self._columns}
        header = column if column in self._columns else plain.get(column, "")
        if not header:
            raise refuse(
                f"{self.name} must have a column `{column}`",
                "none",
                remedy=suggest_word(column, self._columns),
            )
        return self._parse_cells(self._columns[header], f"`{column}`")

    def locate_row(self, index: int) -> str:
        """Return the location of a row, for error messages."""
        return f"row {index + self.lines_above + 1} of {self.name}"

    def _parse_cells(self, cells: Any, column: str) -> np.ndarray:
        if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
            return cells.astype(float)
        text = np.array(["" if pd.isna(cell) else str(cell).strip() for cell in cells])
        invalid = [i for i, cell in enumerate(text) if cell and not _CELL_PATTERN.fullmatch(cell)]
        if invalid:
            remedy = "Check `skip`, `header` and `decimal` in [files]."
            rule = f"column {column} must contain only numbers or blanks"
            raise refuse(rule, f"'{text[invalid[0]]}'", self.locate_row(invalid[0]), remedy)
        return np.where(text == "", "nan", text).astype(float)


def _read_csv(text: str, file_format: FilesTable, file: str) -> dict[str, Any]:
    # The lines above the table may contain any characters.
    lines = ["\n" if k < file_format.skip else line for k, line in enumerate(split_lines(text))]
    mark = " " if file_format.separator == "space" else SEPARATORS[file_format.separator]
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
                sep=SEPARATORS[file_format.separator],
                decimal=file_format.decimal,
                header=0 if file_format.header else None,
                skiprows=file_format.skip,
                skip_blank_lines=False,
                skipinitialspace=True,
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        raise refuse(
            f"{file} must be a table",
            _format_ragged(str(error)),
            remedy="Check `skip` and `separator` in [files].",
        ) from error
    if table.shape[1] == 1 and (other := _guess_separator(text, file_format)):
        remedy = f'Write separator = "{other}" in [files].'
        raise refuse(f"the cells of {file} must be separated by {file_format.separator!r}", "", "", remedy)
    while len(table) and table.iloc[-1].isna().all():
        table = table.iloc[:-1]
    if not len(table):
        raise refuse(
            f"{file} must contain rows of numbers", "none", remedy="Check `skip` and `header` in [files]."
        )
    return {str(name).strip(): table[name].to_numpy() for name in table.columns}


def _format_ragged(message: str) -> str:
    if "does not match length of data" in message:
        return "rows with more cells than the header"
    match = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", message)
    return f"{match[3]} cells instead of {match[1]} in row {match[2]}" if match else message.strip().lower()


def _guess_separator(text: str, file_format: FilesTable) -> str:
    line = next((line for line in text.splitlines()[file_format.skip :] if line.strip()), "")
    marks = {";": ";", "\t": "tab", ",": "," if file_format.decimal == "." else ""}
    return next((name for mark, name in marks.items() if mark in line and name != file_format.separator), "")


def _read_mat(raw: bytes, matrix: str, file: str) -> dict[str, Any]:
    """Return the arrays of a MAT file by name ("structure.field"), or the columns of a matrix by number."""
    try:
        arrays = dict(_iterate_arrays(_load_variables(raw)))
    except (ValueError, OSError, TypeError) as error:
        raise refuse(
            f"{file} must be a MAT file", str(error).rstrip("."), remedy="Save it again in MATLAB."
        ) from error
    if not matrix:
        return {name: values.ravel() for name, values in arrays.items() if values.size == max(values.shape)}
    if matrix not in arrays:
        raise refuse(f"{file} must have a variable `{matrix}`", "none", remedy=suggest_word(matrix, arrays))
    table = np.atleast_2d(arrays[matrix])
    if table.shape[0] < table.shape[1]:  # one row per sample, also for a transposed matrix
        table = table.T
    return {str(k): column for k, column in enumerate(table.T, 1)}


def _load_variables(raw: bytes) -> Mapping[str, Any]:
    from scipy.io import loadmat

    if raw[:4] == b"\x89HDF" or b"MATLAB 7.3" in raw[:128]:
        import h5py

        return _unfold_group(h5py.File(io.BytesIO(raw), "r"))
    return loadmat(io.BytesIO(raw), simplify_cells=True)


def _unfold_group(group: Any) -> dict[str, Any]:
    return {
        name: _unfold_group(part) if hasattr(part, "keys") else np.asarray(part)
        for name, part in group.items()
        if not name.startswith("#")
    }


def _iterate_arrays(variables: Mapping[str, Any], prefix: str = ""):
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _iterate_arrays(value, f"{prefix}{name}.")
        elif np.ndim(value) and np.asarray(value).dtype.kind in "biuf":
            yield f"{prefix}{name}", np.asarray(value)
