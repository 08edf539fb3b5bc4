"""Import of a spreadsheet (.xlsx): sheets, lines above the header, and files that are none."""

import shutil
import zipfile

import numpy as np
import openpyxl
import pytest

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

    def _read(files=""):
        (tmp_path / "muscle.toml").write_text(MUSCLE)
        (tmp_path / "import.toml").write_text(SPEC.format(files=files))
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
