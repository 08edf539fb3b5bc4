"""A muscle, and imports of one file, for the tests of rig files."""

import pytest

from pamjax.errors import BadInput
from pamjax.records.importing.importer import import_case

MUSCLE = """\
[muscle]
rest_length = {value = "132 mm", sd = "1 mm"}
diameter = {value = "11.8 mm", sd = "0.9 mm"}
braid_angle = {value = "61.4 deg", sd = "1 deg"}
"""
RIG = """\
muscle = "muscle.toml"
[files]
{files}
[columns]
{columns}
{more}
[[tests]]
file = {file}
{length}
"""


@pytest.fixture
def import_rig(tmp_path):
    """Write a TOML file and a data file next to the muscle, import them, and return the result.

    A text of None leaves the data file as it is.
    """

    def _import_rig(
        text="",
        *,
        file='"run.csv"',
        name="run.csv",
        length='length = "130 mm"',
        files="",
        columns="",
        more="",
        muscle="muscle.toml",
    ):
        (tmp_path / "muscle.toml").write_text(MUSCLE)
        if text is not None:
            (tmp_path / name).write_text(text)
        spec = RIG.format(files=files, columns=columns, more=more, file=file, length=length)
        (tmp_path / "rig.toml").write_text(spec.replace("muscle.toml", muscle))
        return import_case(tmp_path / "rig.toml", tmp_path / "case")

    return _import_rig


@pytest.fixture
def rig(import_rig):
    """Import as `import_rig`, and return the recording."""
    return lambda *texts, **options: import_rig(*texts, **options).case.recording


@pytest.fixture
def refuse(rig, tmp_path):
    """Import as `rig`, check that it is refused and writes nothing, and return the message."""

    def _refuse(*texts, **options):
        with pytest.raises(BadInput) as error:
            rig(*texts, **options)
        assert "\n" not in str(error.value)
        assert not (tmp_path / "case").exists()
        return str(error.value)

    return _refuse


PLAIN = 'force = "Load [lbf]"\npressure = {column = "P", unit = "psi"}'
