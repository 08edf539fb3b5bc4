"""Notes on rows of a rig's file that end before the last used column."""

import numpy as np
import pytest

COLUMNS = 'pressure = "P [kPa]"\nforce = "F [N]"\n'
ROWS = ["P [kPa],F [N],test", "100,30,a", "200,65,b", "300,100,c"]


def _import(import_rig, rows, **options):
    return import_rig("\n".join([*rows, ""]), columns=COLUMNS, **options)


def test_row_that_was_cut_is_named(import_rig):
    result = _import(import_rig, [*ROWS[:2], "200", ROWS[3]])
    (note,) = result.notes
    assert note == (
        "row 3 of run.csv has 1 of 3 cells: the missing cells are read as not measured."
        " If the file is incomplete, copy it again."
    )
    assert np.isnan(result.case.recording.force).tolist() == [False, True, False]
    assert f"note: {note}" in str(result)


@pytest.mark.parametrize(("short", "text"), [(1, "1 more row lacks cells"), (2, "2 more rows lack cells")])
def test_more_rows_are_counted(short, text, import_rig):
    result = _import(import_rig, [*ROWS, "400", *["500"] * short, "600,200,d"])
    assert result.notes[0].startswith(f"row 5 of run.csv has 1 of 3 cells, and {text}: ")


@pytest.mark.parametrize(
    "rows",
    [
        ROWS,
        [f"{row}," for row in ROWS[:1]] + ROWS[1:],
        [row.rpartition(",")[0] if k else row for k, row in enumerate(ROWS)],
        [*ROWS[:2], '200,65,"b,b"', ROWS[3]],
        [*ROWS, "", ""],
    ],
    ids=["complete", "empty header", "unused column", "quoted mark", "blank lines"],
)
def test_complete_rows_have_no_note(rows, import_rig):
    assert _import(import_rig, rows).notes == ()


def test_cells_between_spaces_are_counted(import_rig):
    rows = ["P F", "100  30", " 200 65", "300"]
    columns = 'pressure = {column = "P", unit = "kPa"}\nforce = {column = "F", unit = "N"}'
    result = import_rig("\n".join(rows), columns=columns, files='separator = "space"')
    assert result.notes[0].startswith("row 4 of run.csv has 1 of 2 cells: ")
