"""Recordings with cells, headers and numbers that no rig writes: one short sentence at once."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pamjax.errors import BadInput
from pamjax.records.reading.header import split_title
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.reading.table import parse_table
from tests.records.conftest import MUSCLE

HEADER = "pressure [kPa],length [mm],force [N]\n"
IN_SI = "or between 1e-30 and 1e+30 in SI units; got"


def read_error(text):
    start = time.monotonic()
    with pytest.raises(BadInput) as error:
        parse_table(text.encode(), "a.csv", {}, None)
    assert time.monotonic() - start < 2.0
    assert len(str(error.value)) < 1500
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            HEADER + "100,200," + "1" * 200_000,
            "a row must have at most 100000 characters; got 200008 in row 2 of a.csv. Check the line breaks",
        ),
        (HEADER + "100,200," + "x" * 5000, f"got '{'x' * 30}…' in column `force [N]`, row 2 of a.csv."),
        (HEADER + "1e308,200,3", f"`pressure` must be 0 {IN_SI} '1e308' in column `pressure [kPa]`, row 2"),
        (HEADER + "100,200,1e-320", f"`force` must be 0 {IN_SI} '1e-320' in column `force [N]`, row 2"),
        (
            HEADER.replace("length [mm]", "length" + " " * 50_000 + "x") + "1,2,3",
            "a recording must have a column `length [mm]`",
        ),
        (
            "pressure [kPa],length [mm],force [N],cycle\n1,2,3,1e20",
            "`cycle` must be a whole number from 0 to 1000000000; got 1e+20 in row 2 of a.csv. Number the",
        ),
    ],
    ids=["long row", "long cell", "1e308 kPa", "1e-320 N", "blanks", "cycle"],
)
def test_hostile_cell_is_one_short_sentence(text, message):
    assert message in read_error(text)


def test_all_wrong_units_of_a_header_are_one_message():
    message = read_error("pressure [PSI],length [㎜],force [newtn]\n1,2,3")
    assert message == (
        "unknown unit 'PSI' (column `pressure [PSI]` of a.csv). Did you mean `psi`?"
        " Also: unknown unit '㎜' (column `length [㎜]` of a.csv). Did you mean `mm`?"
        " Also: unknown unit 'newtn' (column `force [newtn]` of a.csv). Did you mean `newton`?"
    )


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            'rest_length = "9.28125 \\""',
            "unknown unit '\"' ([muscle] rest_length of muscle.toml). Did you mean `in`?",
        ),
        (
            "turns = 1e308",
            "a quantity must be between 1e-30 and 1e+30 in SI units; got 1e+308 in [muscle] turns",
        ),
        (
            "threads = 9000000000",
            "`[muscle] threads` must be at most 1000000; got 9000000000 in muscle.toml.",
        ),
    ],
)
def test_hostile_entry_is_one_sentence(entry, message):
    name = entry.split(" ")[0]
    lines = [line for line in MUSCLE.splitlines() if not line.startswith(f"{name} =")]
    with pytest.raises(BadInput) as error:
        read_muscle_toml("\n".join([*lines, entry]).encode())
    assert message in str(error.value)


@given(st.text(max_size=40), st.text("abkPmN/*^2 ", max_size=10))
def test_title_has_name_and_unit(name, unit):
    assert split_title(f"{name} [{unit}]") == (name.strip(), unit.strip())
    assert split_title(f"{name} ({unit})") == (name.strip(), unit.strip())


@pytest.mark.parametrize("title", ["a [b", "a b]", "a [b]]", "a ([)b", "[mm] a"])
def test_title_without_a_unit_is_a_name(title):
    assert split_title(title) == (title, None)
