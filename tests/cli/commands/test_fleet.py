"""`pamjax fleet`: a killed run continues, workers do not change the store, and refused options."""

import signal
import subprocess
import sys
import time

import pytest

import pamjax
from pamjax.cli.main import main
from pamjax.fleet.store import read_json
from tests.faults.read_back import list_unequal_variables
from tests.fleet.made_store import write_made_store

pytest.importorskip("distributed", reason="needs the extra pamjax[fleet]")

PROGRAM = "import sys; from pamjax.cli.main import run; run()"
OPTIONS = ("--stage", "check", "fit", "--no-figures", "--no-report")


def change_last_force(file, newtons):
    """Add a force to the last row of a recording, so that recordings differ."""
    head, last = file.read_text().rstrip().rsplit("\n", 1)
    names = next(line for line in head.splitlines() if not line.startswith("#")).split(",")
    cells, place = last.split(","), names.index("force [N]")
    cells[place] = str(float(cells[place]) + newtons)
    file.write_text(f"{head}\n{','.join(cells)}\n")


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """Return a folder with five cases; the one named c is refused."""
    folder = tmp_path_factory.mktemp("fleet")
    for k, name in enumerate("abcde"):
        assert main(["new", str(folder / name)]) == 0
        change_last_force(folder / name / "recording.csv", k)
    (folder / "c" / "recording.csv").write_text("time [s],pressure [kPa]\n")
    return folder


def start(*words):
    command = [sys.executable, "-c", PROGRAM, "fleet", *map(str, words), *OPTIONS]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def read_store(folder):
    """Return the bytes of each file that must not depend on the run."""
    files = (path for path in folder.rglob("*") if path.is_file())
    names = {path.relative_to(folder).as_posix(): path for path in files}
    timed = ("time.json", "tables/tasks.parquet", ".lock")
    return {name: path.read_bytes() for name, path in names.items() if not name.endswith(timed)}


def wait_for_tasks(store, count, process):
    """Wait until a number of tasks is done, then return."""
    end = time.monotonic() + 120
    while len(list(store.glob("cases/*/*/task.json"))) < count:
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture(scope="module")
def undisturbed(cases, tmp_path_factory):
    """Return the store of a run with one worker."""
    store = tmp_path_factory.mktemp("one") / "store"
    process = start(cases, "--out", store, "--workers", 1)
    output, errors = process.communicate(timeout=180)
    assert process.returncode == 0, errors
    assert "check     4 done, 1 refused" in output
    assert "fit       4 done, 1 open" in output
    assert "refused: c: check: " in output
    return store


@pytest.mark.slow
def test_killed_run_continues_to_the_same_store(cases, undisturbed, tmp_path):
    store = tmp_path / "store"
    process = start(cases, "--out", store, "--workers", 2)
    wait_for_tasks(store, 2, process)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    done = {path: path.stat().st_mtime_ns for path in store.glob("cases/*/*/task.json")}
    assert main(["fleet", "status", str(store)]) == 0
    process = start(cases, "--out", store, "--workers", 2)
    _, errors = process.communicate(timeout=180)
    assert process.returncode == 0, errors
    assert {path: path.stat().st_mtime_ns for path in done} == done
    first, second = read_store(undisturbed), read_store(store)
    assert first.keys() == second.keys()
    unequal = [name for name in first if first[name] != second[name]]
    details = [list_unequal_variables(undisturbed / k, store / k) for k in unequal if k.endswith(".nc")]
    assert unequal == [], details
    assert not [path for path in store.glob("cases/*/.*") if path.is_dir()]


@pytest.mark.slow
def test_posterior_and_validation_of_each_case(undisturbed, cases, tmp_path):
    model = undisturbed / "cases" / "a" / "fit" / "fit.json"
    words = ["--stage", "sample", "validate", "--model", str(model), "--workers", "1"]
    (tmp_path / "FLEET.toml").write_text(f'folder = "{cases}"\ncases = ["a", "b"]\n[sample]\ness = 50\n')
    store = tmp_path / "store"
    words += ["--out", str(store), "--no-figures", "--no-report"]
    assert main(["fleet", str(tmp_path / "FLEET.toml"), *words]) == 0
    fleet = pamjax.open_fleet(store)
    assert fleet.cases["sample_converged"].tolist() == [True, True]
    assert (fleet.cases["validation_blocks"] > 0).all()
    posterior = fleet.read_posterior("a")
    draws = float(posterior["posterior/thread.modulus"].mean()) / 1e9
    row = fleet.numbers.query("case == 'a' and name == 'thread.modulus'")
    assert draws == pytest.approx(float(row["value"].iloc[0]))
    seen = [read_json(store / "cases" / case / "validate" / "validation.json")["seen"] for case in "ab"]
    assert seen == [True, False]


@pytest.mark.slow
def test_finished_fleet_has_nothing_to_do(cases, undisturbed, capsys):
    before = read_store(undisturbed)
    assert main(["fleet", str(cases), "--out", str(undisturbed), *OPTIONS]) == 0
    assert "4 done" in capsys.readouterr().out
    assert read_store(undisturbed) == before


@pytest.mark.slow
def test_interruption_says_how_to_continue(cases, tmp_path, interruptible):
    store = tmp_path / "store"
    process = start(cases, "--out", store, "--workers", 1)
    wait_for_tasks(store, 1, process)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    lines = errors.splitlines()
    assert any(line.startswith("to continue: pamjax ") for line in lines)
    # Dask can print an exception that it ignores, if the signal meets its clean-up.
    assert lines[-1] == "pamjax: interrupted; no incomplete file was written"


def read_error(capsys, *words):
    assert main(["fleet", *map(str, words)]) == 2
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    return line


def test_refused_options(cases, tmp_path, capsys):
    out = ("--out", tmp_path / "out")
    for words, message in (
        (("--workers", "0"), "`--workers` must be at least 1; got 0."),
        (("--memory", "4"), "`--memory` must be a size with a unit; got '4'."),
        (("--timeout", "0"), "`--timeout` must be positive; got 0 s."),
        (("--seed", "-1"), "`--seed` must be at least 0; got -1."),
        (("--scheduler", "tcp://h:1", "--memory", "1 GB"), "`--memory` is for the workers of this machine"),
        (("--stage", "fti"), "fti"),
    ):
        assert message in read_error(capsys, cases, *out, *words)
    assert not (tmp_path / "out").exists()
    assert "which does not exist as such" in read_error(capsys, tmp_path / "nowhere", *out)
    assert "got" in read_error(capsys, "status", tmp_path)
    assert "fleet.json" in read_error(capsys, "report", tmp_path)


def test_report_analyses_its_fleet_once(tmp_path, monkeypatch, capsys):
    from pamjax.fleet import analysis

    counts, analyse = [], analysis.analyse_fleet
    monkeypatch.setattr(analysis, "analyse_fleet", lambda fleet: counts.append(1) or analyse(fleet))
    store = write_made_store(tmp_path, [80.0, 90.0, 100.0])
    assert main(["fleet", "report", str(store)]) == 0
    assert "thread.modulus of made: 90" in capsys.readouterr().out
    assert counts == [1]


def test_second_run_in_one_store_is_refused(cases, tmp_path, capsys):
    from pamjax.cluster.run_fleet import lock_store
    from pamjax.fleet.store import FleetStore

    store = FleetStore(tmp_path / "out")
    from pamjax.fleet.plan import read_plan

    store.prepare()
    store.write_plan(read_plan([cases]))
    plan = (store.folder / "fleet.json").read_bytes()
    with lock_store(store):
        message = read_error(capsys, cases, "--out", store.folder, "--stage", "check")
    assert message.startswith(f"pamjax: only one `pamjax fleet` may write to {store.folder}; got another one")
    assert (store.folder / "fleet.json").read_bytes() == plan
