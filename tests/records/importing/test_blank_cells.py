"""Texts and formulas that an import reads as blank: each is named in a note, or refused."""

from zipfile import ZipFile

import openpyxl
import pytest

from tests.records.importing.conftest import PLAIN

TIMED = PLAIN + '\ntime = {column = "t", unit = "s"}'
SAVE = "Open the file in a spreadsheet program and save it, so that values are stored."


def write_sheet(path, header, rows):
    book = openpyxl.Workbook()
    for row in [header, *rows]:
        book.active.append(row)
    book.save(path)


@pytest.mark.parametrize(
    "mark", ["n/a", "NA", "-", "--", "?", "NaN", "null", "#N/A", "#DIV/0!", "#NV", "#WERT!", "-1.#IND"]
)
def test_text_for_a_missing_value_is_named(import_rig, mark):
    result = import_rig(f"P,Load [lbf]\n10,5\n20,{mark}\n30,\n40,{mark}\n50,12\n", columns=PLAIN)
    note = (
        "column `Load [lbf]`: text instead of a number in 2 cells, read as not measured"
        f" (first: '{mark}' in row 3 of run.csv)."
    )
    assert result.notes == (note,)
    assert f"  note: {note}" in str(result)
    assert "3 rows without force" in str(result)
    assert result.as_dict()["warnings"] == [note]


def test_blank_cells_have_no_note(import_rig):
    assert import_rig("P,Load [lbf]\n10,5\n20,\n30,12\n", columns=PLAIN).notes == ()


def test_text_in_a_column_without_use_has_no_note(import_rig):
    assert import_rig("P,Load [lbf],x\n10,5,n/a\n20,8,-\n30,12,\n", columns=PLAIN).notes == ()


@pytest.mark.parametrize("text", ["about 5", "#5", "5 N", "+-5"])
def test_other_text_is_refused(refuse, text):
    message = refuse(f"P,Load [lbf]\n10,5\n20,{text}\n", columns=PLAIN)
    assert message.startswith(
        f"column `Load [lbf]` must contain only numbers or blanks; got '{text}' in row 3 of run.csv."
    )


def test_notes_of_several_files_are_one(import_rig, tmp_path):
    for name, cell in (("a1.csv", "7"), ("a2.csv", "n/a"), ("a3.csv", "-")):
        (tmp_path / name).write_text(f"P,Load [lbf]\n10,5\n20,{cell}\n30,9\n")
    (note,) = import_rig(None, file='"a*.csv"', columns=PLAIN).notes
    assert note == (
        "column `Load [lbf]`: text instead of a number in 2 cells in 2 files, read as not measured"
        " (first: 'n/a' in row 3 of a2.csv)."
    )


def test_text_in_a_column_with_decimal_commas(import_rig):
    result = import_rig(
        "P;Load [lbf]\n1.000,5;5\nn.a.;6\n20;7\n",
        columns=PLAIN,
        files='separator = ";"\ndecimal = ","\nthousands = "."',
    )
    assert (
        "text instead of a number in 1 cell, read as not measured (first: 'n.a.' in row 3" in result.notes[0]
    )
    assert result.case.recording.pressure[0] == pytest.approx(1000.5 * 6894.757, rel=1e-6)


def test_errors_and_formulas_of_a_spreadsheet_are_named(import_rig, tmp_path):
    rows = [[10, 5], [20, "#DIV/0!"], [30, "=B2*2"], [40, "=B2*3"], [50, "n/a"], [60, None], [70, 15]]
    write_sheet(tmp_path / "run.xlsx", ["P", "Load [lbf]"], rows)
    result = import_rig(None, file='"run.xlsx"', columns=PLAIN)
    assert result.notes == (
        "column `Load [lbf]`: formulas without a stored value in 2 cells, read as not measured"
        f" (first: row 4 of run.xlsx). {SAVE}",
        "column `Load [lbf]`: text instead of a number in 2 cells, read as not measured"
        " (first: '#DIV/0!' in row 3 of run.xlsx).",
    )
    assert "5 rows without force" in str(result)


@pytest.mark.parametrize("name", ["time", "cycle"])
@pytest.mark.parametrize(
    ("cell", "got", "remedy"),
    [
        ("n/a", "'n/a'", "Write the number, or delete the row."),
        ("=A2+1", "a formula without a stored value", SAVE),
    ],
)
def test_channel_that_needs_every_row_refuses_them(refuse, tmp_path, name, cell, got, remedy):
    write_sheet(tmp_path / "run.xlsx", ["t", "P", "Load [lbf]"], [[0, 10, 5], [cell, 20, 6], [2, 30, 7]])
    columns = TIMED if name == "time" else PLAIN + '\ncycle = "t"'
    assert refuse(None, file='"run.xlsx"', columns=columns) == (
        f"`{name}` must have a number in every row; got {got} in row 3 of run.xlsx. {remedy}"
    )


def test_column_of_formulas_only_is_explained(refuse, tmp_path):
    write_sheet(tmp_path / "run.xlsx", ["P", "Load [lbf]"], [[10 * k, f"=A{k}*2"] for k in range(2, 6)])
    message = refuse(None, file='"run.xlsx"', columns=PLAIN)
    assert message == (
        "column `Load [lbf]` of run.xlsx must have a number; got only formulas without a stored value."
        f" {SAVE}"
    )


def test_column_of_texts_only_is_explained(refuse):
    message = refuse("P,Load [lbf]\n10,n/a\n20,n/a\n30,-\n", columns=PLAIN)
    assert message.startswith("the case of rig.toml is invalid and was not written: a recording must have")
    assert message.endswith(
        "Note: column `Load [lbf]`: text instead of a number in 3 cells, read as not measured"
        " (first: 'n/a' in row 2 of run.csv)."
    )


def test_formula_whose_stored_value_is_an_empty_text_is_blank(import_rig, tmp_path):
    write_sheet(tmp_path / "made.xlsx", ["P", "Load [lbf]"], [[10, 5], [20, '=IF(A2>5,"",1)'], [30, 7]])
    with ZipFile(tmp_path / "made.xlsx") as made, ZipFile(tmp_path / "run.xlsx", "w") as saved:
        for entry in made.namelist():
            text = made.read(entry)
            saved.writestr(entry, text.replace(b'<c r="B3">', b'<c r="B3" t="str">'))
    result = import_rig(None, file='"run.xlsx"', columns=PLAIN)
    assert "1 row without force" in str(result)
    assert result.notes == ()
