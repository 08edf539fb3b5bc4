"""[specimen] of a muscle.toml: origin of a recording, with messages for wrong entries."""

import datetime

import pytest

from pamjax.errors import BadInput
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.reading.specimen import Specimen

MUSCLE = '[muscle]\nrest_length = "200 mm"\nthread_length = "214 mm"\nturns = 1.2\n'


def read(entries):
    return read_muscle_toml(f"{MUSCLE}[specimen]\n{entries}\n".encode()).specimen


def test_origin_is_read():
    expected = Specimen("north 2", "12", "short", datetime.date(2026, 3, 2))
    assert read('bench = "north  2"\nserial = 12\ntype = "short"\ndate = 2026-03-02') == expected
    assert read('date = "2026-03-02"').date == read("date = 2026-03-02T10:00:00").date
    assert read_muscle_toml(MUSCLE.encode()).specimen == Specimen()


def test_stated_entries_replace_others():
    first = Specimen(bench="north", serial="1")
    assert first.update(Specimen(bench="south", type="x")) == Specimen("south", "1", "x")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            "bench = 1.5",
            "`[specimen] bench` must be a text in quotes or a whole number; got 1.5 in muscle.toml",
        ),
        ('bench = " "', "`[specimen] bench` must be a text in quotes"),
        (f'serial = "{"1" * 81}"', "must be one line of at most 80 characters"),
        ('date = "March"', "`[specimen] date` must be a day such as 2026-03-02; got 'March'"),
        ('benhc = "x"', "unknown entry `benhc` ([specimen] of muscle.toml). Did you mean `bench`?"),
    ],
)
def test_wrong_entries_are_refused(entry, message):
    with pytest.raises(BadInput) as error:
        read(entry)
    assert message in str(error.value)
