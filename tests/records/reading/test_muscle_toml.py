"""muscle.toml: both forms of the braid, all forms of the stiffness, and error messages."""

import math

import pytest

from pamjax.errors import BadInput
from pamjax.records.reading.muscle_toml import (
    Bladder,
    MeasuredValue,
    Sensors,
    describe_unused_bladder,
    parse_muscle_toml,
    read_muscle_toml,
)
from tests.records.conftest import MUSCLE

ANGLED = """\
[muscle]
rest_length = {value = "132 mm", sd = "1 mm"}
diameter = {value = "11.8 mm", sd = "0.9 mm"}
braid_angle = {value = "61.4 deg", sd = "1 deg"}
"""
BRAID = (
    "[muscle] must state the braid as `thread_length` and `turns`, or as `braid_angle` and `diameter`; got"
)


def read(text):
    return read_muscle_toml(text.encode())


def read_error(text):
    with pytest.raises(BadInput) as error:
        read(text)
    return str(error.value)


def test_a_counted_braid():
    muscle_toml = read(MUSCLE + 'threads = 144\nthread_area = "0.0858 mm^2"\n[thread]\nmodulus = "112 GPa"\n')
    assert muscle_toml.name == "test muscle"
    assert muscle_toml.rest_length == MeasuredValue(pytest.approx(0.2, rel=1e-12), 0.0)
    assert muscle_toml.thread_length == MeasuredValue(
        pytest.approx(0.214, rel=1e-12), pytest.approx(5e-4, rel=1e-12)
    )
    assert muscle_toml.turns == MeasuredValue(1.2, 0.0)
    assert muscle_toml.threads == 144
    assert muscle_toml.thread_area == MeasuredValue(pytest.approx(8.58e-8, rel=1e-12))
    assert muscle_toml.modulus == MeasuredValue(pytest.approx(112e9, rel=1e-12))
    assert (muscle_toml.braid_angle, muscle_toml.diameter, muscle_toml.stiffness, muscle_toml.bladder) == (
        None,
    ) * 4
    assert muscle_toml.sensors == Sensors()
    assert muscle_toml.braid == (pytest.approx(0.214, rel=1e-12), 1.2)


def test_the_two_forms_of_the_braid_determine_each_other():
    muscle_toml = read(ANGLED)
    thread_length, turns = muscle_toml.braid
    assert thread_length * math.sin(math.radians(61.4)) == pytest.approx(0.132, rel=1e-12)
    radius = math.sqrt(thread_length**2 - 0.132**2) / (2 * math.pi * turns)
    assert 2 * radius == pytest.approx(0.0118, rel=1e-12)


def test_dotted_tables_are_equivalent():
    dotted = MUSCLE.replace('thread_length = {value = "214 mm", sd = "0.5 mm"}\n', "")
    dotted += '[muscle.thread_length]\nvalue = "214 mm"\nsd = "0.5 mm"\n'
    assert read(dotted) == read(MUSCLE)


def test_byte_order_mark_and_windows_line_ends_are_accepted():
    assert read("\ufeff" + MUSCLE.replace("\n", "\r\n")) == read(MUSCLE)


@pytest.mark.parametrize(
    ("thread", "stated", "expected"),
    [
        ("", "", "inelastic"),
        ('[thread]\nstiffness = "1.4 MN"\n', "", "elastic"),
        ('[thread]\nstiffness = "1.4 MN"\n', '[baseline]\nmodel = "inelastic"\n', "inelastic"),
        ("", '[baseline]\nmodel = "elastic"\n', "elastic"),
    ],
)
def test_baseline_table_defines_the_baseline_model(thread, stated, expected):
    assert read(MUSCLE + thread + stated).baseline == expected


def test_bladder_sensors_and_columns():
    muscle_toml = read(
        MUSCLE
        + '[bladder]\ninner_diameter = "19 mm"\nmodulus = {value = "1.2 MPa", sd = "0.3 MPa"}\n'
        + '[sensors]\nforce = "2 N"\npressure = {sd = "0.7 kPa"}\nlength = {sd = "1 mm", per = "setting"}\n'
        + '[columns]\nforce = "Load (lbf)"\n'
    )
    assert muscle_toml.bladder == Bladder(MeasuredValue(0.019), None, MeasuredValue(1.2e6, 0.3e6))
    assert muscle_toml.sensors == Sensors(force=2.0, pressure=700.0, length=1e-3, length_per_level=True)
    assert muscle_toml.columns == {"force": "Load (lbf)"}


def test_single_length_is_also_the_rest_length():
    muscle_toml = read(MUSCLE.replace("rest_length", "length"))
    assert muscle_toml.length == pytest.approx(0.2, rel=1e-12)
    assert muscle_toml.rest_length == MeasuredValue(pytest.approx(0.2, rel=1e-12))


def test_mapping_is_accepted():
    document = {"muscle": {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2}}
    assert parse_muscle_toml(document).braid == (pytest.approx(0.214, rel=1e-12), 1.2)


def test_invalid_toml_is_refused():
    assert read_error("[muscle]\nname = Kevlar\n") == (
        "muscle.toml must be TOML; got invalid value (at line 2, column 8). Write a text in double quotes, "
        "and a table name in [brackets]."
    )


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "turns",
            "truns",
            "unknown entry `truns` ([muscle] of muscle.toml). Did you mean `turns`?",
        ),
        ("[muscle]", "[muscel]", "muscle.toml must have a table [muscle]. It describes the muscle."),
        (
            "[muscle]",
            "[therad]\n[muscle]",
            "unknown table [therad] in muscle.toml. Did you mean `thread`?",
        ),
        (
            "rest_length",
            "# ",
            "[muscle] must state `rest_length`; got none in muscle.toml. Write the length between the "
            'fittings at rest: rest_length = "235 mm".',
        ),
        ("turns", "# ", f"{BRAID} `thread_length` in muscle.toml. Add the missing entry."),
        (
            "turns = 1.2",
            'diameter = "20 mm"',
            f"{BRAID} `thread_length` and `diameter` in muscle.toml. Complete one pair and remove the other.",
        ),
        (
            "turns = 1.2",
            'turns = 1.2\ndiameter = "20 mm"\nbraid_angle = "69 deg"',
            f"{BRAID} `thread_length` and `turns` and `braid_angle` and `diameter` in muscle.toml. Remove "
            "one pair; the other one is sufficient.",
        ),
        (
            "1.2",
            "-1.2",
            "`[muscle] turns` must be positive; got -1.2 in muscle.toml. Check its sign and unit.",
        ),
        (
            "1.2",
            '"1.2 mm"',
            "a dimensionless value has no unit; got 'mm' in [muscle] turns of muscle.toml. Remove the unit.",
        ),
        (
            '"200 mm"',
            '"0 mm"',
            "`[muscle] rest_length` must be positive; got 0 mm in muscle.toml. Check its sign and unit.",
        ),
        (
            '"200 mm"',
            "200",
            "a length needs a unit; got none in [muscle] rest_length of muscle.toml. Write one, such as mm, "
            "cm, m or in.",
        ),
        (
            '"200 mm"',
            '"200 kPa"',
            "a length must have a unit of length; got 'kPa' in [muscle] rest_length of muscle.toml. Use one "
            "such as mm, cm, m or in.",
        ),
        (
            '"200 mm"',
            '"214 mm"',
            "`rest_length` must be shorter than the thread (214 mm); got 214 mm in [muscle] of muscle.toml. "
            "`thread_length` is measured along one thread, from fitting to fitting.",
        ),
        (
            '"0.5 mm"',
            '"-0.5 mm"',
            "`sd` must not be negative; got -0.5 mm in [muscle] thread_length of muscle.toml. Write one "
            "standard deviation.",
        ),
        (
            "sd =",
            "std =",
            "unknown entry `std` ([muscle] thread_length of muscle.toml). Did you mean `sd`?",
        ),
        (
            'value = "214 mm", ',
            "",
            "a quantity must have a `value`; got `sd` in [muscle] thread_length of muscle.toml. Write "
            "{value = ..., sd = ...}.",
        ),
        (
            "1.2",
            "1.2\nthreads = 14.5",
            "`[muscle] threads` must be a positive whole number; got 14.5 in muscle.toml. Write it without "
            "quotes and without a unit.",
        ),
        (
            "1.2",
            '1.2\n[thread]\nmodulus = "3 GPa"',
            "`modulus` needs `threads` and `thread_area` in [muscle]; got no `threads` and no `thread_area` "
            "in muscle.toml. Add them, or state the stiffness of all threads together: [thread] stiffness "
            '= "1.4 MN".',
        ),
        (
            "1.2",
            '1.2\n[thread]\nmodulus = "3 GPa"\nstiffness = "1 MN"',
            "[thread] must state `modulus` or `stiffness`; got both in muscle.toml. Remove one: the "
            "stiffness is threads x area x modulus.",
        ),
        (
            "1.2",
            '1.2\n[sensors]\nforce = "0 N"',
            "`[sensors] force` must be positive; got 0 N in muscle.toml. Write one standard deviation, or "
            "remove the entry: pamjax then estimates it.",
        ),
        (
            "1.2",
            '1.2\n[sensors]\nlength = {sd = "1 mm", per = "settings"}',
            '`per` must be "sample" or "setting"; got \'settings\' in [sensors] length of muscle.toml. Did '
            "you mean `setting`?",
        ),
        (
            "1.2",
            '1.2\n[sensors]\nforce = {sd = "1 N", per = "setting"}',
            "unknown entry `per` ([sensors] force of muscle.toml). Valid names are `sd`.",
        ),
        (
            "1.2",
            '1.2\n[baseline]\nmodel = "elastik"',
            '`model` must be "inelastic" or "elastic"; got \'elastik\' in [baseline] of muscle.toml. Did you '
            "mean `elastic`?",
        ),
        (
            "1.2",
            '1.2\n[columns]\nforces = "F [N]"',
            "unknown channel `forces` ([columns] of muscle.toml). Did you mean `force`?",
        ),
        (
            "1.2",
            "1.2\n[columns]\nforce = 3",
            "`force` must be a header in quotes; got 3 in [columns] of muscle.toml. Write force = "
            '"HEADER", and the unit in the header of the recording, as "Load [N]".',
        ),
    ],
)
def test_invalid_entry_is_refused(old, new, text):
    assert read_error(MUSCLE.replace(old, new)) == text


@pytest.mark.parametrize("angle", ["90 deg", "95 deg"])
def test_right_braid_angle_is_refused(angle):
    assert read_error(ANGLED.replace("61.4 deg", angle)) == (
        f"`[muscle] braid_angle` must be between 0 and 90 deg; got {angle} in muscle.toml. Measure it "
        "from the circumference."
    )


COUNTED_BRAID = {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2}


def test_measured_length_is_read():
    muscle_toml = parse_muscle_toml(
        {"muscle": COUNTED_BRAID, "test": {"measured": "length", "load": "2 kgf"}}
    )
    assert muscle_toml.measures_length
    assert muscle_toml.load == pytest.approx(19.6133)
    assert not parse_muscle_toml({"muscle": COUNTED_BRAID}).measures_length


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"test": {"measured": "width"}}, '`measured` must be "force" or "length"; got .width.'),
        ({"test": {"load": "2 N"}}, "`load` needs a measured length"),
        ({"test": {"measured": "length", "load": "5 kg"}}, "The weight of 5 kg is 49 N."),
        ({"test": {"measured": "length", "load": "-2 N"}}, "must not be negative"),
        (
            {"test": {"measured": "length"}, "sensors": {"length": {"sd": "1 mm", "per": "setting"}}},
            "a measured length has an error for each sample",
        ),
    ],
)
def test_contradiction_of_the_measured_length_is_refused(tables, message):
    with pytest.raises(BadInput, match=message):
        parse_muscle_toml({"muscle": COUNTED_BRAID, **tables})


def test_unused_bladder_is_reported():
    note = (
        "The model has no rubber, so [bladder] is not used."
        " `pamjax fit --with bladder_elasticity` adds rubber."
    )
    muscle_toml = read(MUSCLE + '[bladder]\nmodulus = "1 MPa"\n')
    assert describe_unused_bladder(muscle_toml, ()) == [note]
    assert describe_unused_bladder(muscle_toml, ("bladder_elasticity",)) == []
    assert describe_unused_bladder(read(MUSCLE), ()) == []


def test_table_in_another_table_is_suggested_as_a_table():
    assert read_error(MUSCLE + 'colums = {force = "x"}\n') == (
        "unknown entry `colums` ([muscle] of muscle.toml). Did you mean the table [columns]?"
        " Write it on a line of its own."
    )
