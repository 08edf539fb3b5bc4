"""A case: both files together, unit slips told, and every real case read without refusal."""

import hashlib

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.case import load_case, read_case
from tests.records.conftest import MUSCLE, as_csv, strokes

CHECK = "if it is not, check the braid's numbers in muscle.toml."
FIT = "force and pressure must fit the braid; got"


def told(path):
    with pytest.raises(BadInput) as error:
        read_case(path)
    return str(error.value)


def test_a_case_is_both_files(folder):
    path = folder()
    case = read_case(path)
    assert case.name == "my-muscle"
    assert case.folder == path
    assert case.entry.name == "test muscle"
    assert case.recording.channels == ("force", "diameter")
    assert case.warnings == ()
    data = (path / "recording.csv").read_bytes() + (path / "muscle.toml").read_bytes()
    assert case.checksum == hashlib.sha256(data).hexdigest()
    assert str(case) == (
        "my-muscle: test muscle, 360 rows of force and diameter\n"
        "  pressure 100 kPa to 300 kPa\n"
        "  length 160.3 mm to 200 mm, rest 200 mm"
    )


def test_what_the_owner_should_know_is_not_lost(folder):
    columns = strokes()
    columns["pressure"][15] = 4e7
    text = as_csv(columns).replace("cycle\n", "cycle,note\n").replace(",1\n", ",1,fine\n")
    case = read_case(folder(text))
    assert case.warnings == (
        "column `note` of recording.csv is none that pamjax knows, and was kept out.",
        "pressure 40000 kPa in row 17 was set aside: nearly all others lie between 100 kPa and 300 kPa.",
    )


def test_diameter_at_one_length(folder):
    muscle = MUSCLE.replace("rest_length", "length")
    case = read_case(folder("pressure [kPa],diameter [mm]\n100,20.2\n200,20.3\n", muscle))
    assert case.recording.length.tolist() == [0.2, 0.2]


def test_headers_are_mapped(folder):
    text = as_csv(strokes()).replace("force [N]", "Load (N)")
    case = read_case(folder(text, MUSCLE + '[columns]\nforce = "Load (N)"\n'))
    assert case.recording.channels == ("force", "diameter")


def test_no_folder(tmp_path):
    path = tmp_path / "nowhere"
    assert told(path) == (
        f"a case is a folder with recording.csv and muscle.toml; got {path}, which is none. `pamjax new` "
        "makes one to fill in."
    )


@pytest.mark.parametrize("name", ["recording.csv", "muscle.toml"])
def test_a_missing_file(folder, name):
    path = folder()
    (path / name).unlink()
    assert told(path) == f"there is no file {path / name}. Check its path."


@pytest.mark.parametrize(
    ("header", "wrong", "text"),
    [
        (
            "[kPa]",
            "[psi]",
            f"{FIT} 0.145 times the ideal braid's force in recording.csv. It looks like pressure "
            f"in kPa under a header of psi; {CHECK}",
        ),
        (
            "[kPa]",
            "[bar]",
            f"{FIT} 0.01 times the ideal braid's force in recording.csv. It looks like pressure "
            f"in kPa under a header of bar; {CHECK}",
        ),
        (
            "[kPa]",
            "[MPa]",
            f"{FIT} 0.001 times the ideal braid's force in recording.csv. It looks like pressure "
            f"in kPa under a header of MPa or force in kN under a header of N; {CHECK}",
        ),
        (
            "[N]",
            "[lbf]",
            f"{FIT} 4.448 times the ideal braid's force in recording.csv. It looks like force in N "
            f"under a header of lbf; {CHECK}",
        ),
        (
            "[N]",
            "[kN]",
            f"{FIT} 1000 times the ideal braid's force in recording.csv. It looks like pressure in "
            f"MPa under a header of kPa or force in N under a header of kN; {CHECK}",
        ),
        (
            "length [mm]",
            "length [in]",
            "the longest `length` must be near the rest length (7.874 in); got 200 in "
            f"in recording.csv. It looks like length in mm under a header of in; {CHECK}",
        ),
        (
            "length [mm]",
            "length [cm]",
            "the longest `length` must be near the rest length (20 cm); got 200 cm in "
            f"recording.csv. It looks like length in mm under a header of cm; {CHECK}",
        ),
        (
            "length [mm]",
            "length [m]",
            "the longest `length` must be near the rest length (0.2 m); got 200 m in "
            f"recording.csv. It looks like length in mm under a header of m; {CHECK}",
        ),
        (
            "diameter [mm]",
            "diameter [in]",
            "`diameter` must fit the braid; got 25.4 times the ideal braid's "
            f"diameter in recording.csv. It looks like diameter in mm under a header of in; {CHECK}",
        ),
    ],
)
def test_a_slipped_unit_is_named(folder, header, wrong, text):
    assert told(folder(as_csv(strokes()).replace(header, wrong))) == text


def changed(**factors):
    columns = strokes()
    return as_csv({name: values * factors.get(name, 1.0) for name, values in columns.items()})


@pytest.mark.parametrize(
    ("factors", "hint"),
    [
        ({"pressure": 1 / 6.894757}, "pressure in psi under a header of kPa"),
        ({"force": 1 / 4.448222}, "force in lbf under a header of N"),
        # Weaker than the ideal braid by a third, and slipped: the slip is told all the same.
        ({"pressure": 1 / 6.894757, "force": 0.7}, "pressure in psi under a header of kPa"),
        ({"force": 0.7 / 4.448222}, "force in lbf under a header of N"),
        ({"length": 1 / 25.4}, "length in in under a header of mm"),
        ({"diameter": 0.5}, "a radius"),
        ({"diameter": np.pi}, "a circumference"),
    ],
)
def test_a_slipped_column_is_named(folder, factors, hint):
    assert told(folder(changed(**factors))).endswith(f"It looks like {hint}; {CHECK}")


@pytest.mark.parametrize("factors", [{"force": 0.4}, {"force": 1.6}, {"diameter": 1.4}, {"diameter": 0.85}])
def test_a_weak_or_wide_muscle_is_no_slip(folder, factors):
    assert read_case(folder(changed(**factors))).warnings == ()


def test_a_contracted_muscle_may_be_weak(folder):
    columns = strokes(rest=0.18)
    columns["force"] *= 0.15
    (warning,) = read_case(folder(as_csv(columns))).warnings
    assert warning == (
        "`force` in recording.csv comes to 0.15 times the ideal braid's force: the muscle is slack or very "
        "stiff, or a unit is wrong."
    )


def test_tension_is_positive(folder):
    assert told(folder(changed(force=-1.0))) == (
        "a muscle that pulls must have a positive `force`; got -1 times the ideal braid's force in "
        "recording.csv. Turn its sign."
    )


def staircase(lowest):
    """One length near rest, pressure from `lowest` up by 400 kPa and down again, force of the ideal braid."""
    columns = strokes(levels=(100e3,), samples=200)
    columns["length"][:] = 0.2
    gauge = lowest + 4e5 * (1 - np.abs(np.linspace(-1, 1, 200)))
    columns["force"] = gauge * (3 * 0.2**2 - 0.214**2) / (4 * np.pi * 1.2**2)
    columns["diameter"][:] = 0.0202
    return columns | {"pressure": gauge}


def test_pressure_that_counts_from_vacuum(folder):
    columns = staircase(lowest=0.0)
    columns["pressure"] = columns["pressure"] + 101.3e3
    assert told(folder(as_csv(columns))) == (
        "`pressure` must be gauge pressure; got a force that begins at 101 kPa in recording.csv. Subtract "
        "the atmosphere's 101 kPa if the gauge counts from vacuum."
    )


def test_pressure_that_may_count_from_vacuum(folder):
    columns = staircase(lowest=5e4)
    columns["pressure"] = columns["pressure"] + 101.3e3
    (warning,) = read_case(folder(as_csv(columns))).warnings
    assert warning.startswith(
        "`pressure` in recording.csv may be absolute: near rest length the force begins"
    )


def test_gauge_pressure_from_100_kpa_is_gauge_pressure(folder):
    assert read_case(folder(as_csv(staircase(lowest=1e5)))).warnings == ()


def test_a_length_beyond_the_thread(folder):
    columns = strokes()
    columns["length"][1:4] = 0.2184
    assert told(folder(as_csv(columns))) == (
        "`length` must be shorter than the thread (214 mm); got 218.4 mm in row 3 of recording.csv. Check "
        "the unit in its header and `thread_length`."
    )
    columns["length"][1:4] = 0.2182  # 2 % beyond: a soft thread may stretch so far
    assert read_case(folder(as_csv(columns))).recording.n == 360


def test_no_row_near_rest(folder):
    case = read_case(folder(as_csv(strokes()), MUSCLE.replace('"200 mm"', '"172 mm"')))
    assert case.warnings == (
        "the longest `length` in recording.csv is 200 mm, rest length 172 mm: no row is near rest.",
    )


def test_every_real_case_is_read(real_case):
    assert real_case.warnings == ()
    assert real_case.recording.outliers == ()
    assert real_case.recording.usable.all()


def test_a_folder_stands_for_its_case_and_nothing_else_does(folder):
    case = read_case(folder())
    assert load_case(case) is case
    assert load_case(str(case.folder)).checksum == case.checksum
    with pytest.raises(BadInput, match="`read_case` or `case_from` makes, or its folder; got 3"):
        load_case(3)  # pyright: ignore[reportArgumentType]
