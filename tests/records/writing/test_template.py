"""The folder that `pamjax new` writes reads as it stands, and nothing is overwritten."""

import re
import tomllib

import pytest

from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.reading.schema import BaselineTable, BladderTable, MuscleTable, SensorsTable, ThreadTable
from pamjax.records.writing.template import write_template


def test_the_template_reads_as_it_stands(tmp_path):
    files = write_template(tmp_path / "new")
    assert [path.name for path in files] == ["recording.csv", "muscle.toml"]
    case = read_case(tmp_path / "new")
    assert case.warnings == ()
    assert case.recording.channels == ("force", "diameter")
    assert case.entry.baseline == "elastic"


def test_it_says_that_it_is_an_example(tmp_path):
    recording, muscle = write_template(tmp_path / "new")
    assert "EXAMPLE ROWS: put your own in their place" in recording.read_text()
    assert "ALL NUMBERS BELOW ARE EXAMPLES" in muscle.read_text()


def test_every_entry_is_explained(tmp_path):
    text = write_template(tmp_path / "new")[1].read_text()
    for table in (MuscleTable, ThreadTable, BladderTable, SensorsTable, BaselineTable):
        for name in table.model_fields:
            assert re.search(rf"^(# )?{name} = ", text, re.MULTILINE), f"[{table.__name__}] {name}"


def test_the_other_form_of_the_braid_is_the_same_braid(tmp_path):
    text = write_template(tmp_path / "new")[1].read_text()
    counted = read_muscle_toml(text.encode())
    other = re.sub(r"^(thread_length|turns) =", r"# \1 =", text, flags=re.MULTILINE)
    other = re.sub(r"^# (braid_angle|diameter) = {", r"\1 = {", other, flags=re.MULTILINE)
    assert "braid_angle" in tomllib.loads(other)["muscle"]
    assert read_muscle_toml(other.encode()).braid == pytest.approx(counted.braid, rel=5e-3)


@pytest.mark.parametrize("name", ["recording.csv", "muscle.toml"])
def test_nothing_is_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(BadInput) as told:
        write_template(tmp_path)
    assert (
        str(told.value)
        == f"{tmp_path / name} is there already, and is not overwritten. Choose another folder."
    )
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_file_is_no_folder(tmp_path):
    path = tmp_path / "new"
    path.write_text("mine")
    with pytest.raises(BadInput) as told:
        write_template(path)
    assert str(told.value) == f"a case is a folder; got the file {path}. Choose another name."
