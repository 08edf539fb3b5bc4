"""Clock times and dates in a column of time, as seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from pamjax.errors import BadInput, format_printable
from pamjax.records.quotation_marks import MAX_CELL_CHARACTERS

#: A date, if there is one; hours, minutes, seconds; AM or PM; and an offset from UTC.
_TIME_PATTERN = re.compile(
    r"(?:(\d[\d./-]*\d)[T ]\s*)?(\d{1,4}):([0-5]\d)(?::([0-5]\d(?:[.,]\d*)?))?"
    r"(?:\s*([AP])\.?M\.?)?(Z|[+-]\d\d:?\d\d)?",
    re.ASCII | re.IGNORECASE,
)
#: Dates in which the order of day and month is known.
_DATE_PATTERNS = (
    re.compile(r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})", re.ASCII),
    re.compile(r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})", re.ASCII),
)
#: A clock that goes back by more than this passed midnight, s.
_MIN_MIDNIGHT_STEP = 43200.0
#: s.
DAY = 86400.0
_FIRST_DAY = date(2000, 1, 1).toordinal()


def is_clock_time(cell: str, with_date: bool = True) -> bool:
    """Return whether a text is a clock time.

    Args:
        cell: the text.
        with_date: whether a date may precede it.

    >>> [is_clock_time(cell) for cell in ("10:00:00.5", "2024-05-01T10:00", "10:00", "10.5")]
    [True, True, True, False]
    """
    match = _TIME_PATTERN.fullmatch(cell)
    return match is not None and (with_date or not match[1])


def parse_clock_times(cells: Sequence[str]) -> np.ndarray:
    """Return the seconds, (n,), of clock times.

    With dates, they count from the year 2000. Without dates, they count from the first midnight.
    A clock without dates that goes back by more than 12 h passed midnight.

    Args:
        cells: clock times with hours, minutes and seconds, or dates with clock times; all in one form.

    Raises:
        ClockTimeError: for the first text that has another form, or that is ambiguous.

    >>> parse_clock_times(["23:59:59.5", "0:00:01"]).tolist()
    [86399.5, 86401.0]
    """
    forms = [_read_form(cell) for cell in cells]
    for i, form in enumerate(forms):
        if form != forms[0] or form is None:
            raise ClockTimeError(i, cells[i])
    seconds = np.array([_read_seconds(cell, i) for i, cell in enumerate(cells)])
    if forms[0] and forms[0][0]:
        return seconds
    went_back = np.diff(seconds, prepend=seconds[0]) < -_MIN_MIDNIGHT_STEP
    return seconds + DAY * np.cumsum(went_back)


class ClockTimeError(ValueError):
    """A text that is no clock time in the form of the other rows.

    Attributes:
        row: index of the row.
        text: text of the cell.
    """

    def __init__(self, row: int, text: str) -> None:
        super().__init__(row, text)
        self.row = row
        self.text = text

    def build_error(self, column: str, where: str) -> BadInput:
        """Return the message for the user."""
        rule = f"column {column} must have in all rows seconds, clock times or dates in one form"
        remedy = "Write clock times as 10:00:00.5, or dates with clock times as 2024-05-01 10:00:00.5."
        got = repr(format_printable(self.text, MAX_CELL_CHARACTERS)) if self.text else "a blank"
        return BadInput.from_rule(rule, got, where, remedy)


def _read_form(cell: str) -> tuple[bool, bool, bool] | None:
    """Return whether a text has a date, AM or PM, and an offset; None if it is no clear time."""
    match = _TIME_PATTERN.fullmatch(cell)
    # Without a date and without seconds, 10:00 may also be minutes and seconds.
    if match is None or not (match[1] or match[4] or match[5]):
        return None
    return bool(match[1]), bool(match[5]), bool(match[6])


def _read_seconds(cell: str, row: int) -> float:
    match = _TIME_PATTERN.fullmatch(cell)
    assert match is not None
    hours, half_day = int(match[2]), (match[5] or "").upper()
    if hours > (12 if half_day else 23 if match[1] else 9999):
        raise ClockTimeError(row, cell)
    if half_day:
        hours = hours % 12 + (12 if half_day == "P" else 0)
    seconds = 3600.0 * hours + 60.0 * int(match[3]) + float((match[4] or "0").replace(",", "."))
    return seconds + (DAY * _read_day(match[1], cell, row) if match[1] else 0.0) - _read_offset(match[6])


def _read_day(text: str, cell: str, row: int) -> int:
    match = next((match for pattern in _DATE_PATTERNS if (match := pattern.fullmatch(text))), None)
    try:
        if match:
            return date(int(match["year"]), int(match["month"]), int(match["day"])).toordinal() - _FIRST_DAY
    except ValueError:  # no such day
        pass
    raise ClockTimeError(row, cell)


def _read_offset(text: str | None) -> float:
    """Return the offset from UTC, s."""
    if not text or text.upper() == "Z":
        return 0.0
    digits = text[1:].replace(":", "")
    return float(f"{text[0]}1") * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:]))
