"""Files of a rig that are corrupt, or lead out of their folder: one sentence, and nothing is written."""

import io
import os

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from pamjax.errors import BadInput
from pamjax.records.importing.importer import import_case
from pamjax.records.importing.mat_file import read_mat
from tests.records.importing.conftest import MUSCLE

SPEC = """\
muscle = "muscle.toml"
columns = {force = "Load [N]", pressure = "P [kPa]"}
[[tests]]
file = "run.csv"
length = "130 mm"
"""
TABLE = "P [kPa],Load [N]\n100,30\n200,65\n300,100\n"


@pytest.fixture
def read_error(tmp_path):
    """Return the message for an import whose specification, table or file name has another text."""
    folder = tmp_path / "rig"
    folder.mkdir()

    def _read_error(*changes, table=TABLE, name="run.csv"):
        spec = SPEC
        for old, new in changes:
            assert old in spec
            spec = spec.replace(old, new)
        (folder / "muscle.toml").write_text(MUSCLE)
        (folder / name).write_text(table)
        (folder / "rig.toml").write_text(spec)
        with pytest.raises(BadInput) as error:
            import_case(folder / "rig.toml", tmp_path / "case")
        assert not (tmp_path / "case").exists()
        return str(error.value)

    return _read_error


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ('"run.csv"', "[]"),
            "`file` must name at least one file; got [] in test 1 of [[tests]].",
        ),
        (
            ("[[tests]]", "files = {skip = 100000000}\n[[tests]]"),
            "`skip` must be less than the number of lines of run.csv (4); got 100000000 in [files]. Count",
        ),
        (
            ('"Load [N]"', '{column = "Load [N]", scale = 0}'),
            "`scale` must not be zero; got 0 in [columns]. Write the channel's units per unit of the file.",
        ),
        (('"Load [N]"', '{column = "Load [N]", scale = nan}'), "`scale` must be a finite number; got nan in"),
        (('"Load [N]"', '{column = "Load [N]", zero = -inf}'), "`zero` must be a finite number; got -inf in"),
        (("columns", 'gap = "-5 s"\ncolumns'), "`gap` must be positive and at most 10 years; got -5 s."),
        (("columns", 'gap = "1e30 s"\ncolumns'), "`gap` must be positive and at most 10 years; got 1e30 s."),
        (
            ("[[tests]]", 'files = {thousands = "."}\n[[tests]]'),
            "`thousands` and `decimal` must differ; got '.' in [files]. Correct one of them.",
        ),
    ],
    ids=lambda value: value[1][:20] if isinstance(value, tuple) else "",
)
def test_hostile_specification(change, message, read_error):
    assert message in read_error(change)


@pytest.mark.parametrize("text", ["../secret.csv", "{outside}/secret.csv", "link.csv"])
def test_file_outside_the_folder_is_refused_and_not_quoted(text, read_error, tmp_path):
    (tmp_path / "secret.csv").write_text("root:password\n1\n")
    os.symlink(tmp_path / "secret.csv", tmp_path / "rig" / "link.csv")
    text = text.format(outside=tmp_path)
    message = read_error(("run.csv", text))
    assert message == (
        f"files of an import must be in the folder of its TOML file, or below; got {text} in [[tests]]."
        " Copy the files there."
    )
    assert "password" not in message


def test_muscle_outside_the_folder_is_refused(read_error, tmp_path):
    (tmp_path / "muscle.toml").write_text("root = password")
    assert "in the folder of its TOML file, or below; got ../muscle.toml in rig.toml." in read_error(
        ('"muscle.toml"', '"../muscle.toml"')
    )


def test_link_to_itself_is_refused(read_error, tmp_path):
    (tmp_path / "rig" / "loop.csv").symlink_to("loop.csv")
    assert "loop.csv cannot be read; got Too many levels of symbolic links" in read_error(
        ("run.csv", "loop.csv")
    )


def test_reading_above_the_limit_is_refused_with_its_row(read_error):
    table = TABLE.replace("200,65", "200,1e308")
    change = ('"Load [N]"', '{column = "Load [N]", scale = 1e9}')
    assert read_error(change, table=table) == (
        "`force` must be at most 1e+30 in SI units; got the reading 1e+308 in row 3 of run.csv. Check the"
        " cell, and `unit`, `zero` and `scale` in [columns]."
    )


@pytest.mark.parametrize("cycle", ["1e20", "1.5", ""])
def test_cycle_that_is_no_count_is_refused(cycle, read_error):
    table = f"P [kPa],Load [N],cycle\n100,30,1\n200,65,{cycle}\n300,100,1\n"
    message = read_error(('"P [kPa]"', '"P [kPa]", cycle = "cycle"'), table=table)
    assert message == (
        f"`cycle` must be a whole number from 0 to 1000000000; got {cycle.replace('e', 'e+') or 'nan'}"
        " in the files of [[tests]]. Number the strokes 1, 2, 3."
    )


def test_file_name_with_a_power_is_read(tmp_path):
    (tmp_path / "muscle.toml").write_text(MUSCLE)
    for name in ("t1²3.csv", "t10.csv", "t9.csv"):
        (tmp_path / name).write_text(TABLE)
    (tmp_path / "rig.toml").write_text(SPEC.replace("run.csv", "t*.csv"))
    result = import_case(tmp_path / "rig.toml", tmp_path / "case")
    assert result.tests == ("t1²3.csv", "t9.csv", "t10.csv")


def test_mark_of_thousands_names_the_true_cell_and_the_option(read_error):
    table = "P [kPa];Load [N]\n100;819,6\n200;830,1\n300;1.130,0\n"
    files = ("[[tests]]", 'files = {separator = ";", decimal = ","}\n[[tests]]')
    assert (
        "column `Load [N]` must contain only numbers or blanks; got '1.130,0' in row 4 of run.csv."
        ' If "." separates thousands, write thousands = "." and decimal = "," in [files].'
    ) in read_error(files, table=table)


@pytest.mark.parametrize(
    ("cell", "has_thousands"), [("0,001", False), ("-0,250", False), ("12,5", False), ("1,250", True)]
)
def test_comma_is_a_decimal_mark_first(cell, has_thousands, read_error):
    table = f"P [kPa];Load [N]\n100;30\n200;65\n300;{cell}\n"
    message = read_error(("[[tests]]", 'files = {separator = ";"}\n[[tests]]'), table=table)
    assert 'If "," is the decimal mark, write decimal = "," in [files].' in message
    assert ("thousands" in message) == has_thousands


def test_mark_of_thousands_is_read(tmp_path):
    (tmp_path / "muscle.toml").write_text(MUSCLE)
    (tmp_path / "run.csv").write_text("P [kPa];Load [N]\n100;30,5\n200;65\n2.300;1.130,25\n")
    files = 'files = {separator = ";", decimal = ",", thousands = "."}\n[[tests]]'
    (tmp_path / "rig.toml").write_text(SPEC.replace("[[tests]]", files))
    recording = import_case(tmp_path / "rig.toml", tmp_path / "case").case.recording
    np.testing.assert_allclose(recording.force, [30.5, 65.0, 1130.25])
    np.testing.assert_allclose(recording.pressure, [100e3, 200e3, 2300e3])


def write_mat(file, changes=()):
    """Write a MAT file of version 5 with a structure of three arrays, and other bytes at some places."""
    stream = io.BytesIO()
    savemat(stream, {"bench": dict.fromkeys("tpF", np.arange(5.0))})
    raw = bytearray(stream.getvalue())
    for place, byte in changes:
        raw[place] = byte
    file.write_bytes(bytes(raw))


def read_mat_error(file):
    with pytest.raises(BadInput) as error:
        read_mat(file, "")
    return str(error.value)


def test_corrupt_mat_file_is_one_sentence(tmp_path):
    write_mat(tmp_path / "a.mat")
    assert set(read_mat(tmp_path / "a.mat", "")) == {"bench.t", "bench.p", "bench.F"}
    # With these three bytes, SciPy's reader ends its process by a segmentation fault.
    write_mat(tmp_path / "a.mat", [(139, 41), (371, 51), (449, 203)])
    message = read_mat_error(tmp_path / "a.mat")
    assert message.startswith("a.mat must be a MAT file; got ")
    assert message.endswith(". Save it again in MATLAB.")


@pytest.mark.parametrize("size", [0, 4, 128, 200])
def test_cut_mat_file_is_one_sentence(size, tmp_path):
    write_mat(tmp_path / "a.mat")
    (tmp_path / "a.mat").write_bytes((tmp_path / "a.mat").read_bytes()[:size])
    assert read_mat_error(tmp_path / "a.mat").startswith("a.mat must ")


def _add_cycle(file):
    file.create_group("bench")["again"] = file["/"]


def _add_external_link(file):
    file["bench"] = h5py.ExternalLink("secret.h5", "/a")


def _add_soft_link(file):
    file["bench"] = h5py.SoftLink("/nowhere")


def _add_external_storage(file):
    file.create_dataset("bench", (8,), "u1", external=[("/etc/hostname", 0, 8)])


def _add_bomb(file):
    file.create_dataset("bench", (400_000_000,), "f8", chunks=(1000,), compression="gzip")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_add_cycle, "`bench` contains itself"),
        (_add_external_link, "`bench` is a link"),
        (_add_soft_link, "`bench` is a link"),
        (_add_external_storage, "`bench` is in another file"),
        (_add_bomb, "`bench` has more than 1 GB"),
    ],
)
def test_hostile_hdf5_file_is_one_sentence(change, message, tmp_path):
    with h5py.File(tmp_path / "a.mat", "w") as file:
        change(file)
    assert read_mat_error(tmp_path / "a.mat") == (
        f"a.mat must be a MAT file; got {message}. Save it again in MATLAB."
    )


def test_module_in_the_working_directory_is_not_executed(tmp_path, monkeypatch):
    write_mat(tmp_path / "a.mat")
    (tmp_path / "numpy.py").write_text("open('executed', 'w').close()")
    monkeypatch.chdir(tmp_path)
    assert set(read_mat(tmp_path / "a.mat", "")) == {"bench.t", "bench.p", "bench.F"}
    assert not (tmp_path / "executed").exists()
