"""Date and clock time in two columns, joined to one time."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.errors import BadInput, format_printable
from pamjax.records.importing.clock_times import DAY, ClockTimeError, is_clock_time, parse_clock_times
from pamjax.records.quotation_marks import MAX_CELL_CHARACTERS

#: A date; a spreadsheet adds midnight.
_DATE_PATTERN = re.compile(r"(\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4})(?:[T ]00:00:00)?", re.ASCII)

#: Rounding error of a time since the year 2000, s.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class JoinedTime:
    """Time from a column of dates and a column of clock times.

    Attributes:
        seconds: (n,) seconds from a midnight.
        date, clock: headers of the two columns.
        differs: whether the seconds differ from those of the clock alone.
        largest_step: largest step between two rows, s.
    """

    seconds: np.ndarray
    date: str
    clock: str
    differs: bool
    largest_step: float

    @property
    def note(self) -> str:
        """Return a note for the user; with the largest step if the dates change the time."""
        note = f"`time` has the dates of column `{self.date}` and the clock times of column `{self.clock}`."
        return f"{note} Its largest step is {self.largest_step:.6g} s." if self.differs else note


def is_date(cell: str) -> bool:
    """Return whether a text is a date without a clock time.

    >>> [is_date(cell) for cell in ("2024-05-01", "1.5.2024", "2024-05-01 00:00:00", "10:00:00", "1.5")]
    [True, True, True, False, False]
    """
    return _DATE_PATTERN.fullmatch(cell) is not None


def is_time_text(cell: str) -> bool:
    """Return whether a text is a date, a clock time, or both."""
    return is_clock_time(cell) or is_date(cell)


def join_date_and_clock(
    column: str, texts: Mapping[str, Sequence[str]], file: str, locate_row: Callable[[int], str]
) -> JoinedTime | None:
    """Return the time from a column of dates and one of clock times; None if the column is used alone.

    A column of clock times is used alone if there is not exactly one column of dates, if the dates are
    unclear, if dates and clock go back, or if it starts at 0:00:00. It then counts from the start of the
    test.

    Args:
        column: header of the column of `time`.
        texts: texts of the cells, (n,), of each column that begins with a date or a clock time, by header.
        file: name of the file.
        locate_row: function that returns the location of a row.

    Raises:
        BadInput: for dates without exactly one column of clock times, or for an unclear row.
    """
    dates = _list_dates(texts)
    clocks = [header for header, cells in texts.items() if is_clock_time(cells[0], with_date=False)]
    if column in dates:
        if len(clocks) != 1:
            raise _refuse_dates(column, file, clocks)
        try:
            return _join(column, clocks[0], texts)
        except ClockTimeError as error:
            rule = (
                f"columns `{column}` and `{clocks[0]}` must have a clear date and clock time in each row,"
                " none before that of an earlier row"
            )
            remedy = "Write dates as 2024-05-01, and clock times as 10:00:00.5."
            raise BadInput.from_rule(
                rule, repr(format_printable(error.text, MAX_CELL_CHARACTERS)), locate_row(error.row), remedy
            ) from error
    if column not in clocks or len(dates) != 1:
        return None
    try:
        joined = _join(dates[0], column, texts)
    except ClockTimeError:
        return None
    # Another file may have no dates: its clock counts from midnight.
    seconds = joined.seconds - DAY * (joined.seconds[0] // DAY)
    return None if seconds[0] < 1.0 else replace(joined, seconds=seconds)


def describe_unused_dates(clock: str, texts: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return a note on dates that change and are not joined to the clock; empty if there are none.

    Args:
        clock: header of the column of time, which is used alone; with dates of its own, it has no note.
        texts: as of `join_date_and_clock`.
    """
    dates = _list_dates(texts)
    has_own_dates = not is_clock_time(texts[clock][0], with_date=False)
    if has_own_dates or len(dates) != 1 or len(set(texts[dates[0]])) == 1:
        return ()
    try:
        _join(dates[0], clock, texts)
    except ClockTimeError as error:
        reason = f"with `{format_printable(error.text, MAX_CELL_CHARACTERS)}` they are unclear, or go back"
        return (f"The dates of column `{dates[0]}` are not used: {reason}. A clear date is 2024-05-01.",)
    return ()


def _list_dates(texts: Mapping[str, Sequence[str]]) -> list[str]:
    return [header for header, cells in texts.items() if all(map(is_date, cells))]


def _join(date: str, clock: str, texts: Mapping[str, Sequence[str]]) -> JoinedTime:
    days = [_DATE_PATTERN.sub(r"\1", cell) for cell in texts[date]]
    cells = [f"{d} {c}" for d, c in zip(days, texts[clock], strict=True)]
    seconds = parse_clock_times(cells)
    steps = np.diff(seconds)
    if np.any(steps < 0):
        row = int(np.argmax(steps < 0)) + 1
        raise ClockTimeError(row, cells[row])
    differs = _changes_clock(steps, texts[clock], is_one_day=len(set(days)) == 1)
    return JoinedTime(seconds, date, clock, differs, float(np.max(steps, initial=0.0)))


def _changes_clock(steps: np.ndarray, clock: Sequence[str], is_one_day: bool) -> bool:
    """Return whether steps, (n − 1,), differ from those of the clock alone, s."""
    try:
        alone = parse_clock_times(clock)
    except ClockTimeError:
        # Within one day, 10:00 may also be minutes and seconds.
        if is_one_day:
            raise
        return True
    return bool(np.any(np.abs(steps - np.diff(alone)) > _ROUNDING))


def _refuse_dates(column: str, file: str, clocks: Sequence[str]) -> BadInput:
    rule = f"`time` needs clock times; column `{column}` of {file} has only dates"
    if not clocks:
        return BadInput.from_rule(rule, remedy="Name a column with seconds or clock times in [columns].")
    listing = " and ".join(f"`{clock}`" for clock in clocks)
    remedy = f'Columns {listing} have clock times: write, for example, time = "{clocks[0]}" in [columns].'
    return BadInput.from_rule(rule, remedy=remedy)
