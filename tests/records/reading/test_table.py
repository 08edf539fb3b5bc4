"""recording.csv: units, blank cells, and error messages."""

import numpy as np
import pytest

from pamjax.errors import BadInput, InputWarning
from tests.records.conftest import HEADER
from tests.records.reading.read_table import read_table

ROWS = "0,100,200,400,20,1\n1,101,199,390,,1\n2,102,198,380,,1\n"
FIRST = HEADER.strip().split(",")
LISTED = ", ".join(f"`{title}`" for title in FIRST)


def read_error(path, **options):
    with pytest.raises(BadInput) as error:
        read_table(path, **options)
    return str(error.value)


def test_values_are_converted_to_si_and_blanks_to_nan(write):
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
def test_any_unit_of_the_right_dimension_is_accepted(write, header, row, expected):
    recording = read_table(write(row, header + "\n"))
    first_row = (recording.time, recording.pressure, recording.length, recording.force)
    assert [float(values[0]) for values in first_row] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("odd", ["3", "٣", '" 3\t"'])
def test_numbers_of_every_form_have_the_value_that_python_reads(write, odd):
    """One cell that only Python reads, as Arabic digits, has no effect on the others."""
    forms = ["0", "+1.", "1.5", "1e1", "15E-1", "00.1e+1", " 2 ", "0.1234567890123456789"]
    rows = [f"{1000 * (k + 1)},0.2,{form},{1 if k else ''}" for k, form in enumerate([*forms, odd])]
    table = read_table(write("\n".join(rows), "pressure [Pa],length [m],force [N],diameter [m]\n"))
    assert table.force.tolist() == [float(form) for form in forms] + [3.0]
    assert np.isnan(table.diameter[0])
    assert (table.diameter[1:] == 1.0).all()


def test_wrong_cell_in_a_long_column_is_found_at_once(write):
    """An ambiguous pattern would need a time that doubles with each row."""
    rows = [f"{1000 + k},0.25,{1 + k / 7:.15f}" for k in range(20_000)]
    with pytest.raises(BadInput, match="row 20002 "):
        read_table(write("\n".join([*rows, "3000,0.25,1.5.5"]), "pressure [Pa],length [m],force [N]\n"))


@pytest.mark.parametrize("mapped", ["Load (lbf)", "Load"])
def test_headers_of_a_lab_are_mapped(write, mapped):
    path = write("100,200,3\n", "P_in [kPa],length [mm],Load (lbf)\n")
    recording = read_table(path, columns={"force": mapped, "pressure": "P_in [kPa]"})
    assert recording.force[0] == pytest.approx(3 * 4.4482216, rel=1e-7)


def test_mapped_header_replaces_the_standard_one(write):
    path = write("100,200,3,4\n", "pressure [kPa],length [mm],force [N],cell 2 [N]\n")
    with pytest.warns(InputWarning, match="unknown column `force \\[N\\]` in recording.csv: ignored"):
        recording = read_table(path, columns={"force": "cell 2 [N]"})
    assert recording.force.tolist() == [4.0]


def test_static_map_at_one_length(write):
    path = write("100,20\n200,20.1\n", "pressure [kPa],diameter [mm]\n")
    recording = read_table(path, default_length=0.2)
    assert not recording.has_time
    assert recording.length.tolist() == [0.2, 0.2]


def test_additions_of_spreadsheets_are_accepted(write):
    text = "\ufeff# from the bench\r\n" + HEADER.replace("\n", ",,\r\n") + ROWS.replace("\n", ",,\r\n")
    recording = read_table(write(text=text + "\r\n,,,,,,,\r\n\r\n"))
    assert recording.row.tolist() == [3, 4, 5]


def test_small_negative_pressure_is_accepted(write):
    assert read_table(write(ROWS + "3,-4.9,200,1,,1\n")).pressure[-1] == -4900.0


def test_unknown_columns_are_ignored_with_a_warning(write):
    path = write(ROWS.replace("\n", ",warm\n"), HEADER.replace("\n", ",mood\n"))
    with pytest.warns(InputWarning) as caught:
        read_table(path)
    text = "unknown column `mood` in recording.csv: ignored."
    assert [str(warning.message) for warning in caught] == [text]


def test_missing_file_is_refused(tmp_path):
    path = tmp_path / "recording.csv"
    assert read_error(path) == f"the file {path} does not exist. Check the path."


QUOTE = "a quoted cell must end with a quotation mark in the same row; got"
CLOSE = "Close or remove the quotation mark; inside a quoted cell, double it."


@pytest.mark.parametrize("row", [0, 1, 2])
def test_unclosed_quotation_mark_is_refused(write, row):
    rows = [f"{line},warm" for line in ROWS.splitlines()]
    rows[row] = rows[row].replace("warm", '"loose, and more')
    text = read_error(write("\n".join(rows), HEADER.replace("\n", ",mood\n")))
    assert text == f"{QUOTE} '\"loose, and more' in column `mood`, row {row + 2} of recording.csv. {CLOSE}"


def test_a_quoted_cell_that_spans_rows_is_refused(write):
    text = read_error(write('0,100,200,400,20,1,"warm\nand dry"\n', HEADER.replace("\n", ",mood\n")))
    assert text == f"{QUOTE} '\"warm' in column `mood`, row 2 of recording.csv. {CLOSE}"


def test_unclosed_quotation_mark_in_the_header_is_refused(write):
    text = read_error(write(ROWS, HEADER.replace(",diameter", ',"diameter')))
    assert f"{QUOTE} '\"diameter [mm],cycle' in" in text
    assert "row 1 of recording.csv" in text


@pytest.mark.filterwarnings("ignore::pamjax.errors.InputWarning")
@pytest.mark.parametrize("mood", ['"warm, dry"', '"a ""warm"" day"', '3/8" tube', '""', '"#"'])
def test_closed_quotation_marks_are_accepted(write, mood):
    rows = ROWS.replace("\n", f",{mood}\n")
    recording = read_table(write('# a comment, "open\n' + HEADER.replace("\n", ",mood\n") + rows, ""))
    assert recording.row.tolist() == [3, 4, 5]
    assert recording.length == pytest.approx([0.2, 0.199, 0.198], rel=1e-12)


NO_ROWS = "recording.csv must contain a recording; got"
CELL = "`length` must be a finite number or blank; got"
BLANK = "Leave the cell blank if it was not measured."


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ("", f"{NO_ROWS} a header without rows. Write one row for each sample."),
        (
            "0,100,2x,4,,1\n",
            f"{CELL} '2x' in column `length [mm]`, row 2 of recording.csv. Write a number "
            f"here and the unit in the header. {BLANK}",
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
            "row 5 of recording.csv. Write 0.5 instead of 0,5, or import the file with `pamjax import`.",
        ),
        (
            ROWS + "3,100,200\n",
            "each row must have as many cells as the header (6); got 3 cells in row 5 of "
            "recording.csv. Write a comma also for a blank cell.",
        ),
        (
            ROWS + "3,-5.1,200,4,,1\n",
            "`pressure` must be gauge pressure, and not below the permitted zero error "
            "(-5 kPa); got -5.1 kPa in row 5 of recording.csv. Check its sign. "
            "The sensor must read zero at atmospheric pressure.",
        ),
        (
            ROWS + "3,100,0,4,,1\n",
            "`length` must be positive; got 0 mm in row 5 of recording.csv. Leave the cell "
            "blank if it was not measured. Otherwise check its sign and zero.",
        ),
        (
            ROWS + "3,100,200,4,-20,1\n",
            "`diameter` must be positive; got -20 mm in row 5 of recording.csv. Leave "
            "the cell blank if it was not measured. Otherwise check its sign and zero.",
        ),
        (
            ROWS + "2,100,200,4,,1\n",
            "`time` must increase from row to row; got 2 s twice in row 5 of recording.csv. "
            "Delete one of the two rows, or write more digits.",
        ),
        (
            ROWS + "10:00:02.5,100,200,4,,1\n",
            "`time` must be a finite number or blank; got '10:00:02.5' in column `time [s]`, row 5"
            " of recording.csv. Write seconds, or import the file with `pamjax import`, which"
            " reads clock times.",
        ),
        (
            ROWS + "1.5,100,200,4,,1\n",
            "`time` must increase from row to row; got 1.5 s after 2 s in row 5 of "
            "recording.csv. Sort the rows. Continue the time of a new test after the last one.",
        ),
        (
            ROWS + ",100,200,4,,1\n",
            "`time` must have a value in every row; got a blank in row 5 of recording.csv. Add "
            "the value, or remove the column if the order of rows has no meaning.",
        ),
        (
            ROWS + "3,100,200,4,,1.5\n",
            "`cycle` must be a whole number from 0 to 1000000000; got 1.5 in row 5 of "
            "recording.csv. Number the strokes 1, 2, 3.",
        ),
        (
            ROWS + "3,100,200,4,,\n",
            "`cycle` must be a whole number from 0 to 1000000000; got a blank in row 5 of "
            "recording.csv. Number the strokes 1, 2, 3.",
        ),
        (
            "0,100,200,,,1\n",
            "at least one row must have pressure, length, and force or diameter; "
            "got none in recording.csv. Check for blank columns.",
        ),
        (
            "0,,200,4,,1\n",
            "at least one row must have pressure and length; got none in recording.csv. Check "
            "for blank columns.",
        ),
    ],
)
def test_invalid_row_is_refused(write, rows, text):
    assert read_error(write(rows)) == text


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "pressure [kPa]",
            "P (bar)",
            "a recording must have a column `pressure [kPa]`; got "
            f"{LISTED.replace('pressure [kPa]', 'P (bar)')} in recording.csv. "
            f"If it is `P (bar)`, map it in "
            'muscle.toml: [columns] pressure = "P (bar)".',
        ),
        (
            "length [mm]",
            "lenght [mm]",
            "a recording must have a column `length [mm]`; got "
            f"{LISTED.replace('length', 'lenght')} in recording.csv. "
            f"If it is `lenght [mm]`, map it in muscle.toml: "
            '[columns] length = "lenght [mm]". '
            "For a fixed length, state `length` in [muscle] of muscle.toml.",
        ),
        (
            "time [s]",
            "Test 3,,,,,\ntime [s]",
            "a recording must have a column `pressure [kPa]`; got `Test 3` in recording.csv. If the headers"
            " follow below, delete the lines above them, or begin these lines with #.",
        ),
        (
            "force [N],diameter [mm]",
            "a,b",
            "a recording must have a column `force [N]`; got `time [s]`, "
            "`pressure [kPa]`, `length [mm]`, `a`, `b`, `cycle` in "
            "recording.csv. Rename its header, or map it as `force` in "
            "[columns] of muscle.toml. A recording must have force, diameter, or both. If the length was "
            'measured at a set force, write [test] measured = "length" in muscle.toml.',
        ),
        (
            "time [s]",
            "Force (lbf)",
            "only one column can be `force`; got `Force (lbf)` and `force [N]` in "
            "recording.csv. Remove one, or map the correct one in [columns] of muscle.toml.",
        ),
        (
            "[N]",
            "[kg]",
            "a force must have a unit of force; got 'kg' in column `force [kg]` of recording.csv. "
            "Use one such as N, kN or lbf. The weight of 1 kg is 9.81 N.",
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
            "unknown unit 'Nuton' (column `force [Nuton]` of recording.csv). Did you mean `newton`?",
        ),
        (
            "[kPa]",
            "[psia]",
            "`pressure` must be gauge pressure; got 'psia' in column `pressure [psia]` of "
            "recording.csv. Subtract the atmospheric pressure, and write the unit without the `a`.",
        ),
        (
            "cycle",
            "cycle [s]",
            "`cycle` must be a whole number without a unit; got 's' in column `cycle [s]` of "
            "recording.csv. Remove the unit.",
        ),
    ],
)
def test_invalid_header_is_refused(write, old, new, text):
    assert read_error(write(ROWS, HEADER.replace(old, new))) == text


def test_mapping_of_a_missing_column_is_refused(write):
    text = "`[columns] force` must be a header of recording.csv; got `forse [N]`. Did you mean `force [N]`?"
    assert read_error(write(ROWS), columns={"force": "forse [N]"}) == text
    text = "unknown channel `forces` ([columns]). Did you mean `force`?"
    assert read_error(write(ROWS), columns={"forces": "force [N]"}) == text


COMMAS = "the cells of recording.csv must be separated by commas; got"
SAVE = "Save it with commas between cells and with decimal points, or use `pamjax import`."


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", f"{NO_ROWS} an empty file. Write a header, and one row for each sample."),
        ("\r\n\n", f"{NO_ROWS} an empty file. Write a header, and one row for each sample."),
        ((HEADER + ROWS).replace(",", ";"), f"{COMMAS} semicolons in the header. {SAVE}"),
        (
            (HEADER + ROWS).replace(",", ";").replace("101", "101,5"),
            f"{COMMAS} semicolons in the header. {SAVE}",
        ),
        ((HEADER + ROWS).replace(",", "\t"), f"{COMMAS} tabs in the header. {SAVE}"),
        (
            HEADER.encode() + b"0,100,200,\xb5,,1\n",
            "recording.csv must be UTF-8 text; got the byte 0xb5 in line 2. Save it as UTF-8.",
        ),
        (
            b"PK\x03\x04\x00",
            "recording.csv must be plain text; got a spreadsheet or an archive."
            " Export the sheet as CSV, or name it in the TOML file of `pamjax import`.",
        ),
        (b"a\x00", "recording.csv must be plain text; got a binary file. Save it as UTF-8 text."),
    ],
)
def test_file_of_another_format_is_refused(write, content, text):
    assert read_error(write(text=content)) == text
