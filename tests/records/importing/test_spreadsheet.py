"""Import of a spreadsheet (.xlsx): sheets, lines above the header, and files that are none."""

import shutil
import zipfile

import numpy as np
import openpyxl
import pytest
from openpyxl.chart import BarChart

from pamjax.errors import BadInput
from pamjax.records.importing import spreadsheet
from pamjax.records.importing.importer import import_case

MUSCLE = """\
[muscle]
rest_length = "443 mm"
diameter = "20 mm"
braid_angle = "65 deg"

[test]
measured = "length"
"""
SPEC = """\
muscle = "muscle.toml"
files = {{{files}}}
columns = {{pressure = {{column = "P", unit = "psi"}}, length = "Length [in]"}}
tests = [{{file = "free.xlsx"}}]
"""
#: Pressure, psi, and length, in.
ROWS = [[0, 17.44], [5, 17.09], [10, 16.61], [15, 16.34]]


@pytest.fixture
def read(tmp_path):
    """Import a file, and return its recording."""

    def _read(files="", column="P"):
        (tmp_path / "muscle.toml").write_text(MUSCLE)
        (tmp_path / "import.toml").write_text(SPEC.format(files=files).replace('"P"', f'"{column}"'))
        return import_case(tmp_path / "import.toml", tmp_path / "case").case.recording

    return _read


def write(path, rows, sheet="free", above=()):
    """Write one sheet with a header, behind a sheet of notes."""
    book = openpyxl.Workbook()
    book.active.title = "notes"
    book.active.append(["a hose of 2021"])
    table = book.create_sheet(sheet, 0)
    for row in [*above, ["P", "Length [in]", None, "remark"], *rows]:
        table.append(row)
    book.save(path)


def test_the_first_sheet_is_read(read, tmp_path):
    write(tmp_path / "free.xlsx", ROWS)
    recording = read()
    assert recording.measures_length
    np.testing.assert_allclose(recording.pressure, np.array(ROWS)[:, 0] * 6894.757, atol=1.0)
    np.testing.assert_allclose(recording.length, np.array(ROWS)[:, 1] * 0.0254, atol=1e-6)


def test_another_sheet_and_lines_above_the_header(read, tmp_path):
    write(tmp_path / "free.xlsx", ROWS, "muscle 2", above=[["bench 2"], ["Peter", "Monday"]])
    assert read('sheet = "muscle 2", skip = 2').n == len(ROWS)


def test_a_formula_without_saved_value_is_blank_and_a_text_names_its_row(read, tmp_path):
    write(tmp_path / "free.xlsx", [*ROWS, [20, "=B4*1"]])
    assert np.isnan(read().length[-1])
    write(tmp_path / "free.xlsx", [*ROWS, ["about 20", 16]])
    shutil.rmtree(tmp_path / "case")
    with pytest.raises(BadInput, match=r"only numbers or blanks; got 'about 20' in row 6 of free\.xlsx"):
        read()


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ('sheet = "frea"', "free.xlsx must have a sheet `frea`; got none in [files]. Did you mean `free`?"),
        ("skip = 50", "sheet `free` of free.xlsx must contain rows of numbers; got none."),
    ],
)
def test_a_missing_table_is_one_sentence(read, tmp_path, files, message):
    write(tmp_path / "free.xlsx", ROWS)
    with pytest.raises(BadInput) as error:
        read(files)
    assert message in str(error.value)


def test_a_file_that_is_no_spreadsheet_is_refused(read, tmp_path, monkeypatch):
    path = tmp_path / "free.xlsx"
    write(path, ROWS)
    whole = path.read_bytes()
    for damaged in (b"P,Length\n1,2\n", whole[: len(whole) // 2], b""):
        path.write_bytes(damaged)
        with pytest.raises(BadInput, match=r"free\.xlsx must be a spreadsheet \(\.xlsx\); got a damaged or"):
            read()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("notes.txt", "no sheets")
    with pytest.raises(BadInput, match="got a damaged file"):
        read()
    write(path, ROWS)
    monkeypatch.setattr(spreadsheet, "_MAX_UNPACKED_BYTES", 100)
    with pytest.raises(BadInput, match="a file that unpacks to"):
        read()
    assert not (tmp_path / "case").exists()


def write_notes_first(path, notes):
    """Write a sheet of notes in front of the table."""
    book = openpyxl.Workbook()
    book.active.title = "notes"
    for row in notes:
        book.active.append(row)
    table = book.create_sheet("muscle 2")
    for row in [["P", "Length [in]"], *ROWS]:
        table.append(row)
    book.save(path)


@pytest.mark.parametrize("files", ["", "skip = 1", "units = true", "header = false, skip = 3"])
@pytest.mark.parametrize("notes", [[], [["a hose of 2021"]]])
def test_first_sheet_without_a_table_names_the_sheets(read, tmp_path, notes, files):
    write_notes_first(tmp_path / "free.xlsx", notes)
    with pytest.raises(BadInput) as error:
        read(files)
    assert str(error.value) == (
        "sheet `notes` of free.xlsx must contain rows of numbers; got none."
        ' The file has the sheets `notes`, `muscle 2`; write, for example, sheet = "muscle 2" in [files].'
    )


def test_first_sheet_with_several_notes_names_the_sheets(read, tmp_path):
    write_notes_first(tmp_path / "free.xlsx", [["hose", None], ["made in", "2021"]])
    with pytest.raises(BadInput, match="must have a column `P`; got none") as error:
        read()
    assert str(error.value).endswith(
        "Valid names are `hose`. The file has the sheets `notes`, `muscle 2`;"
        ' write, for example, sheet = "muscle 2" in [files].'
    )


def test_chart_before_the_table_is_no_sheet(read, tmp_path):
    write(tmp_path / "free.xlsx", ROWS)
    book = openpyxl.load_workbook(tmp_path / "free.xlsx")
    book.create_chartsheet("chart", 0).add_chart(BarChart())
    book.save(tmp_path / "free.xlsx")
    assert read().n == len(ROWS)


@pytest.mark.parametrize(
    ("above", "column", "remedy"),
    [
        ([["bench 2"], ["Peter", "Monday"]], "P", "Line 3 has it: write skip = 2 in [files]."),
        ([["bench 2"]], "Druck", "The header seems to be in row 2: write skip = 1 in [files]."),
        ([["bench 2"], [], ["at", "noon"]], "Druck", "The header seems to be in row 4: write skip = 3 in"),
    ],
)
def test_lines_above_the_header_are_named(read, tmp_path, above, column, remedy):
    write(tmp_path / "free.xlsx", ROWS, above=above)
    with pytest.raises(BadInput) as error:
        read(column=column)
    message = str(error.value)
    assert message.startswith(f"free.xlsx must have a column `{column}`; got none. {remedy}")
    assert "Unnamed" not in message


def test_column_without_header_is_no_valid_name(read, tmp_path):
    write(tmp_path / "free.xlsx", [[*row, 1] for row in ROWS])
    with pytest.raises(BadInput, match="Valid names are `P`, `Length \\[in\\]`, `remark`") as error:
        read(column="Druck")
    assert "Unnamed" not in str(error.value)


def test_number_without_a_limit_is_refused_with_its_row(read, tmp_path):
    write(tmp_path / "made.xlsx", [*ROWS, [20, 12345]])
    with zipfile.ZipFile(tmp_path / "made.xlsx") as made, zipfile.ZipFile(tmp_path / "free.xlsx", "w") as out:
        for entry in made.namelist():
            out.writestr(entry, made.read(entry).replace(b"<v>12345</v>", b"<v>%s</v>" % (b"9" * 400)))
    with pytest.raises(
        BadInput, match=r"`length` must be at most 1e\+30 in SI units; got .* in row 6 of free"
    ):
        read()
