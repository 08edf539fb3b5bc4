"""muscle.toml: the two braid forms, the ways to state stiffness, and a sentence for each mistake."""

import math

import pytest

from pamjax.errors import BadInput
from pamjax.records.reading.muscle_toml import (
    Bladder,
    MeasuredValue,
    Sensors,
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


def told(text):
    with pytest.raises(BadInput) as error:
        read(text)
    return str(error.value)


def test_a_counted_braid():
    entry = read(MUSCLE + 'threads = 144\nthread_area = "0.0858 mm^2"\n[thread]\nmodulus = "112 GPa"\n')
    assert entry.name == "test muscle"
    assert entry.rest_length == MeasuredValue(pytest.approx(0.2, rel=1e-12), 0.0)
    assert entry.thread_length == MeasuredValue(
        pytest.approx(0.214, rel=1e-12), pytest.approx(5e-4, rel=1e-12)
    )
    assert entry.turns == MeasuredValue(1.2, 0.0)
    assert entry.threads == 144
    assert entry.thread_area == MeasuredValue(pytest.approx(8.58e-8, rel=1e-12))
    assert entry.modulus == MeasuredValue(pytest.approx(112e9, rel=1e-12))
    assert (entry.braid_angle, entry.diameter, entry.stiffness, entry.bladder) == (None,) * 4
    assert entry.sensors == Sensors()
    assert entry.braid == (pytest.approx(0.214, rel=1e-12), 1.2)


def test_the_two_forms_of_the_braid_determine_each_other():
    entry = read(ANGLED)
    thread_length, turns = entry.braid
    assert thread_length * math.sin(math.radians(61.4)) == pytest.approx(0.132, rel=1e-12)
    radius = math.sqrt(thread_length**2 - 0.132**2) / (2 * math.pi * turns)
    assert 2 * radius == pytest.approx(0.0118, rel=1e-12)


def test_dotted_tables_say_the_same():
    dotted = MUSCLE.replace('thread_length = {value = "214 mm", sd = "0.5 mm"}\n', "")
    dotted += '[muscle.thread_length]\nvalue = "214 mm"\nsd = "0.5 mm"\n'
    assert read(dotted) == read(MUSCLE)


def test_byte_order_mark_and_windows_line_ends():
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
def test_the_baseline_is_what_the_lab_believes(thread, stated, expected):
    assert read(MUSCLE + thread + stated).baseline == expected


def test_bladder_sensors_and_columns():
    entry = read(
        MUSCLE
        + '[bladder]\ninner_diameter = "19 mm"\nmodulus = {value = "1.2 MPa", sd = "0.3 MPa"}\n'
        + '[sensors]\nforce = "2 N"\npressure = {sd = "0.7 kPa"}\nlength = {sd = "1 mm", per = "setting"}\n'
        + '[columns]\nforce = "Load (lbf)"\n'
    )
    assert entry.bladder == Bladder(MeasuredValue(0.019), None, MeasuredValue(1.2e6, 0.3e6))
    assert entry.sensors == Sensors(force=2.0, pressure=700.0, length=1e-3, length_per_setting=True)
    assert entry.columns == {"force": "Load (lbf)"}


def test_one_length_is_the_rest_length_too():
    entry = read(MUSCLE.replace("rest_length", "length"))
    assert entry.length == pytest.approx(0.2, rel=1e-12)
    assert entry.rest_length == MeasuredValue(pytest.approx(0.2, rel=1e-12))


def test_a_mapping_will_do():
    said = {"muscle": {"rest_length": "200 mm", "thread_length": "214 mm", "turns": 1.2}}
    assert parse_muscle_toml(said).braid == (pytest.approx(0.214, rel=1e-12), 1.2)


def test_text_that_is_no_toml():
    assert told("[muscle]\nname = Kevlar\n") == (
        "muscle.toml must be TOML; got invalid value (at line 2, column 8). A text stands in double quotes, "
        "a table in [brackets]."
    )


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "turns",
            "truns",
            "`truns` is no entry ([muscle] of muscle.toml). Did you mean `turns`?",
        ),
        ("[muscle]", "[muscel]", "muscle.toml must have a table [muscle]. It says what the muscle is."),
        (
            "[muscle]",
            "[therad]\n[muscle]",
            "[therad] is no table of muscle.toml. Did you mean `thread`?",
        ),
        (
            "rest_length",
            "# ",
            "[muscle] must state `rest_length`; got none in muscle.toml. Write the length between the "
            'fittings at rest: rest_length = "235 mm".',
        ),
        ("turns", "# ", f"{BRAID} `thread_length` in muscle.toml. Add what is missing."),
        (
            "turns = 1.2",
            'diameter = "20 mm"',
            f"{BRAID} `thread_length` and `diameter` in muscle.toml. Complete one pair and remove the other.",
        ),
        (
            "turns = 1.2",
            'turns = 1.2\ndiameter = "20 mm"\nbraid_angle = "69 deg"',
            f"{BRAID} `thread_length` and `turns` and `braid_angle` and `diameter` in muscle.toml. Remove "
            "one pair: each follows from the other.",
        ),
        (
            "1.2",
            "-1.2",
            "`[muscle] turns` must be positive; got -1.2 in muscle.toml. Check its sign and unit.",
        ),
        (
            "1.2",
            '"1.2 mm"',
            "this number has no unit; got 'mm' in [muscle] turns of muscle.toml. Leave the unit out.",
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
            "`sd` must not be negative; got -0.5 mm in [muscle] thread_length of muscle.toml. It is one "
            "standard deviation.",
        ),
        (
            "sd =",
            "std =",
            "`std` is no entry here ([muscle] thread_length of muscle.toml). Did you mean `sd`?",
        ),
        (
            'value = "214 mm", ',
            "",
            "a quantity must have a `value`; got `sd` in [muscle] thread_length of muscle.toml. Write value "
            "= and sd =.",
        ),
        (
            "1.2",
            "1.2\nthreads = 14.5",
            "`[muscle] threads` must be a positive whole number; got 14.5 in muscle.toml. Write it without "
            "quotes and unit.",
        ),
        (
            "1.2",
            '1.2\n[thread]\nmodulus = "3 GPa"',
            "`modulus` needs `threads` and `thread_area` in [muscle]; got no `threads` and no `thread_area` "
            "in muscle.toml. Add what is missing, or state that of all threads together: [thread] stiffness "
            '= "1.4 MN".',
        ),
        (
            "1.2",
            '1.2\n[thread]\nmodulus = "3 GPa"\nstiffness = "1 MN"',
            "[thread] must state `modulus` or `stiffness`; got both in muscle.toml. Keep one: the stiffness "
            "is threads x area x modulus.",
        ),
        (
            "1.2",
            '1.2\n[sensors]\nforce = "0 N"',
            "`[sensors] force` must be positive; got 0 N in muscle.toml. It is one standard deviation; leave "
            "it out to have it estimated.",
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
            "`per` is no entry here ([sensors] force of muscle.toml). Known are `sd`.",
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
            "`forces` is no column of a recording ([columns] of muscle.toml). Did you mean `force`?",
        ),
        (
            "1.2",
            "1.2\n[columns]\nforce = 3",
            "`force` must be a text in quotes; got 3 in [columns] of muscle.toml.",
        ),
    ],
)
def test_a_mistake_is_told(old, new, text):
    assert told(MUSCLE.replace(old, new)) == text


@pytest.mark.parametrize("angle", ["90 deg", "95 deg"])
def test_the_braid_angle_is_no_right_angle(angle):
    assert told(ANGLED.replace("61.4 deg", angle)) == (
        f"`[muscle] braid_angle` must lie between 0 and 90 deg; got {angle} in muscle.toml. It is measured "
        "from the circumference."
    )
