"""A channel and the clock of a rig's file, in SI."""

from __future__ import annotations

import numpy as np

from pamjax.errors import BadInput
from pamjax.records.importing.import_spec import ImportSpec
from pamjax.records.importing.rig_file import RigFile
from pamjax.records.writing.case_folder import COLUMN_DECIMALS
from pamjax.units import MAGNITUDE_LIMITS, format_count, format_quantity, parse_quantity

#: Channels that need a number in every row.
_CHANNELS_WITHOUT_BLANKS = ("time", "cycle")


def read_channel(spec: ImportSpec, name: str, file: RigFile) -> np.ndarray:
    """Return a channel, (n,) SI, NaN where its cell is blank.

    Raises:
        BadInput: if the column is missing, or has a wrong unit or cell.
    """
    column = spec.columns[name]
    readings, blanks = file[column.column], file.find_blanks(column.column)
    if blanks and name in _CHANNELS_WITHOUT_BLANKS:
        raise blanks[0].build_error(name)
    factor = column.to_si(name, file.find_header(column.column), file.name)
    with np.errstate(over="ignore", invalid="ignore"):
        values = (readings - column.zero) * factor
    # A blank cell stays blank; an overflow may also give NaN.
    too_large = ~(np.abs(values) <= MAGNITUDE_LIMITS[1]) & ~np.isnan(readings)
    if too_large.any():
        k = int(np.argmax(too_large))
        rule = f"`{name}` must be at most {MAGNITUDE_LIMITS[1]:g} in SI units"
        remedy = "Check the cell, and `unit`, `zero` and `scale` in [columns]."
        raise BadInput.from_rule(rule, f"the reading {readings[k]:g}", file.locate_row(k), remedy)
    return values


def read_clock(spec: ImportSpec, file: RigFile) -> np.ndarray | None:
    """Return the time, (n,) s, from the file's column or the sampling rate; None for a static map.

    Raises:
        BadInput: if a row has no time, or if the time decreases.
    """
    if "time" in spec.columns:
        return _read_time(spec, file)
    if not spec.files.rate:
        return None
    rate = parse_quantity(spec.files.rate, "frequency", "[files] rate")
    if rate <= 0:
        raise BadInput.from_rule("`rate` must be positive", spec.files.rate, "[files]", "Check its sign.")
    first = next(c.column for name, c in spec.columns.items() if name != "time")
    return np.arange(len(file[first])) / rate


def _read_time(spec: ImportSpec, file: RigFile) -> np.ndarray:
    entry = spec.columns["time"]
    time = file.read_clock_times(entry.column)
    if time is None:
        time = read_channel(spec, "time", file)
    elif (entry.zero, entry.scale) != (0.0, 1.0):
        rule, remedy = "clock times have no `zero` and no `scale`", "Remove these entries."
        raise BadInput.from_rule(rule, where="[columns] time", remedy=remedy)
    if np.isnan(time).any():
        where = file.locate_row(int(np.argmax(np.isnan(time))))
        remedy = "Write the time, or delete the row."
        raise BadInput.from_rule("`time` must have a value in every row", "a blank", where, remedy)
    decreases = np.flatnonzero(np.diff(time) < 0)
    if decreases.size:
        row = int(decreases[0]) + 1
        got = " after ".join(file.get_text(entry.column, k) for k in (row, row - 1))
        remedy = "A file must contain one test: split it where the time restarts."
        raise BadInput.from_rule("`time` must not decrease", got, file.locate_row(row), remedy)
    return time


def check_time_steps(spec: ImportSpec, time: np.ndarray, rows: np.ndarray, file: RigFile) -> None:
    """Refuse rows that would have the same time in the recording.

    Args:
        spec: the import specification; a median filter joins such rows.
        time: (n,) time from the first row, s.
        rows: (n,) index of each row in the file.
        file: the file with the time.

    Raises:
        BadInput: with both rows of the file.
    """
    decimals = COLUMN_DECIMALS["time"]
    repeated = np.flatnonzero(np.diff(np.round(time, decimals)) <= 0)
    if spec.median or not repeated.size:
        return
    first, second = rows[repeated[0] : repeated[0] + 2] + file.lines_above + 1
    where = f"rows {first} and {second} of {file.name}"
    step = float(time[repeated[0] + 1] - time[repeated[0]])
    if step > 0:
        smallest = format_quantity(10.0**-decimals, "ms")
        rule = f"`time` must increase by at least {smallest} from row to row"
        got = f"{format_quantity(step, 'ms')} between {where}"
        raise BadInput.from_rule(
            rule, got, remedy='Average the samples: write, for example, median = "1 ms".'
        )
    got = f"the same time in {where}"
    remedy = "Delete one of the two rows."
    if len(repeated) > 1:
        got += f", and {format_count(len(repeated) - 1, 'more repetition')}"
        remedy = "Delete one row of each pair, or write the time with more digits."
    raise BadInput.from_rule("`time` must increase from row to row", got, remedy=remedy)
