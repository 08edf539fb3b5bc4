"""A case of both files: unit errors are reported, and all real cases are accepted."""

import hashlib

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.case import ensure_case, read_case
from tests.records.conftest import MUSCLE, as_csv, strokes

CHECK = "Otherwise check the entries of the braid in muscle.toml."
FIT = "`force` and `pressure` must agree with the braid; got"


def read_error(path):
    with pytest.raises(BadInput) as error:
        read_case(path)
    return str(error.value)


def test_case_has_both_files(folder):
    path = folder()
    case = read_case(path)
    assert case.name == "my-muscle"
    assert case.folder == path
    assert case.muscle_toml.name == "test muscle"
    assert case.recording.channels == ("force", "diameter")
    assert case.warnings == ()
    data = (path / "recording.csv").read_bytes() + (path / "muscle.toml").read_bytes()
    assert case.checksum == hashlib.sha256(data).hexdigest()
    assert str(case) == (
        "my-muscle: test muscle, 360 rows of force and diameter\n"
        "  pressure 100 kPa to 300 kPa\n"
        "  length 160.3 mm to 200 mm, rest 200 mm"
    )


def test_warnings_of_both_files_are_kept(folder):
    columns = strokes()
    columns["pressure"][15] = 4e7
    text = as_csv(columns).replace("cycle\n", "cycle,note\n").replace(",1\n", ",1,fine\n")
    case = read_case(folder(text))
    assert case.warnings == (
        "unknown column `note` in recording.csv: ignored.",
        "outlier pressure 40000 kPa in row 17: ignored, because most values are between 100 kPa and 300 kPa.",
    )


def test_diameter_at_one_length_is_accepted(folder):
    muscle = MUSCLE.replace("rest_length", "length")
    case = read_case(folder("pressure [kPa],diameter [mm]\n100,20.2\n200,20.3\n", muscle))
    assert case.recording.length.tolist() == [0.2, 0.2]


def test_headers_are_mapped(folder):
    text = as_csv(strokes()).replace("force [N]", "Load (N)")
    case = read_case(folder(text, MUSCLE + '[columns]\nforce = "Load (N)"\n'))
    assert case.recording.channels == ("force", "diameter")


def test_missing_folder_is_refused(tmp_path):
    path = tmp_path / "nowhere"
    assert read_error(path) == (
        f"a case must be a folder with recording.csv and muscle.toml; got {path}, which is not a folder. "
        "Check the path, or create a case with `pamjax new`."
    )


def test_file_instead_of_a_folder_is_refused_with_the_command_that_imports_it(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("Load (lbf)\n1\n")
    assert read_error(path).endswith(
        f"got {path}, which is not a folder. Describe its columns in a TOML file: `pamjax import` then makes"
        " the case."
    )


@pytest.mark.parametrize("name", ["recording.csv", "muscle.toml"])
def test_missing_file_is_refused(folder, name):
    path = folder()
    (path / name).unlink()
    assert read_error(path) == (
        f"a case must have muscle.toml and recording.csv; got no {name} in {path}."
        " Copy the one that `pamjax new` writes, and replace its values."
    )


@pytest.mark.parametrize(
    ("header", "wrong", "text"),
    [
        (
            "[kPa]",
            "[psi]",
            f"{FIT} 0.145 times the force of the ideal braid in recording.csv. Probable cause: pressure "
            f"in kPa under a header of psi. {CHECK}",
        ),
        (
            "[kPa]",
            "[bar]",
            f"{FIT} 0.01 times the force of the ideal braid in recording.csv. Probable cause: pressure "
            f"in kPa under a header of bar. {CHECK}",
        ),
        (
            "[kPa]",
            "[MPa]",
            f"{FIT} 0.001 times the force of the ideal braid in recording.csv. Probable cause: pressure "
            f"in kPa under a header of MPa. {CHECK}",
        ),
        (
            "[N]",
            "[lbf]",
            f"{FIT} 4.448 times the force of the ideal braid in recording.csv. Probable cause: force in N "
            f"under a header of lbf. {CHECK}",
        ),
        (
            "[N]",
            "[kN]",
            f"{FIT} 1000 times the force of the ideal braid in recording.csv. Probable cause: force in N "
            f"under a header of kN. {CHECK}",
        ),
        (
            "length [mm]",
            "length [in]",
            "the longest `length` must be near the rest length (7.874 in); got 200 in "
            f"in recording.csv. Probable cause: length in mm under a header of in. {CHECK}",
        ),
        (
            "length [mm]",
            "length [cm]",
            "the longest `length` must be near the rest length (20 cm); got 200 cm in "
            f"recording.csv. Probable cause: length in mm under a header of cm. {CHECK}",
        ),
        (
            "length [mm]",
            "length [m]",
            "the longest `length` must be near the rest length (0.2 m); got 200 m in "
            f"recording.csv. Probable cause: length in mm under a header of m. {CHECK}",
        ),
        (
            "diameter [mm]",
            "diameter [in]",
            "`diameter` must agree with the braid; got 25.4 times the "
            f"diameter of the ideal braid in recording.csv. Probable cause: "
            f"diameter in mm under a header of in. {CHECK}",
        ),
    ],
)
def test_unit_error_is_reported(folder, header, wrong, text):
    assert read_error(folder(as_csv(strokes()).replace(header, wrong))) == text


def changed(**factors):
    columns = strokes()
    return as_csv({name: values * factors.get(name, 1.0) for name, values in columns.items()})


@pytest.mark.parametrize(
    ("factors", "hint"),
    [
        ({"pressure": 1 / 6.894757}, "pressure in psi under a header of kPa"),
        ({"force": 1 / 4.448222}, "force in lbf under a header of N"),
        # The force is 70 % of the ideal force, and the unit is wrong: the unit error is still reported.
        ({"pressure": 1 / 6.894757, "force": 0.7}, "pressure in psi under a header of kPa"),
        ({"force": 0.7 / 4.448222}, "force in lbf under a header of N"),
        ({"length": 1 / 25.4}, "length in in under a header of mm"),
        ({"diameter": 0.5}, "a radius"),
        ({"diameter": np.pi}, "a circumference"),
    ],
)
def test_swapped_column_is_reported(folder, factors, hint):
    assert read_error(folder(changed(**factors))).endswith(f"Probable cause: {hint}. {CHECK}")


@pytest.mark.parametrize("factors", [{"force": 0.4}, {"force": 1.6}, {"diameter": 1.4}, {"diameter": 0.85}])
def test_weak_or_wide_muscle_is_no_unit_error(folder, factors):
    assert read_case(folder(changed(**factors))).warnings == ()


def test_weak_contracted_muscle_is_no_unit_error(folder):
    columns = strokes(rest=0.18)
    columns["force"] *= 0.15
    (warning,) = read_case(folder(as_csv(columns))).warnings
    assert warning == (
        "`force` in recording.csv is 0.15 times the force of the ideal braid: the muscle is slack or very "
        "stiff, or a unit is wrong. Check the units in the headers."
    )


def test_negative_force_is_reported(folder):
    assert read_error(folder(changed(force=-1.0))) == (
        "`force` must be positive when the muscle pulls; got -1 times the force of the ideal braid in "
        "recording.csv. Change its sign."
    )


def staircase(lowest):
    """Return pressure steps at one length near rest, from `lowest` up by 400 kPa and down, ideal braid."""
    columns = strokes(levels=(100e3,), samples=200)
    columns["length"][:] = 0.2
    gauge = lowest + 4e5 * (1 - np.abs(np.linspace(-1, 1, 200)))
    columns["force"] = gauge * (3 * 0.2**2 - 0.214**2) / (4 * np.pi * 1.2**2)
    columns["diameter"][:] = 0.0202
    return columns | {"pressure": gauge}


def test_absolute_pressure_is_reported(folder):
    columns = staircase(lowest=0.0)
    columns["pressure"] = columns["pressure"] + 101.3e3
    assert read_error(folder(as_csv(columns))) == (
        "`pressure` must be gauge pressure; got zero force at 101 kPa in recording.csv. If the sensor "
        "measures absolute pressure, subtract the atmospheric pressure of 101 kPa."
    )


def test_possibly_absolute_pressure_is_reported(folder):
    columns = staircase(lowest=5e4)
    columns["pressure"] = columns["pressure"] + 101.3e3
    (warning,) = read_case(folder(as_csv(columns))).warnings
    assert warning.startswith(
        "`pressure` in recording.csv may be absolute: near the rest length, got zero force at "
    )


def test_gauge_pressure_from_100_kpa_is_accepted(folder):
    assert read_case(folder(as_csv(staircase(lowest=1e5)))).warnings == ()


def test_length_above_the_thread_length_is_refused(folder):
    columns = strokes()
    columns["length"][1:4] = 0.2184
    assert read_error(folder(as_csv(columns))) == (
        "`length` must be shorter than the thread (214 mm); got 218.4 mm in row 3 of recording.csv. Check "
        "the unit in the header of `length`, and `thread_length` in muscle.toml."
    )
    columns["length"][1:4] = 0.2182  # 2 % above: a soft thread can stretch by this amount
    assert read_case(folder(as_csv(columns))).recording.n == 360


def test_case_without_rows_near_rest_is_accepted(folder):
    case = read_case(folder(as_csv(strokes()), MUSCLE.replace('"200 mm"', '"172 mm"')))
    assert case.warnings == (
        "no row of recording.csv is near rest: the longest `length` is 200 mm, the rest length 172 mm. Check "
        "`rest_length` in muscle.toml.",
    )


def test_every_real_case_is_accepted(real_case):
    # The load cell of these two hoses has a known zero error.
    has_zero_error = real_case.name in ("hose-10mm-281", "hose-10mm-83")
    zero_warnings = [w for w in real_case.warnings if "zero of the load cell" in w]
    assert real_case.warnings == tuple(zero_warnings)
    assert len(zero_warnings) == has_zero_error
    assert real_case.recording.outliers == ()
    assert real_case.recording.usable.all()


def test_folder_is_accepted_as_its_case(folder):
    case = read_case(folder())
    assert ensure_case(case) is case
    assert ensure_case(str(case.folder)).checksum == case.checksum
    with pytest.raises(BadInput, match="must be a folder, or a result of `read_case` or `case_from`; got 3"):
        ensure_case(3)  # pyright: ignore[reportArgumentType]
