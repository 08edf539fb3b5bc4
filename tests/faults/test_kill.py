"""A killed command leaves no incomplete file and completes to the same result; both faults are detected."""

import json
import os
import signal
import sys

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from tests.faults.kill import COMMANDS, KillTrial, Moment, _measure_size, list_figures, run_trials
from tests.faults.read_back import (
    find_differences,
    find_incomplete_files,
    list_leftovers,
    list_results,
)

pytestmark = pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")

#: A program that writes a result in small steps, in place of a command; {place} is where it writes.
PROGRAM = """
import json, os, sys, time
folder = sys.argv[sys.argv.index("--out") + 1]
os.makedirs(folder, exist_ok=True)
place = os.path.join(folder, {place!r})
with open(place, "w") as file:
    for part in ("[1,", "2,", "3]"):
        file.write(part)
        file.flush()
        time.sleep(0.2)
os.replace(place, os.path.join(folder, "result.json"))
"""


class ProgramTrial(KillTrial):
    """A trial of a small program."""

    def _list_command(self):
        return [sys.executable, "-c", *self.words]


def run_program(place, folder, kills=6):
    """Return the tally of a program that is killed while it writes."""
    (folder / "inputs").mkdir(parents=True)
    trial = ProgramTrial("program", [PROGRAM.format(place=place)], folder / "inputs", folder, seed=2)
    trial.folder.mkdir()
    trial.run_undisturbed()
    for _ in range(kills):
        trial.run_killed(1)
    return trial.tally


def test_incomplete_file_is_detected(tmp_path):
    careful = run_program(".result-1.json", tmp_path / "careful")
    assert careful.is_clean
    assert careful.equal == careful.runs == careful.kills == 6
    assert careful.landed > 0
    careless = run_program("result.json", tmp_path / "careless")
    assert any("result.json: JSONDecodeError" in text for text in careless.incomplete)
    assert not careless.is_clean


def test_run_that_ended_before_the_kill_is_not_counted(tmp_path):
    (tmp_path / "inputs").mkdir()
    trial = ProgramTrial("program", ["pass"], tmp_path / "inputs", tmp_path, seed=0)
    trial.folder.mkdir()
    trial._prepare()
    assert not trial._kill_at(trial._start(), Moment(60.0))
    process = trial._start()
    process.send_signal(signal.SIGKILL)
    assert trial._kill_at(process, Moment(60.0))


def test_file_that_disappears_while_the_folder_is_listed_has_no_size(tmp_path):
    (tmp_path / "a.json").write_text("[1]")
    assert _measure_size(str(tmp_path / "a.json")) == 3
    assert _measure_size(str(tmp_path / "gone.json")) == -1


def test_error_of_a_resumed_run_is_a_difference(tmp_path):
    (tmp_path / "inputs").mkdir()
    program = "import os, sys; os.path.exists('again') and sys.exit('broken'); open('again', 'w')"
    trial = ProgramTrial("program", [program], tmp_path / "inputs", tmp_path, seed=0)
    trial.folder.mkdir()
    trial.run_undisturbed()
    trial.duration = 60.0
    trial.run_killed(1)
    assert trial.tally.different == ["exit code 1: broken\n"]
    assert not trial.tally.is_clean


def write_files(folder):
    """Write one complete file of each format with a check of its end."""
    folder.mkdir()
    (folder / "a.json").write_text('{"seconds": 3.0, "value": [1, 2]}')
    (folder / "a.csv").write_text("x,y\n1,2\n3,4\n")
    (folder / "a.html").write_text("<html></html>\n")
    np.savez(folder / "a.npz", x=np.arange(100.0))
    with h5py.File(folder / "a.nc", "w") as file:
        file["x"] = np.arange(1000.0)
    pd.DataFrame({"x": [1.0, 2.0]}).to_csv(folder / "b.csv", index=False)
    figure = plt.figure()
    figure.savefig(folder / "a.png")
    figure.savefig(folder / "a.pdf")
    plt.close(figure)


def test_every_truncated_format_is_detected(tmp_path):
    write_files(tmp_path / "out")
    assert find_incomplete_files(tmp_path / "out") == []
    for path in list_results(tmp_path / "out"):
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) * 3 // 4])
        (text,) = find_incomplete_files(tmp_path / "out")
        assert text.startswith(path.name)
        path.write_bytes(whole)
    (tmp_path / "out" / ".a-1.json").write_text("[1,")
    assert find_incomplete_files(tmp_path / "out") == []


def test_differences_are_those_beyond_times_and_temporary_files(tmp_path):
    for name in ("first", "second"):
        write_files(tmp_path / name)
        for path in (tmp_path / name).glob("a.p*"):
            path.write_bytes(b"same")
        (tmp_path / name / "a.npz").write_bytes(b"same")
        (tmp_path / name / "a.nc").write_bytes(b"same")
    first, second = tmp_path / "first", tmp_path / "second"
    (second / "a.json").write_text(json.dumps({"value": [1, 2], "seconds": 4.0}))
    (second / ".b-1").mkdir()
    (second / ".b-1" / "a.csv").write_text("x")
    assert find_differences(first, second) == []
    assert [path.name for path in list_leftovers(second)] == [".b-1"]
    (second / "a.json").write_text('{"value": [1, 3]}')
    (second / "c.csv").write_text("x\n")
    assert find_differences(first, second) == ["a.json", "c.csv"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kills"), [("fit", 1), ("sample", 2)])
def test_killed_command_completes_to_the_same_result(name, kills, tmp_path):
    trials = run_trials([name], kills, seed=7, folder=tmp_path)
    tally = trials[name].tally
    assert tally.incomplete == []
    assert tally.different == []
    assert tally.kills == kills
    assert tally.equal == tally.runs > 0
    assert list_figures(trials)[f"{name}, result files"] > 3


def test_commands_of_the_promise_are_tested():
    assert set(COMMANDS) == {"fit", "sample", "diagnose", "prove", "fleet"}
