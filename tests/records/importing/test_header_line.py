"""The line of the header in a table with lines above it."""

import pytest

from pamjax.records.importing.header_line import suggest_header_line
from tests.records.importing.conftest import PLAIN

NUMBERS = ["0,10,5", "1,20,6"]


@pytest.mark.parametrize(
    ("lines", "row", "units"),
    [
        (["bench 2", "t,p,F", *NUMBERS], 2, False),
        (["bench 2", "Peter,Monday", "", "t,p,F", *NUMBERS], 4, False),
        (["bench 2", "t,p,F", "s,kPa,N", *NUMBERS], 2, True),
        (["bench 2", "t,p,test", "[s],[kPa],-", *NUMBERS], 2, True),
        (["run,3,2024", "t,p,F", *NUMBERS], 2, False),
        (["bench 2", "t,p,F", "10:00:00.5,10,5", "10:00:01.0,20,6"], 2, False),
    ],
)
def test_header_is_above_the_first_numbers(lines, row, units):
    remedy = f"write skip = {row - 1}{' and units = true' if units else ''} in [files]."
    assert suggest_header_line(lines, ",", 0) == f"The header seems to be in row {row}: {remedy}"
    assert suggest_header_line(lines, ",", row - 1) == ""


@pytest.mark.parametrize(
    "lines",
    [[], NUMBERS, ["t,p,F", *NUMBERS], ["t,p,F", "s,kPa,N", *NUMBERS], ["a", "b,c", "d,e"], ["t", "0", "1"]],
)
def test_header_in_the_first_line_or_nowhere_has_no_remedy(lines):
    assert suggest_header_line(lines, ",", 0) == ""


def test_blanks_between_cells():
    lines = ["bench 2 by Peter", "  t   F", "0.0 5.0", "0.5 6.0"]
    assert "row 2: write skip = 1" in suggest_header_line(lines, " ", 0)


@pytest.mark.parametrize(
    ("above", "columns"),
    [
        ("bench 2\nPeter\n", PLAIN),
        ("bench 2,\nPeter,\n", PLAIN.replace('"P"', '"Druck"').replace("Load [lbf]", "Druck")),
        ("bench 2,\nPeter,\n", 'force = {column = 2, unit = "N"}\npressure = {column = 1, unit = "psi"}'),
        ("bench 2\nPeter\n", 'force = {column = 2, unit = "N"}\npressure = {column = 1, unit = "psi"}'),
    ],
)
def test_lines_above_the_header_of_a_text_file_are_named(refuse, above, columns):
    message = refuse(f"{above}P,Load [lbf]\n10,5\n20,11\n", columns=columns)
    assert message.endswith("The header seems to be in row 3: write skip = 2 in [files].")
