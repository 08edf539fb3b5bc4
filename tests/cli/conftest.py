"""Case folders of the command-line tests, each created and fitted once."""

import pytest

from pamjax.cli.main import main

PLAN = """\
[protocol]
kind = "strokes"
pressures = ["100 kPa", "250 kPa", "450 kPa"]
contractions = [0.2]
speed = "1.57 mm/s"
cycles = 1
"""


@pytest.fixture(scope="session")
def bench(tmp_path_factory):
    """Return a folder with a template `stated`, a protocol, and the simulated case `made`."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "plan.toml").write_text(PLAN)
    assert main(["new", str(folder / "stated")]) == 0
    arguments = [str(folder / "stated"), str(folder / "plan.toml"), "--out", str(folder / "made")]
    assert main(["simulate", *arguments, "--seed", "3"]) == 0
    return folder


@pytest.fixture(scope="session")
def fitted(bench):
    """Return the folder that `pamjax fit` wrote."""
    arguments = ["--out", str(bench / "out"), "--starts", "2", "--folds", "2"]
    assert main(["fit", str(bench / "made"), *arguments]) == 0
    return bench / "out"


@pytest.fixture(scope="session")
def rubbed(bench):
    """Return the folder of the example recording, which has friction."""
    assert main(["new", str(bench / "rubbed")]) == 0
    return bench / "rubbed"


@pytest.fixture(scope="session")
def diagnosed(rubbed, bench):
    """Return the folder of `pamjax diagnose` for the example recording."""
    assert main(["diagnose", str(rubbed), "--out", str(bench / "verdicts")]) == 0
    return bench / "verdicts" / "rubbed"


@pytest.fixture(scope="session")
def planned(bench, tmp_path_factory):
    """Return the folder of `pamjax plan` for a muscle.toml without a recording."""
    folder = tmp_path_factory.mktemp("plan")
    rig = folder / "rig.toml"
    rig.write_text('[rig]\npressure = "6 bar"\nforce = "2 N"\ndiameter = "0.1 mm"\n')
    words = [str(bench / "stated" / "muscle.toml"), str(rig), "--goal", "thread.modulus", "--to", "6 %"]
    arguments = ["plan", *words, "--minutes", "40", "--out", str(folder / "out")]
    assert main(arguments) == 0
    return folder / "out"


@pytest.fixture
def case(bench, tmp_path):
    """Return the folder of the simulated case, with one text replaced by another."""

    def _case(recording=(), muscle=()):
        folder = tmp_path / "case"
        folder.mkdir()
        for name, change in (("recording.csv", recording), ("muscle.toml", muscle)):
            text = (bench / "made" / name).read_text()
            for old, new in [change] if change else []:
                assert old in text
                text = text.replace(old, new, 1)
            (folder / name).write_text(text)
        return folder

    return _case
