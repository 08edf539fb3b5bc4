"""Imports that are refused: one sentence with rule, value, place and remedy, and nothing is written."""

import pytest

from pamjax.errors import BadInput
from pamjax.records.importing.importer import import_case
from tests.records.importing.conftest import PLAIN


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"text": "P,Load [lbf]\n1,2\n3,much\n"},
            "must contain only numbers or blanks; got 'much' in row 3 of run.csv.",
        ),
        (
            {"text": "P,Load\n1,2\n"},
            "run.csv must have a column `Load [lbf]`; got none. Valid names are `P`, `Load`.",
        ),
        ({"text": "P;Load [lbf]\n1;2\n"}, "must be separated by ','. Write separator = \";\" in [files]."),
        (
            {"text": "P;Load [lbf]\n1,5;2,5\n"},
            'Write separator = ";" and decimal = "," in [files].',
        ),
        (
            {"text": "P;Load [lbf]\n1,5;2,5\n", "files": 'separator = ";"'},
            """got '2,5' in row 2 of run.csv. If "," is the decimal mark, write decimal = "," in [files].""",
        ),
        (
            {"text": "Test 3,\n,\nP,Load [lbf]\n1,2\n"},
            "run.csv must have a column `Load [lbf]`; got none. Line 3 has it: write skip = 2 in [files].",
        ),
        (
            {"text": "P,Load [lbf]\n1,2,3,4\n"},
            "run.csv must be a table; got rows with more cells than the header",
        ),
        ({"text": "P,Load [lbf]\n"}, "run.csv must contain rows of numbers"),
        ({"columns": PLAIN + "\nlenght = 3"}, "Did you mean `length`?"),
        ({"columns": PLAIN.replace("psi", "mm")}, "a pressure must have a unit of pressure; got 'mm'"),
        (
            {"columns": 'force = {column = 9, unit = "N"}\npressure = "P [psi]"'},
            "must have a column 9; got 2 columns.",
        ),
        (
            {"length": ""},
            "`length` must be a column or stated for the test; got neither in test 1 of [[tests]].",
        ),
        ({"length": 'pressure = "1 bar"'}, "stated for the test; got both in test 1"),
        ({"length": 'lenght = "1 mm"'}, "Did you mean `length`?"),
        ({"file": '"nothing*.csv"'}, "got no match for nothing*.csv"),
        (
            {"muscle": "mine.toml"},
            "path of a muscle.toml; got mine.toml in rig.toml. Check the path, or create one with",
        ),
        ({"files": "header = maybe"}, "rig.toml must be TOML"),
        (
            {"files": 'separator = "|"'},
            """`separator` must be ",", ";", "tab" or "space"; got '|' in [files] of rig""",
        ),
        ({"files": "skip = -1"}, "`skip` must be at least 0; got -1 in [files] of rig.toml."),
        ({"files": "header = 3"}, "`header` must be true or false; got 3 in [files] of rig.toml."),
        (
            {"files": "seperator = 3"},
            "unknown entry `seperator` ([files] of rig.toml). Did you mean `separator`",
        ),
        (
            {"columns": PLAIN.replace('"P"', "0")},
            "`column` must be at least 1; got 0 in [columns] of rig.toml.",
        ),
        (
            {"columns": 'force = {unit = "N"}'},
            "`column` must be stated ([columns] of rig.toml). Write the header or the number",
        ),
        (
            {"length": "interval = 3"},
            "unknown entry `interval` ([[tests]] of rig.toml). Valid names are `file`, `length`",
        ),
        ({"file": "3"}, "`file` must be a text in quotes; got 3 in [[tests]] of rig.toml."),
        (
            {"more": '[tare]\nforce = "0 N"'},
            "`end` must be stated ([tare] of rig.toml). Write the end of the tare interval.",
        ),
        ({"files": 'rate = "500 N"'}, "[files] rate"),
        ({"more": '[tare]\nend = "1 s"\nforce = "0 N"'}, "[tare] needs the time of each row"),
        (
            {
                "text": "P,Load [lbf]\n10,\n20,11\n30,12\n",
                "files": 'rate = "1 Hz"',
                "more": '[tare]\nend = "0.5 s"\nforce = "0 N"',
            },
            "`force` must be measured in the interval of [tare]; got no value from 0 to 0.5 s in ",
        ),
        (
            {"length": 'length = "2 m"'},
            "was not written: the longest `length` must be near the rest length (132 mm)",
        ),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_invalid_import_is_refused_and_writes_nothing(refuse, change, message):
    options = {"text": "P,Load [lbf]\n10,5\n20,11\n", "columns": PLAIN} | change
    assert message in refuse(**options)


@pytest.mark.parametrize(
    "content", [b"P,Load [lbf]\n10,5\n", "Kräfte\n".encode("cp1252"), b"PK\3\4", b"1,2\n" * 300_000]
)
def test_recording_instead_of_its_description_is_named_in_the_remedy(content, tmp_path):
    path = tmp_path / "bench 2.csv"
    path.write_bytes(content)
    with pytest.raises(BadInput) as error:
        import_case(path, tmp_path / "case")
    assert str(error.value) == (
        "`pamjax import` needs a TOML file that describes the recording; got bench 2.csv. Name the recording"
        ' in a TOML file with the lines muscle = "muscle.toml", columns = {force = "Load [N]", …} and'
        ' tests = [{file = "bench 2.csv"}].'
    )


def test_description_in_another_encoding_is_named(tmp_path):
    (tmp_path / "rig.toml").write_bytes('muscle = "Kräfte.toml"'.encode("cp1252"))
    with pytest.raises(BadInput, match=r"rig\.toml must be UTF-8 text"):
        import_case(tmp_path / "rig.toml", tmp_path / "case")


@pytest.mark.parametrize("header", ["Load", "Load [kN]"])
def test_unit_error_has_the_unit_of_the_rig(header, refuse):
    unit = "" if "kN" in header else ', unit = "kN"'
    columns = f'force = {{column = "Load"{unit}}}\npressure = {{column = "P", unit = "kPa"}}'
    message = refuse(f"P,{header}\n100,60\n200,120\n300,180\n", columns=columns)
    assert "Probable cause: force in N under a header of kN. Otherwise" in message


@pytest.mark.parametrize(("separator", "mark"), [(",", ","), (";", ";"), ("tab", "\t"), ("space", " ")])
def test_unclosed_quotation_mark_is_refused(rig, separator, mark):
    rows = 'P,other,Load\n10,x,5\n20,y,11\n30,"loose,12\n40,z,13\n'.replace(",", mark)
    columns = PLAIN.replace('"Load [lbf]"', '{column = "Load", unit = "lbf"}')
    with pytest.raises(BadInput) as error:
        rig(rows, columns=columns, files=f'separator = "{separator}"')
    assert str(error.value).startswith(
        "a quoted cell must end with a quotation mark in the same row; got '\"loose"
    )
    assert "in column `other`, row 4 of run.csv. Close or remove the quotation mark" in str(error.value)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ('contraction = {column = "x", unit = "mm"}', "a contraction is a ratio"),
        ('contraction = "x"', "`contraction` needs a unit"),
        ('shortening = {column = "x", unit = "%"}', "unknown unit '%'"),
        ('length = "x [mm]"\nshortening = "x [mm]"', "the length must have one column"),
    ],
)
def test_bad_columns_of_the_length_are_named(refuse, columns, message):
    columns += '\npressure = "p [kPa]"\nforce = "F [N]"'
    text = "x,p [kPa],F [N]\n0,100,50\n10,200,60\n25,300,40\n"
    assert message in refuse(text, columns=columns, length="")
