"""recording.csv: units, blanks, and a sentence for each way to be wrong."""

import numpy as np
import pytest

from pamjax.errors import BadInput, InputWarning
from pamjax.records.reading.table import read_table
from tests.records.conftest import HEADER

ROWS = "0,100,200,400,20,1\n1,101,199,390,,1\n2,102,198,380,,1\n"
FIRST = HEADER.strip().split(",")
LISTED = ", ".join(f"`{title}`" for title in FIRST)


def told(path, **more):
    with pytest.raises(BadInput) as error:
        read_table(path, **more)
    return str(error.value)


def test_si_and_blanks(write):
    recording = read_table(write(ROWS))
    assert recording.pressure.tolist() == [100e3, 101e3, 102e3]
    assert recording.length == pytest.approx([0.2, 0.199, 0.198], rel=1e-12)
    assert recording.diameter[0] == pytest.approx(0.02, rel=1e-12)
    assert np.isnan(recording.diameter[1:]).all()
    assert recording.row.tolist() == [2, 3, 4]
    assert recording.cycle.dtype.kind == "i"


@pytest.mark.parametrize(
    ("header", "row", "expected"),
    [
        (
            "time [min],pressure [psi],length [in],force [lbf]",
            "2,10,8,3",
            (120.0, 68947.57, 0.2032, 13.34466),
        ),
        ("Time (ms),Pressure (bar),Length (cm),Force (kN)", "2,1.5,20,0.4", (0.002, 150e3, 0.2, 400.0)),
        ("time [s],pressure [psig],length [mm],force [N]", "2,10,200,3", (2.0, 68947.57, 0.2, 3.0)),
    ],
)
def test_any_unit_of_the_right_dimension(write, header, row, expected):
    recording = read_table(write(row, header + "\n"))
    found = (recording.time, recording.pressure, recording.length, recording.force)
    assert [float(values[0]) for values in found] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("mapped", ["Load (lbf)", "Load"])
def test_a_lab_names_its_headers(write, mapped):
    path = write("100,200,3\n", "P_in [kPa],length [mm],Load (lbf)\n")
    recording = read_table(path, columns={"force": mapped, "pressure": "P_in [kPa]"})
    assert recording.force[0] == pytest.approx(3 * 4.4482216, rel=1e-7)


def test_a_mapped_header_takes_the_place_of_the_usual_one(write):
    path = write("100,200,3,4\n", "pressure [kPa],length [mm],force [N],cell 2 [N]\n")
    with pytest.warns(
        InputWarning, match="column `force \\[N\\]` of recording.csv is none that pamjax knows"
    ):
        recording = read_table(path, columns={"force": "cell 2 [N]"})
    assert recording.force.tolist() == [4.0]


def test_static_map_at_one_length(write):
    path = write("100,20\n200,20.1\n", "pressure [kPa],diameter [mm]\n")
    recording = read_table(path, default_length=0.2)
    assert not recording.has_time
    assert recording.length.tolist() == [0.2, 0.2]


def test_what_spreadsheets_add_does_no_harm(write):
    text = "\ufeff# from the bench\r\n" + HEADER.replace("\n", ",,\r\n") + ROWS.replace("\n", ",,\r\n")
    recording = read_table(write(whole=text + "\r\n,,,,,,,\r\n\r\n"))
    assert recording.row.tolist() == [3, 4, 5]


def test_a_small_zero_error_of_the_gauge_is_no_mistake(write):
    assert read_table(write(ROWS + "3,-4.9,200,1,,1\n")).pressure[-1] == -4900.0


def test_unknown_columns_are_kept_out_aloud(write):
    path = write(ROWS.replace("\n", ",warm\n"), HEADER.replace("\n", ",mood\n"))
    with pytest.warns(InputWarning) as seen:
        read_table(path)
    text = "column `mood` of recording.csv is none that pamjax knows, and was kept out."
    assert [str(one.message) for one in seen] == [text]


def test_no_file(tmp_path):
    path = tmp_path / "recording.csv"
    assert told(path) == f"there is no file {path}. Check its path."


QUOTE = "a quoted cell must end with a quotation mark in its own row; got"
CLOSE = "Close the quotation mark or take it out; inside a quoted cell write two for one."


@pytest.mark.parametrize("row", [0, 1, 2])
def test_a_cell_that_does_not_close_its_quotation_mark_is_refused(write, row):
    rows = [f"{line},warm" for line in ROWS.splitlines()]
    rows[row] = rows[row].replace("warm", '"loose, and more')
    text = told(write("\n".join(rows), HEADER.replace("\n", ",mood\n")))
    assert text == f"{QUOTE} '\"loose, and more' in column `mood`, row {row + 2} of recording.csv. {CLOSE}"


def test_a_quoted_cell_that_spans_rows_is_refused(write):
    text = told(write('0,100,200,400,20,1,"warm\nand dry"\n', HEADER.replace("\n", ",mood\n")))
    assert text == f"{QUOTE} '\"warm' in column `mood`, row 2 of recording.csv. {CLOSE}"


def test_a_quotation_mark_left_open_in_the_header_is_refused(write):
    text = told(write(ROWS, HEADER.replace(",diameter", ',"diameter')))
    assert f"{QUOTE} '\"diameter [mm],cycle' in" in text
    assert "row 1 of recording.csv" in text


@pytest.mark.filterwarnings("ignore::pamjax.errors.InputWarning")
@pytest.mark.parametrize("mood", ['"warm, dry"', '"a ""warm"" day"', '3/8" tube', '""', '"#"'])
def test_quotation_marks_that_are_closed_or_amid_a_cell_do_no_harm(write, mood):
    rows = ROWS.replace("\n", f",{mood}\n")
    recording = read_table(write('# a comment, "open\n' + HEADER.replace("\n", ",mood\n") + rows, ""))
    assert recording.row.tolist() == [3, 4, 5]
    assert recording.length == pytest.approx([0.2, 0.199, 0.198], rel=1e-12)


WHOLE = "recording.csv must hold a recording; got"
CELL = "`length` must be a finite number or blank; got"
BLANK = "Leave a cell that was not measured blank."


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ("", f"{WHOLE} a header and no row below it."),
        (
            "0,100,2x,4,,1\n",
            f"{CELL} '2x' in column `length [mm]`, row 2 of recording.csv. Write a bare number, "
            "its unit in the header; leave a cell that was not measured blank.",
        ),
        ("0,100,NaN,4,,1\n", f"{CELL} 'NaN' in column `length [mm]`, row 2 of recording.csv. {BLANK}"),
        ("0,100,-inf,4,,1\n", f"{CELL} '-inf' in column `length [mm]`, row 2 of recording.csv. {BLANK}"),
        ("0,100,1e999,4,,1\n", f"{CELL} '1e999' in column `length [mm]`, row 2 of recording.csv. {BLANK}"),
        (
            '0,100,"2,5",4,,1\n',
            f"{CELL} '2,5' in column `length [mm]`, row 2 of recording.csv. Write a decimal point: 2.5.",
        ),
        (
            ROWS + "3,100,200,400,20,1,7\n",
            "each row must have as many cells as the header (6); got 7 cells in "
            "row 5 of recording.csv. If the numbers have decimal commas, write points: 0.5, not 0,5.",
        ),
        (
            ROWS + "3,100,200\n",
            "each row must have as many cells as the header (6); got 3 cells in row 5 of "
            "recording.csv. A cell that was not measured keeps its comma.",
        ),
        (
            ROWS + "3,-5.1,200,4,,1\n",
            "`pressure` is gauge pressure and must not be below the vent's zero error "
            "(-5 kPa); got -5.1 kPa in row 5 of recording.csv. Check its sign, "
            "and that its gauge reads zero at "
            "atmosphere.",
        ),
        (
            ROWS + "3,100,0,4,,1\n",
            "`length` must be positive; got 0 mm in row 5 of recording.csv. Leave a cell "
            "that was not measured blank; check the sign and zero of the others.",
        ),
        (
            ROWS + "3,100,200,4,-20,1\n",
            "`diameter` must be positive; got -20 mm in row 5 of recording.csv. Leave "
            "a cell that was not measured blank; check the sign and zero of the others.",
        ),
        (
            ROWS + "2,100,200,4,,1\n",
            "`time` must grow from row to row; got 2 s again in row 5 of recording.csv. "
            "Give it enough digits.",
        ),
        (
            ROWS + "1.5,100,200,4,,1\n",
            "`time` must grow from row to row; got 1.5 s after 2 s in row 5 of "
            "recording.csv. Sort the rows, and let a new test go on where the last ended.",
        ),
        (
            ROWS + ",100,200,4,,1\n",
            "`time` must stand in every row; got a blank in row 5 of recording.csv. Fill "
            "it in, or leave the column out where order means nothing.",
        ),
        (
            ROWS + "3,100,200,4,,1.5\n",
            "`cycle` must be a whole number, 0 or more; got 1.5 in row 5 of "
            "recording.csv. Number the strokes 1, 2, 3.",
        ),
        (
            ROWS + "3,100,200,4,,\n",
            "`cycle` must be a whole number, 0 or more; got a blank in row 5 of "
            "recording.csv. Number the strokes 1, 2, 3.",
        ),
        (
            "0,100,200,,,1\n",
            "at least one row must have a force or a diameter beside its pressure and length; "
            "got none in recording.csv. Check which columns are blank.",
        ),
        (
            "0,,200,4,,1\n",
            "at least one row must have a pressure and a length; got none in recording.csv. Check "
            "which columns are blank.",
        ),
    ],
)
def test_a_bad_row_is_told(write, rows, text):
    assert told(write(rows)) == text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "pressure [kPa]",
            "P (bar)",
            "a recording must have a column `pressure [kPa]`; got "
            f"{LISTED.replace('pressure [kPa]', 'P (bar)')} in recording.csv. "
            f"Is it `P (bar)`? Then map it in "
            'muscle.toml: [columns] pressure = "P (bar)".',
        ),
        (
            "length [mm]",
            "lenght [mm]",
            "a recording must have a column `length [mm]`; got "
            f"{LISTED.replace('length', 'lenght')} in recording.csv. "
            f"Is it `lenght [mm]`? Then map it in muscle.toml: "
            '[columns] length = "lenght [mm]". '
            "For one fixed length, state `length` in [muscle] of muscle.toml.",
        ),
        (
            "force [N],diameter [mm]",
            "a,b",
            "a recording must have a column `force [N]`; got `time [s]`, "
            "`pressure [kPa]`, `length [mm]`, `a`, `b`, `cycle` in "
            "recording.csv. Rename its header, or map it in "
            "muscle.toml under [columns] as `force`. A recording has force, diameter, or both.",
        ),
        (
            "time [s]",
            "Force (lbf)",
            "`force` must be one column; got `Force (lbf)` and `force [N]` in "
            "recording.csv. Keep one, or map the right one in [columns].",
        ),
        (
            "[N]",
            "[kg]",
            "a force must have a unit of force; got 'kg' in column `force [kg]` of recording.csv. "
            "Use one such as N, kN or lbf.",
        ),
        (
            "force [N]",
            "force",
            "the header of `force` must state its unit; got `force` in recording.csv. Write "
            "it as `force [unit]`, with a unit such as N, kN or lbf.",
        ),
        (
            "[N]",
            "[Nuton]",
            "'Nuton' is no unit that pamjax knows (column `force [Nuton]` of recording.csv). "
            "A force is written as N, kN or lbf.",
        ),
        (
            "[kPa]",
            "[psia]",
            "`pressure` must be gauge pressure; got 'psia' in column `pressure [psia]` of "
            "recording.csv. Subtract the atmosphere's and write the unit without the `a`.",
        ),
        (
            "cycle",
            "cycle [s]",
            "`cycle` is a whole number without a unit; got 's' in column `cycle [s]` of "
            "recording.csv. Leave the unit out.",
        ),
    ],
)
def test_a_bad_header_is_told(write, old, new, text):
    assert told(write(ROWS, HEADER.replace(old, new))) == text


def test_a_mapping_that_finds_nothing_is_told(write):
    text = "`[columns] force` must be a header of recording.csv; got `forse [N]`. Did you mean `force [N]`?"
    assert told(write(ROWS), columns={"force": "forse [N]"}) == text
    text = "`forces` is no column of a recording ([columns]). Did you mean `force`?"
    assert told(write(ROWS), columns={"forces": "force [N]"}) == text


COMMAS = "the cells of recording.csv must be separated by commas; got"
SAVE = (
    "Save it with commas between the cells and points in the numbers, or import it as it is: `pamjax import`."
)


@pytest.mark.parametrize(
    ("whole", "text"),
    [
        ("", f"{WHOLE} an empty file. Write a header and a row a sample."),
        ("\r\n\n", f"{WHOLE} an empty file. Write a header and a row a sample."),
        ((HEADER + ROWS).replace(",", ";"), f"{COMMAS} semicolons in its header. {SAVE}"),
        (
            (HEADER + ROWS).replace(",", ";").replace("101", "101,5"),
            f"{COMMAS} semicolons in its header. {SAVE}",
        ),
        ((HEADER + ROWS).replace(",", "\t"), f"{COMMAS} tabs in its header. {SAVE}"),
        (
            HEADER.encode() + b"0,100,200,\xb5,,1\n",
            "recording.csv must be UTF-8 text; got the byte 0xb5 in line 2. Save it as UTF-8.",
        ),
        (b"PK\x03\x04\x00", "recording.csv must be plain text; got a binary file. Save it as UTF-8 text."),
    ],
)
def test_a_file_that_is_no_such_table_is_told(write, whole, text):
    assert told(write(whole=whole)) == text
