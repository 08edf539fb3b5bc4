"""Reading of recording.csv: conversion to SI, and error messages with row and column."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from pamjax.errors import BadInput, format_printable
from pamjax.records.quotation_marks import MAX_CELL_CHARACTERS
from pamjax.records.reading.header import Column, find_columns
from pamjax.records.reading.number_table import NumberTable, read_number_table
from pamjax.records.reading.outliers import remove_outliers
from pamjax.records.reading.text_table import NUMBER_PATTERN, TextTable, read_text_table
from pamjax.records.recording import MAX_CYCLE, Recording
from pamjax.units import MAGNITUDE_LIMITS, format_quantity, is_representable

_DECIMAL_COMMA_PATTERN = re.compile(r"[+-]?\d+,\d+")
_CLOCK_TIME_PATTERN = re.compile(r"\d:\d\d")
_BLANK_MARKS = {"nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?"}

#: Relative difference up to which a set force equals the stated load.
_LOAD_TOLERANCE = 1e-3

#: Maximum zero error of a pressure sensor: Pa, and share of the highest pressure. In seven hose recordings
#: the sensor reads 8 to 10 kPa at atmospheric pressure; laboratory sensors state 0.25 to 1 % of full scale.
_MAX_ZERO_ERROR = 5e3
_MAX_ZERO_ERROR_SHARE = 0.01


def parse_table(
    raw: bytes,
    file: str,
    columns: Mapping[str, str],
    default_length: float | None,
    measures_length: bool = False,
    load: float | None = None,
) -> tuple[Recording, list[str], dict[str, str]]:
    """Return the recording of a CSV file's bytes, the warnings, and the unit of each column.

    Args:
        raw: bytes of the file.
        file: name of the file, for error messages.
        columns: header of the file for each channel.
        default_length: m, the length of every row without such a column.
        measures_length: whether the force is set and the length is measured.
        load: N, the set force of every row without a column of force; None for 0 N.
    """
    table = read_number_table(raw) or read_text_table(raw, file)
    known_columns, unknown_headers = find_columns(
        table.header, columns, file, default_length is not None, measures_length
    )
    locate = _RowLocator(file, table.rows)
    values = {name: _parse_column(column, table, locate) for name, column in known_columns.items()}
    if measures_length and load is not None and "force" in known_columns:
        _check_load(values["force"], load, known_columns["force"], locate)
    recording = Recording.from_arrays(
        pressure=values["pressure"],
        length=values.get("length", default_length if default_length is not None else np.nan),
        force=values.get("force", np.full(len(table.rows), load or 0.0) if measures_length else None),
        diameter=values.get("diameter"),
        time=_check_times(values.get("time"), known_columns, locate),
        cycle=_check_cycles(values.get("cycle"), locate),
        row=table.rows,
        measures_length=measures_length,
    )
    for name in ("length", "diameter"):
        if name in known_columns:
            _check_positive(values[name], known_columns[name], locate)
    units = {name: column.unit for name, column in known_columns.items()}
    recording = remove_outliers(recording, units)
    _check_gauge_pressure(recording.pressure, known_columns["pressure"], locate)
    _check_measured(recording, file)
    warnings = [f"unknown column `{title}` in {file}: ignored." for title in unknown_headers]
    return recording, warnings + [f"{outlier}." for outlier in recording.outliers], units


class _RowLocator:
    """Location of a row and a column, for error messages."""

    def __init__(self, file: str, rows: np.ndarray) -> None:
        self.file = file
        self.rows = rows

    def __call__(self, index: int, column: str = "") -> str:
        row = f"row {self.rows[index]} of {self.file}"
        return f"column `{column}`, {row}" if column else row


def _parse_column(column: Column, table: NumberTable | TextTable, locate: _RowLocator) -> np.ndarray:
    """Return the column in SI, (n,), NaN where its cell is blank."""
    values, is_blank = table.read_numbers(column.index)
    with np.errstate(over="ignore"):
        # In place, because a long recording has large columns; no other column needs these numbers.
        values *= column.factor
    is_wrong = ~is_blank & np.logical_not(is_representable(values))
    for i in np.flatnonzero(is_wrong):
        text = table.read_text(int(i), column.index)
        values[i] = _parse_cell(text, column, locate, int(i)) * column.factor
    return values


def _parse_cell(text: str, column: Column, locate: _RowLocator, i: int) -> float:
    value = float(text) if NUMBER_PATTERN.fullmatch(text) else np.nan
    if np.isfinite(value) and is_representable(value * column.factor):
        return value
    if np.isfinite(value):
        low, high = MAGNITUDE_LIMITS
        rule = f"`{column.name}` must be 0 or between {low:g} and {high:g} in SI units"
        raise BadInput.from_rule(
            rule, _quote_cell(text), locate(i, column.header), "Check the digits of the cell."
        )
    remedy = "Leave the cell blank if it was not measured."
    if _DECIMAL_COMMA_PATTERN.fullmatch(text):
        remedy = f"Write a decimal point: {text.replace(',', '.')}."
    elif column.name == "time" and _CLOCK_TIME_PATTERN.search(text):
        remedy = "Write seconds, or import the file with `pamjax import`, which reads clock times."
    elif text.lower() not in _BLANK_MARKS and "inf" not in text.lower() and np.isnan(value):
        remedy = "Write a number here and the unit in the header. " + remedy
    raise BadInput.from_rule(
        f"`{column.name}` must be a finite number or blank",
        _quote_cell(text),
        locate(i, column.header),
        remedy,
    )


def _quote_cell(text: str) -> str:
    return repr(format_printable(text, MAX_CELL_CHARACTERS))


def _check_times(
    time: np.ndarray | None, columns: Mapping[str, Column], locate: _RowLocator
) -> np.ndarray | None:
    if time is None or np.isnan(time).all():
        return None
    column = columns["time"]
    blank = np.isnan(time)
    if blank.any():
        where = locate(int(np.argmax(blank)))
        remedy = "Add the value, or remove the column if the order of rows has no meaning."
        raise BadInput.from_rule("`time` must have a value in every row", "a blank", where, remedy)
    is_invalid = np.diff(time) <= 0
    if is_invalid.any():
        i = int(np.argmax(is_invalid)) + 1
        time_text, previous_text = (
            format_quantity(time[i], column.unit, 9),
            format_quantity(time[i - 1], column.unit, 9),
        )
        is_equal = time[i] == time[i - 1]
        remedy = (
            "Delete one of the two rows, or write more digits."
            if is_equal
            else "Sort the rows. Continue the time of a new test after the last one."
        )
        got = f"{time_text} twice" if is_equal else f"{time_text} after {previous_text}"
        raise BadInput.from_rule("`time` must increase from row to row", got, locate(i), remedy)
    return time


def _check_cycles(cycle: np.ndarray | None, locate: _RowLocator) -> np.ndarray | None:
    if cycle is None or np.isnan(cycle).all():
        return None
    is_invalid = ~((cycle >= 0) & (cycle <= MAX_CYCLE) & (cycle == np.round(cycle)))
    if is_invalid.any():
        i = int(np.argmax(is_invalid))
        got = "a blank" if np.isnan(cycle[i]) else f"{cycle[i]:g}"
        raise BadInput.from_rule(
            f"`cycle` must be a whole number from 0 to {MAX_CYCLE}",
            got,
            locate(i),
            "Number the strokes 1, 2, 3.",
        )
    return cycle


def _check_positive(values: np.ndarray, column: Column, locate: _RowLocator) -> None:
    is_invalid = values <= 0
    if is_invalid.any():
        i = int(np.argmax(is_invalid))
        remedy = "Leave the cell blank if it was not measured. Otherwise check its sign and zero."
        raise BadInput.from_rule(
            f"`{column.name}` must be positive", format_quantity(values[i], column.unit), locate(i), remedy
        )


def _check_load(force: np.ndarray, load: float, column: Column, locate: _RowLocator) -> None:
    """Refuse a set force that differs from the load of muscle.toml."""
    is_different = np.isfinite(force) & (np.abs(force - load) > _LOAD_TOLERANCE * max(abs(load), 1.0))
    if is_different.any():
        i = int(np.argmax(is_different))
        rule = f"`force` must equal `load` in [test] of muscle.toml ({format_quantity(load, column.unit)})"
        remedy = "Remove `load`: the column states the set force of each row."
        raise BadInput.from_rule(rule, format_quantity(force[i], column.unit), locate(i), remedy)


def _check_gauge_pressure(pressure: np.ndarray, column: Column, locate: _RowLocator) -> None:
    max_zero_error = max(_MAX_ZERO_ERROR, _MAX_ZERO_ERROR_SHARE * np.nanmax(pressure, initial=0.0))
    is_invalid = pressure < -max_zero_error
    if is_invalid.any():
        i = int(np.argmax(is_invalid))
        minimum = format_quantity(-max_zero_error, column.unit)
        rule = f"`pressure` must be gauge pressure, and not below the permitted zero error ({minimum})"
        remedy = "Check its sign. The sensor must read zero at atmospheric pressure."
        raise BadInput.from_rule(rule, format_quantity(pressure[i], column.unit), locate(i), remedy)


def _check_measured(recording: Recording, file: str) -> None:
    if not recording.usable.any():
        raise _build_empty_error("pressure and length", file)
    channels = (recording.force, recording.diameter)
    if not any((np.isfinite(channel) & recording.usable).any() for channel in channels):
        raise _build_empty_error("pressure, length, and force or diameter", file)


def _build_empty_error(needed_columns: str, file: str) -> BadInput:
    return BadInput.from_rule(
        f"at least one row must have {needed_columns}", "none", file, "Check for blank columns."
    )
