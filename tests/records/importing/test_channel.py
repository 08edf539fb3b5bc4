"""Times of an import that are equal, too close or missing: the message has the rows of the rig's file."""

import numpy as np
import pytest

from tests.records.importing.conftest import PLAIN

TIMED = PLAIN + '\ntime = {column = "t", unit = "s"}'


def rows(times):
    return "t,P,Load [lbf]\n" + "".join(f"{t},{10 + k},{5 + k}\n" for k, t in enumerate(times))


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (
            [0, 1, 1, 2],
            "`time` must increase from row to row; got the same time in rows 5 and 6 of run.csv."
            " Delete one of the two rows.",
        ),
        (
            [0, 1, 1, 1, 2, 2],
            "`time` must increase from row to row; got the same time in rows 5 and 6 of run.csv, and 2 more"
            " repetitions. Delete one row of each pair, or write the time with more digits.",
        ),
        (
            [0, 1, 1.00001, 2],
            "`time` must increase by at least 0.1 ms from row to row; got 0.01 ms between rows 5 and 6 of"
            ' run.csv. Average the samples: write, for example, median = "1 ms".',
        ),
        (
            [0, 1, "", 2],
            "`time` must have a value in every row; got a blank in row 6 of run.csv."
            " Write the time, or delete the row.",
        ),
        (
            [0, 1, 0.5, 2],
            "`time` must not decrease; got 0.5 after 1.0 in row 6 of run.csv."
            " A file must contain one test: split it where the time restarts.",
        ),
    ],
)
def test_wrong_time_is_named_with_its_rows(refuse, times, message):
    text = "bench 2\nPeter\n" + rows(times)
    assert refuse(text, columns=TIMED, files="skip = 2") == message


def test_rows_after_the_tare_keep_their_numbers(refuse):
    message = refuse(rows([0, 0, 1, 2, 2, 3]), columns=TIMED, more='[tare]\nend = "0.5 s"')
    assert "the same time in rows 5 and 6 of run.csv. Delete one" in message


def test_sampling_rate_above_the_resolution_is_refused(refuse):
    text = "P,Load [lbf]\n10,5\n20,6\n30,7\n"
    message = refuse(text, columns=PLAIN, files='rate = "50 kHz"')
    assert "must increase by at least 0.1 ms from row to row; got 0.02 ms between rows 2 and 3 of" in message


def test_median_joins_rows_of_the_same_time(rig):
    # The entry `median` is in the line below `muscle`.
    recording = rig(rows([0, 1, 1, 2]), columns=TIMED, muscle='muscle.toml"\nmedian = "1 s')
    np.testing.assert_allclose(recording.time, [0, 1, 2])
    np.testing.assert_allclose(recording.force, 4.4482216 * np.array([5, 6.5, 8]), atol=1e-4)
