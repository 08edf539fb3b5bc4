"""The folder that `pamjax new` writes is a valid case, and no file is overwritten."""

import re
import tomllib

import pytest

from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.reading.schema import (
    BaselineTable,
    BladderTable,
    MeasurementTable,
    MuscleTable,
    SensorsTable,
    ThreadTable,
)
from pamjax.records.writing.template import write_template


def test_template_is_a_valid_case(tmp_path):
    files = write_template(tmp_path / "new")
    assert [path.name for path in files] == ["recording.csv", "muscle.toml"]
    case = read_case(tmp_path / "new")
    assert case.warnings == ()
    assert case.recording.channels == ("force", "diameter")
    assert case.muscle_toml.baseline == "elastic"


def test_template_is_marked_as_an_example(tmp_path):
    recording, muscle = write_template(tmp_path / "new")
    assert re.search(r"EXAMPLE ROWS.*: replace them with your measurements", recording.read_text())
    assert "ALL VALUES BELOW ARE EXAMPLES" in muscle.read_text()


def test_every_entry_is_explained(tmp_path):
    text = write_template(tmp_path / "new")[1].read_text()
    for table in (MuscleTable, ThreadTable, BladderTable, MeasurementTable, SensorsTable, BaselineTable):
        for name in table.model_fields:
            assert re.search(rf"^(# )?{name} = ", text, re.MULTILINE), f"[{table.__name__}] {name}"


def test_both_forms_of_the_braid_agree(tmp_path):
    text = write_template(tmp_path / "new")[1].read_text()
    muscle_toml = read_muscle_toml(text.encode())
    other = re.sub(r"^(thread_length|turns) =", r"# \1 =", text, flags=re.MULTILINE)
    other = re.sub(r"^# (braid_angle|diameter) = {", r"\1 = {", other, flags=re.MULTILINE)
    assert "braid_angle" in tomllib.loads(other)["muscle"]
    assert read_muscle_toml(other.encode()).braid == pytest.approx(muscle_toml.braid, rel=5e-3)


@pytest.mark.parametrize("name", ["recording.csv", "muscle.toml"])
def test_nothing_is_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(BadInput) as error:
        write_template(tmp_path)
    assert (
        str(error.value) == f"{tmp_path / name} already exists and is not overwritten. Choose another folder."
    )
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_file_is_refused_as_a_folder(tmp_path):
    path = tmp_path / "new"
    path.write_text("mine")
    with pytest.raises(BadInput) as error:
        write_template(path)
    assert str(error.value) == f"a case must be a folder; got the file {path}. Choose another name."
