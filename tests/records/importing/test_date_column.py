"""Date and clock time in two columns: joined to one time, with a note, or one clear sentence."""

import datetime

import numpy as np
import openpyxl
import pytest

from tests.records.importing.conftest import PLAIN

CLOCK, DATE = (f'{PLAIN}\ntime = "{name}"' for name in ("Clock", "Date"))
NOTE = "`time` has the dates of column `Date` and the clock times of column `Clock`."
HOUR, DAY = 3600.0, 86400.0


def rows(pairs):
    lines = [f"{date},{clock},{10 + k},{5 + k}" for k, (date, clock) in enumerate(pairs)]
    return "\n".join(["Date,Clock,P,Load [lbf]", *lines, ""])


ONE_DAY = [("2024-05-01", "10:00:00"), ("2024-05-01", "10:00:01.5"), ("2024-05-01", "10:00:03")]
#: A pause of two days and one hour.
PAUSE = [("1.5.2024", "10:00:00"), ("1.5.2024", "10:00:01"), ("3.5.2024", "11:00:01")]


@pytest.mark.parametrize(
    ("pairs", "seconds"),
    [
        (ONE_DAY, [0, 1.5, 3]),
        (PAUSE, [0, 1, 1 + 2 * DAY + HOUR]),
        ([("2024/12/31", "23:59"), ("2025/1/1", "0:00"), ("2025/1/1", "0:01")], [0, 60, 120]),
        ([("2024-05-01", "11:59:59 AM"), ("2024-05-01", "12:00:00 PM"), ("2024-05-02", "1:00:00 PM")],
         [0, 1, 1 + DAY + HOUR]),
    ],
)  # fmt: skip
def test_column_of_dates_is_joined_with_the_clock(import_rig, pairs, seconds):
    result = import_rig(rows(pairs), columns=DATE)
    np.testing.assert_allclose(result.case.recording.time, seconds, atol=1e-6)
    (note,) = result.notes
    assert note.startswith(NOTE)


def test_clock_is_joined_with_dates_if_they_change_the_time(import_rig):
    result = import_rig(rows(PAUSE), columns=CLOCK)
    np.testing.assert_allclose(result.case.recording.time, [0, 1, 1 + 2 * DAY + HOUR], atol=1e-6)
    note = f"{NOTE} Its largest step is 176400 s."
    assert result.notes == (note,)
    assert f"note: {note}" in str(result)


@pytest.mark.parametrize(
    ("pairs", "seconds"),
    [
        (ONE_DAY, [0, 1.5, 3]),
        ([("2024-05-01", "23:59:59"), ("2024-05-02", "0:00:01"), ("2024-05-02", "0:00:02")], [0, 2, 3]),
        # Time from the start of a test, over midnight.
        ([("2024-05-01", "0:00:00"), ("2024-05-01", "0:00:01"), ("2024-05-02", "0:00:02")], [0, 1, 2]),
        # A logger that keeps the date of the start.
        ([("2024-05-01", "23:59:59"), ("2024-05-01", "0:00:01"), ("2024-05-01", "0:00:02")], [0, 2, 3]),
        # A date that does not change has no effect.
        ([("05/01/2024", "10:00:00"), ("05/01/2024", "10:00:01"), ("05/01/2024", "10:00:02")], [0, 1, 2]),
    ],
)
def test_clock_alone_has_no_note(import_rig, pairs, seconds):
    result = import_rig(rows(pairs), columns=CLOCK)
    np.testing.assert_allclose(result.case.recording.time, seconds, atol=1e-6)
    assert result.notes == ()


def test_unclear_dates_beside_a_clock_give_a_note(import_rig):
    pairs = [("05/01/2024", "10:00:00"), ("05/01/2024", "10:00:01"), ("06/01/2024", "10:00:02")]
    result = import_rig(rows(pairs), columns=CLOCK)
    np.testing.assert_allclose(result.case.recording.time, [0, 1, 2], atol=1e-6)
    assert result.notes == (
        "The dates of column `Date` are not used: with `05/01/2024 10:00:00` they are unclear, or go back."
        " A clear date is 2024-05-01.",
    )


def test_dates_beside_a_clock_with_dates_have_no_note(import_rig):
    pairs = [("2024-05-01", "2024-05-01 23:59:59"), ("2024-05-02", "2024-05-02 00:00:01")]
    result = import_rig(rows(pairs), columns=CLOCK)
    np.testing.assert_allclose(result.case.recording.time, [0, 2], atol=1e-6)
    assert result.notes == ()


def test_two_columns_of_one_channel_are_refused(refuse):
    message = refuse(rows(ONE_DAY), columns=CLOCK.replace('time = "Clock"', 'time = ["Date", "Clock"]'))
    assert "a channel must have one column; got ['Date', 'Clock'] in [columns]" in message
    assert message.endswith("state that of the clock: the dates are joined to it.")


@pytest.mark.parametrize("columns", [DATE, CLOCK])
def test_dates_and_clock_times_of_a_spreadsheet_are_joined(import_rig, tmp_path, columns):
    book = openpyxl.Workbook()
    book.active.append(["Date", "Clock", "P", "Load [lbf]"])
    for k in range(3):
        book.active.append([datetime.date(2024, 5, 1 + k), datetime.time(10, 0, k), 10 + k, 5 + k])
    book.save(tmp_path / "run.xlsx")
    result = import_rig(None, file='"run.xlsx"', columns=columns)
    np.testing.assert_allclose(result.case.recording.time, [0, 1 + DAY, 2 + 2 * DAY], atol=1e-6)
    assert result.notes == (f"{NOTE} Its largest step is 86401 s.",)


def test_file_without_dates_is_aligned_with_one_that_has_them(rig, tmp_path):
    (tmp_path / "p.csv").write_text("Clock,P\n10:00:00,10\n10:00:01,20\n10:00:02,30\n")
    text = "Date,Clock,Load [lbf]\n2024-05-01,10:00:01,5\n2024-05-01,10:00:02,6\n"
    got = rig(text, file='{force = "run.csv", pressure = "p.csv"}', columns=CLOCK)
    np.testing.assert_allclose(got.pressure, 6894.757 * np.array([20, 30]), atol=0.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "Date,P,Load [lbf]\n2024-05-01,10,5\n2024-05-02,11,6\n",
            "`time` needs clock times; column `Date` of run.csv has only dates."
            " Name a column with seconds or clock times in [columns].",
        ),
        (
            "Date,Start,Clock,P,Load [lbf]\n2024-05-01,9:00:00,10:00:00,10,5\n"
            "2024-05-01,9:00:00,10:00:01,11,6\n",
            "`time` needs clock times; column `Date` of run.csv has only dates."
            ' Columns `Start` and `Clock` have clock times: write, for example, time = "Start" in [columns].',
        ),
        (
            rows([("2024-05-01", "10:00:00"), ("2024-05-01", "late")]),
            "columns `Date` and `Clock` must have a clear date and clock time in each row,"
            " none before that of an earlier row; got '2024-05-01 late' in row 3 of run.csv."
            " Write dates as 2024-05-01, and clock times as 10:00:00.5.",
        ),
        (
            rows([("05/01/2024", "10:00:00"), ("05/01/2024", "10:00:01")]),
            "columns `Date` and `Clock` must have a clear date and clock time in each row,"
            " none before that of an earlier row; got '05/01/2024 10:00:00' in row 2 of run.csv."
            " Write dates as 2024-05-01, and clock times as 10:00:00.5.",
        ),
        (
            rows([("2024-05-01", "23:59:59"), ("2024-05-01", "0:00:01")]),
            "columns `Date` and `Clock` must have a clear date and clock time in each row,"
            " none before that of an earlier row; got '2024-05-01 0:00:01' in row 3 of run.csv."
            " Write dates as 2024-05-01, and clock times as 10:00:00.5.",
        ),
        (
            rows([("2024-05-01", "00:10"), ("2024-05-01", "00:20")]),
            "columns `Date` and `Clock` must have a clear date and clock time in each row,"
            " none before that of an earlier row; got '00:10' in row 2 of run.csv."
            " Write dates as 2024-05-01, and clock times as 10:00:00.5.",
        ),
    ],
)
def test_dates_without_clear_clock_times_are_refused(refuse, text, message):
    assert refuse(text, columns=DATE) == message
