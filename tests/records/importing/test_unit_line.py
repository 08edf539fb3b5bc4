"""Import of tables with a line of units below the header, and of text that is not UTF-8."""

import re
from shutil import rmtree

import numpy as np
import openpyxl
import pytest

from pamjax.errors import BadInput
from pamjax.records.importing.importer import import_case

MUSCLE = """\
[muscle]
rest_length = "250 mm"
diameter = "20 mm"
braid_angle = "65 deg"

[test]
measured = "length"
"""
SPEC = """\
muscle = "muscle.toml"
files = {{separator = ";", decimal = ","{files}}}
columns = {{{columns}}}
tests = [{{file = "{file}"}}]
"""
COLUMNS = 'time = "Zeit", pressure = "Druck", shortening = "Verkürzung"'
TEXT = "Zeit;Druck;Verkürzung;Notiz\r\n[s];[bar];[mm];\r\n0,0;0,004;0,0;\r\n1,0;2,5;30,5;Luft\r\n"


@pytest.fixture
def read(tmp_path):
    """Import a text or the file table.xlsx, and return its recording."""

    def _read(text="", files=", units = true", columns=COLUMNS, encoding="utf-8"):
        (tmp_path / "muscle.toml").write_text(MUSCLE)
        (tmp_path / "table.csv").write_bytes(text.encode(encoding))
        file = "table.csv" if text else "table.xlsx"
        spec = SPEC.format(files=files, columns=columns, file=file)
        (tmp_path / "import.toml").write_text(spec, "utf-8")
        rmtree(tmp_path / "case", ignore_errors=True)
        return import_case(tmp_path / "import.toml", tmp_path / "case").case.recording

    return _read


def check_rows(recording):
    np.testing.assert_allclose(recording.time, [0.0, 1.0])
    np.testing.assert_allclose(recording.pressure, [400.0, 2.5e5])
    np.testing.assert_allclose(recording.length, [0.25, 0.2195])


def test_units_below_the_header_of_a_text(read):
    check_rows(read(TEXT))


def test_lines_above_the_header_and_column_numbers(read):
    check_rows(
        read("Stand 2\r\n\r\n" + TEXT, ", units = true, skip = 2", "time = 1, pressure = 2, shortening = 3")
    )


def test_stated_unit_and_unit_in_the_header_take_precedence(read):
    columns = COLUMNS.replace('"Druck"', '{column = "Druck", unit = "bar"}')
    check_rows(read(TEXT.replace("[bar]", "[kPa]"), columns=columns))
    check_rows(read(TEXT.replace("Zeit;", "Zeit (s);").replace("[s]", "[min]")))


def test_units_below_the_header_of_a_sheet(read, tmp_path):
    book = openpyxl.Workbook()
    for row in (
        ["Test 7"],
        ["Zeit", "Druck", "Verkürzung"],
        ["s", "bar", "mm"],
        [0, 0.004, 0],
        [1, 2.5, 30.5],
    ):
        book.active.append(row)
    book.save(tmp_path / "table.xlsx")
    check_rows(read(files=", units = true, skip = 1"))
    book.active.append([2, "about 3", 31])
    book.save(tmp_path / "table.xlsx")
    with pytest.raises(BadInput, match=r"got 'about 3' in row 6 of table\.xlsx"):
        read(files=", units = true, skip = 1")


@pytest.mark.parametrize(
    ("text", "files", "message"),
    [
        (
            TEXT,
            "",
            "got '[bar]' in row 2 of table.csv. If this line contains the units, write units = true in",
        ),
        (
            TEXT.replace("[bar]", "ohne"),
            "",
            "got 'ohne' in row 2 of table.csv. Check `skip`, `header` and `decimal`",
        ),
        (TEXT.replace("0,004", "viel"), ", units = true", "got 'viel' in row 3 of table.csv. Check `skip`"),
        (
            TEXT.replace("[bar]", ""),
            ", units = true",
            "`pressure` needs a unit; got none in [columns] pressure",
        ),
        (
            TEXT.replace("[bar]", "[mm]"),
            ", units = true",
            "a pressure must have a unit of pressure; got 'mm'",
        ),
        (TEXT, ", units = true, header = false", "`units` needs a header above the units; got no header in"),
    ],
)
def test_wrong_line_of_units_is_explained(read, text, files, message):
    with pytest.raises(BadInput, match=re.escape(message)):
        read(text, files)


def test_text_of_excel_in_another_encoding(read):
    with pytest.raises(
        BadInput, match=re.escape('0xfc in line 1. If Excel wrote it, write encoding = "cp1252"')
    ):
        read(TEXT, encoding="cp1252")
    check_rows(read(TEXT, ', units = true, encoding = "cp1252"', encoding="cp1252"))
    with pytest.raises(BadInput, match=r"must have a column `Verkürzung`"):
        # UTF-8 text that is read as cp1252 has other headers.
        read(TEXT, ', units = true, encoding = "cp1252"')
