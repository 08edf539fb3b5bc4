"""Reading of recording.csv: conversion to SI, and error messages with row and column."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pamjax.errors import BadInput, InputWarning, refuse
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.quotes import check_quotes, lines_of
from pamjax.records.reading.header import Column, find_columns
from pamjax.records.reading.outliers import remove_outliers
from pamjax.records.recording import Recording
from pamjax.units import format_quantity

_NUMBER_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_DECIMAL_COMMA_PATTERN = re.compile(r"[+-]?\d+,\d+")
_BLANK_MARKS = {"nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?"}

#: A gauge's zero is rarely off by more: the seven hose recordings' gauge reads 8 to 10 kPa at atmosphere,
#: laboratory gauges state 0.25 to 1 % of full scale.
MAX_ZERO_ERROR = 5e3
MAX_ZERO_ERROR_SHARE = 0.01


def read_table(
    path: str | Path, columns: Mapping[str, str] | None = None, default_length: float | None = None
) -> Recording:
    """Read a recording from a CSV file whose headers are `name [unit]`.

    Args:
        path: the CSV file; lines that begin with `#` are comments.
        columns: header of the file for each channel, as {"force": "Load (lbf)"}.
        default_length: m, the length of every row if the file has no such column.

    Raises:
        BadInput: with row and column, if the file cannot be used.

    Warns:
        InputWarning: for unknown columns and outlying cells, which are ignored.
    """
    path = Path(path)
    recording, notes, _ = parse_table(read_bytes(path), path.name, columns or {}, default_length)
    for note in notes:
        warnings.warn(note, InputWarning, stacklevel=2)
    return recording


def parse_table(
    raw: bytes, file: str, columns: Mapping[str, str], default_length: float | None
) -> tuple[Recording, list[str], dict[str, str]]:
    """Return the recording of a CSV file's bytes, the warnings, and the unit of each column."""
    header, lines, cells = _split_cells(decode_text(raw, file), file)
    known_columns, extra = find_columns(header, columns, file, default_length is not None)
    locate = _RowLocator(file, lines)
    values = {name: _parse_column(column, cells, locate) for name, column in known_columns.items()}
    recording = Recording.from_arrays(
        pressure=values["pressure"],
        length=values.get("length", default_length if default_length is not None else np.nan),
        force=values.get("force"),
        diameter=values.get("diameter"),
        time=_check_times(values.get("time"), known_columns, locate),
        cycle=_check_cycles(values.get("cycle"), locate),
        row=lines,
    )
    for name in ("length", "diameter"):
        if name in known_columns:
            _check_positive(values[name], known_columns[name], locate)
    units = {name: column.unit for name, column in known_columns.items()}
    recording = remove_outliers(recording, units)
    _check_gauge_pressure(recording.pressure, known_columns["pressure"], locate)
    _check_measured(recording, file)
    notes = [f"column `{title}` of {file} is none that pamjax knows, and was kept out." for title in extra]
    return recording, notes + [f"{outlier}." for outlier in recording.outliers], units


class _RowLocator:
    """Location of a row and a column, for error messages."""

    def __init__(self, file: str, lines: list[int]) -> None:
        self.file = file
        self.lines = lines

    def __call__(self, index: int, column: str = "") -> str:
        row = f"row {self.lines[index]} of {self.file}"
        return f"column `{column}`, {row}" if column else row


def _split_cells(text: str, file: str) -> tuple[list[str], list[int], list[list[str]]]:
    """Return the header, line number of each row, and each row's cells, without comments and blank lines."""
    # A comment may have any marks in it.
    written = [line if not line.lstrip().startswith("#") else "\n" for line in lines_of(text)]
    titles = next((line for line in written if line.strip(" ,\t\r\n")), "")
    check_quotes(written, file, ",", titles)
    rows = list(enumerate(csv.reader(written), 1))
    rows = [(line, cells) for line, cells in rows if any(c.strip() for c in cells)]
    rows = [(line, cells) for line, cells in rows if not cells[0].lstrip().startswith("#")]
    if not rows:
        raise refuse(
            f"{file} must hold a recording", "an empty file", remedy="Write a header and a row a sample."
        )
    header = rows[0][1]
    _check_separator(header, file)
    if len(rows) == 1:
        raise refuse(f"{file} must hold a recording", "a header and no row below it")
    while (
        len(header) > 1 and not header[-1].strip() and not any("".join(r[1][len(header) - 1 :]) for r in rows)
    ):
        header = header[:-1]
    cells = [_check_width(header, line, row, file) for line, row in rows[1:]]
    return header, [line for line, _ in rows[1:]], cells


def _check_separator(header: list[str], file: str) -> None:
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in ",".join(header) and len(header) <= ",".join(header).count(mark):
            remedy = (
                "Save it with commas between the cells and points in the numbers, or import it as it is:"
                " `pamjax import`."
            )
            raise refuse(f"the cells of {file} must be separated by commas", name, "its header", remedy)


def _check_width(header: list[str], line: int, row: list[str], file: str) -> list[str]:
    if not any(cell.strip() for cell in row[len(header) :]):
        row = row[: len(header)]
    if len(row) == len(header):
        return row
    comma_remedy = "If the numbers have decimal commas, write points: 0.5, not 0,5."
    remedy = comma_remedy if len(row) > len(header) else "A cell that was not measured keeps its comma."
    got = f"{len(row)} cells"
    raise refuse(
        f"each row must have as many cells as the header ({len(header)})",
        got,
        f"row {line} of {file}",
        remedy,
    )


def _parse_column(column: Column, cells: list[list[str]], locate: _RowLocator) -> np.ndarray:
    """Return the column in SI, (n,), NaN where its cell is blank."""
    values = np.empty(len(cells))
    for i, row in enumerate(cells):
        text = row[column.index].strip()
        values[i] = _parse_cell(text, column, locate, i) if text else np.nan
    return values * column.factor


def _parse_cell(text: str, column: Column, locate: _RowLocator, i: int) -> float:
    value = float(text) if _NUMBER_PATTERN.fullmatch(text) else np.nan
    if np.isfinite(value):
        return value
    remedy = "Leave a cell that was not measured blank."
    if _DECIMAL_COMMA_PATTERN.fullmatch(text):
        remedy = f"Write a decimal point: {text.replace(',', '.')}."
    elif text.lower() not in _BLANK_MARKS and "inf" not in text.lower() and np.isnan(value):
        remedy = "Write a bare number, its unit in the header; " + remedy[0].lower() + remedy[1:]
    raise refuse(
        f"`{column.name}` must be a finite number or blank", f"{text!r}", locate(i, column.header), remedy
    )


def _check_times(
    time: np.ndarray | None, columns: Mapping[str, Column], locate: _RowLocator
) -> np.ndarray | None:
    if time is None or np.isnan(time).all():
        return None
    column = columns["time"]
    blank = np.isnan(time)
    if blank.any():
        where = locate(int(np.argmax(blank)))
        remedy = "Fill it in, or leave the column out where order means nothing."
        raise refuse("`time` must stand in every row", "a blank", where, remedy)
    wrong = np.diff(time) <= 0
    if wrong.any():
        i = int(np.argmax(wrong)) + 1
        now, before = format_quantity(time[i], column.unit, 9), format_quantity(time[i - 1], column.unit, 9)
        is_equal = time[i] == time[i - 1]
        remedy = (
            "Give it enough digits."
            if is_equal
            else "Sort the rows, and let a new test go on where the last ended."
        )
        got = f"{now} again" if is_equal else f"{now} after {before}"
        raise refuse("`time` must grow from row to row", got, locate(i), remedy)
    return time


def _check_cycles(cycle: np.ndarray | None, locate: _RowLocator) -> np.ndarray | None:
    if cycle is None or np.isnan(cycle).all():
        return None
    wrong = ~((cycle >= 0) & (cycle == np.round(cycle)))
    if wrong.any():
        i = int(np.argmax(wrong))
        got = "a blank" if np.isnan(cycle[i]) else f"{cycle[i]:g}"
        raise refuse(
            "`cycle` must be a whole number, 0 or more", got, locate(i), "Number the strokes 1, 2, 3."
        )
    return cycle


def _check_positive(values: np.ndarray, column: Column, locate: _RowLocator) -> None:
    wrong = values <= 0
    if wrong.any():
        i = int(np.argmax(wrong))
        remedy = "Leave a cell that was not measured blank; check the sign and zero of the others."
        raise refuse(
            f"`{column.name}` must be positive", format_quantity(values[i], column.unit), locate(i), remedy
        )


def _check_gauge_pressure(pressure: np.ndarray, column: Column, locate: _RowLocator) -> None:
    allowed = max(MAX_ZERO_ERROR, MAX_ZERO_ERROR_SHARE * np.nanmax(pressure, initial=0.0))
    wrong = pressure < -allowed
    if wrong.any():
        i = int(np.argmax(wrong))
        below = format_quantity(-allowed, column.unit)
        rule = f"`pressure` is gauge pressure and must not be below the vent's zero error ({below})"
        remedy = "Check its sign, and that its gauge reads zero at atmosphere."
        raise refuse(rule, format_quantity(pressure[i], column.unit), locate(i), remedy)


def _check_measured(recording: Recording, file: str) -> None:
    if not recording.usable.any():
        raise _build_empty_error("a pressure and a length", file)
    channels = (recording.force, recording.diameter)
    if not any((np.isfinite(channel) & recording.usable).any() for channel in channels):
        raise _build_empty_error("a force or a diameter beside its pressure and length", file)


def _build_empty_error(needed: str, file: str) -> BadInput:
    return refuse(f"at least one row must have {needed}", "none", file, "Check which columns are blank.")
