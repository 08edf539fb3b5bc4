"""Clock times and dates in the column of time: seconds from the first row, or one clear sentence."""

import datetime

import numpy as np
import openpyxl
import pytest

from tests.records.importing.conftest import PLAIN

TIMED = PLAIN + '\ntime = "t"'


def rows(times, separator=","):
    lines = [f"{time}{separator}{10 + k}{separator}{5 + k}" for k, time in enumerate(times)]
    return "\n".join([separator.join(("t", "P", "Load [lbf]")), *lines, ""])


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (["10:00:00.5", "10:00:01.0", "10:01:01.25"], [0, 0.5, 60.75]),
        (["9:59:59", "10:00:00", "10:00:02"], [0, 1, 3]),
        (["23:59:59.5", "00:00:00.5", "00:00:02"], [0, 1, 2.5]),
        (["100:00:00", "100:00:01", "100:00:05"], [0, 1, 5]),
        (["11:59:59 AM", "12:00:00 PM", "1:00:00 pm"], [0, 1, 3601]),
        (["2024-02-28 23:59:59.5", "2024-02-29 00:00:00", "2024-03-01 00:00:00"], [0, 0.5, 86400.5]),
        (["2024-05-01T10:00:00.5Z", "2024-05-01T10:00:01Z", "2024-05-01T10:00:02Z"], [0, 0.5, 1.5]),
        (["2024-10-27T02:59:59+0200", "2024-10-27T02:00:00+01:00", "2024-10-27T02:00:01+01:00"], [0, 1, 2]),
        (["31.12.2024 23:59", "1.1.2025 0:00", "1.1.2025 0:01"], [0, 60, 120]),
        (["2024/05/01 10:00:00", "2024/05/01 10:00:01", "2024/05/01 10:00:03"], [0, 1, 3]),
    ],
)
def test_clock_times_are_seconds_from_the_first_row(rig, times, seconds):
    np.testing.assert_allclose(rig(rows(times), columns=TIMED).time, seconds, atol=1e-6)


def test_decimal_comma_and_a_unit_of_time_in_the_header(rig):
    text = rows(["10:00:00,5", "10:00:01,0", "10:00:02,5"], ";").replace("t;", "t [hh:mm:ss];")
    got = rig(text, columns=TIMED, files='separator = ";"\ndecimal = ","')
    np.testing.assert_allclose(got.time, [0, 0.5, 2], atol=1e-6)


@pytest.mark.parametrize(
    "cells",
    [
        [datetime.time(10, 0, k, 500_000) for k in range(3)],
        [datetime.datetime(2024, 5, 1, 0, 0, k) for k in range(3)],
        [datetime.timedelta(hours=30, seconds=k) for k in range(3)],
    ],
)
def test_clock_times_of_a_spreadsheet(rig, tmp_path, cells):
    book = openpyxl.Workbook()
    book.active.append(["t", "P", "Load [lbf]"])
    for k, cell in enumerate(cells):
        book.active.append([cell, 10 + k, 5 + k])
    book.save(tmp_path / "run.xlsx")
    got = rig(None, file='"run.xlsx"', columns=TIMED)
    np.testing.assert_allclose(got.time, [0, 1, 2], atol=1e-3)


def test_clocks_of_separate_files_are_aligned(rig, tmp_path):
    (tmp_path / "p.csv").write_text("t,P\n10:00:01,10\n10:00:02,20\n10:00:03,30\n")
    got = rig(
        "t,Load [lbf]\n10:00:02,5\n10:00:03,6\n",
        file='{force = "run.csv", pressure = "p.csv"}',
        columns=TIMED,
    )
    np.testing.assert_allclose(got.pressure, 6894.757 * np.array([20, 30]), atol=0.1)


@pytest.mark.parametrize(
    ("times", "got", "row"),
    [
        # Hours and minutes, or minutes and seconds.
        (["10:00", "10:01", "10:02"], "'10:00'", 2),
        # Month and day, or day and month.
        (["05/01/2024 10:00:00", "05/01/2024 10:00:01"], "'05/01/2024 10:00:00'", 2),
        (["10:00:00", "10:00:01 PM"], "'10:00:01 PM'", 3),
        (["10:00:00", "2024-05-01 10:00:01"], "'2024-05-01 10:00:01'", 3),
        (["10:00:00", "late", "10:00:02"], "'late'", 3),
        (["10:00:00", "", "10:00:02"], "a blank", 3),
        (["2024-02-30 10:00:00", "2024-02-30 10:00:01"], "'2024-02-30 10:00:00'", 2),
        (["2024-02-28 25:00:00", "2024-02-28 25:00:01"], "'2024-02-28 25:00:00'", 2),
        (["13:00:00 PM", "13:00:01 PM"], "'13:00:00 PM'", 2),
    ],
)
def test_unclear_clock_time_is_refused(refuse, times, got, row):
    assert refuse(rows(times), columns=TIMED) == (
        f"column `t` must have in all rows seconds, clock times or dates in one form; got {got} in row {row}"
        " of run.csv. Write clock times as 10:00:00.5, or dates with clock times as 2024-05-01 10:00:00.5."
    )


def test_clock_that_goes_back_is_refused_with_its_texts(refuse):
    message = refuse(rows(["10:00:00", "10:00:05", "10:00:04"]), columns=TIMED)
    assert message == (
        "`time` must not decrease; got 10:00:04 after 10:00:05 in row 4 of run.csv."
        " A file must contain one test: split it where the time restarts."
    )


def test_zero_of_clock_times_is_refused(refuse):
    columns = PLAIN + '\ntime = {column = "t", zero = 5.0}'
    message = refuse(rows(["10:00:00", "10:00:05"]), columns=columns)
    assert message == "clock times have no `zero` and no `scale` ([columns] time). Remove these entries."
