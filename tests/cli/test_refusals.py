"""Invalid inputs give one error line, exit code 2, and no file."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import pamjax.infer.fitting.fit
from pamjax.cli.main import main

FITS = Path(__file__).parents[2] / "fits"
SPEC, PAPER = FITS / "sizing" / "lift-2kN.toml", FITS / "chambers_wereley_2022"


def read_error(words, capsys):
    """Return the only line on standard error."""
    assert main([str(word) for word in words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    assert line.startswith("pamjax: ")
    return line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check", "nowhere"], "got nowhere, which is not a folder. Check the path, or create a case with"),
        (["fit"], "`pamjax fit` needs `CASES`; got none. See `pamjax fit --help`."),
        (["fit", "mine", "--law"], "`--law` needs a value; got none. See `pamjax fit --help`."),
        (["fti"], "unknown command `fti` of `pamjax`. Did you mean `fit`?"),
        (
            ["bogus"],
            "Valid names are `new`, `import`, `check`, `fit`, `sample`, `compare`, `diagnose`, `validate`,",
        ),
        (["bogus"], "`plan`, `simulate`, `explain`."),
        (["--nonsense"], "unknown option `--nonsense` of `pamjax`. See `pamjax --help`."),
        (
            ["fit", "a", "--nonsense", "3"],
            "unknown option `--nonsense` of `pamjax fit`. See `pamjax fit --help`.",
        ),
        (["fit", "a", "--sede", "3"], "unknown option `--sede` of `pamjax fit`. Did you mean `--seed`?"),
        (["new", "a", "b"], "unexpected argument 'b' of `pamjax new`. See `pamjax new --help`."),
        (["explain", "bladder"], "Did you mean `bladder_elasticity`?"),
        (["prove", "--empty-correlation"], "unknown option `--empty-correlation` of `pamjax prove`."),
        (["explain", "thread.moduls"], "Did you mean `thread.modulus`?"),
        (["explain", "braid_frction"], "Did you mean `braid_friction`?"),
        (["explain", "nonsense"], "unknown parameter or mechanism 'nonsense'. `pamjax explain` lists"),
        (["explain", "nonsense", "--json"], "`pamjax explain` lists all names."),
        (["simulate", "nowhere", "--out", "x"], "the file nowhere does not exist. Check the path."),
        (["fit", "nowhere", "--loss", "hard"], 'Choose from: "square", "soft".'),
        (["fit", "nowhere", "--folds", "few"], "--folds"),
        (["size", SPEC, "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["plan", PAPER, "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["diagnose", PAPER, "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["prove", "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["inverse", "no.json", "--export", "x"], "pamjax: the file no.json does not exist."),
    ],
)
def test_invalid_arguments(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in read_error(words, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--law", "elastik"], "unknown thread law 'elastik'. Did you mean `elastic`?"),
        (["--share", "muscle.turns"], "`--share` needs several cases; got one case. Name"),
        (["--with", "braid_frction"], "Did you mean `braid_friction`?"),
        (["--gaps", "anwe"], "`gaps` must be carry or anew; got 'anwe'. Did you mean `anew`?"),
        (["--before", "rested"], "`before` must be relaxed or settled; got 'rested'."),
        (["--gaps", "mad=anew"], "unknown case 'mad' (--gaps). Did you mean `made`?"),
        (["--starts", "0"], "`starts` must be at least 1; got 0."),
        (["--folds", "1"], "`folds` must be at least 2; got 1."),
        (["--form-error"], "Include one, for example `--with braid_friction`."),
        (["--seed", "-1"], "`seed` must be at least 0; got -1."),
    ],
)
def test_invalid_options_of_fit(words, message, bench, capsys, tmp_path):
    assert message in read_error(["fit", bench / "made", "--out", tmp_path / "out", *words], capsys)
    assert not (tmp_path / "out").exists()


def test_shared_parameter_must_exist_in_all_cases(bench, case, capsys, tmp_path):
    words = ["fit", bench / "made", case(), "--share", "muscle.rest_length", "--out", tmp_path / "out"]
    assert "'muscle.rest_length' is not a free parameter, so it cannot be shared." in read_error(
        words, capsys
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"recording": ("force [N]", "force [kg]")}, "force"),
        ({"recording": ("pressure [kPa]", "pressure [psi]")}, "pressure in kPa under a header of psi"),
        ({"muscle": ("\nthread_length", "\nthread_lenght")}, "Did you mean `thread_length`?"),
        ({"muscle": ('"200 mm"', '"200 kg"')}, "rest_length"),
        ({"muscle": ("[thread]", "[tread]")}, "Did you mean `thread`?"),
    ],
)
@pytest.mark.parametrize("word", ["check", "fit"])
def test_invalid_files(word, change, message, case, capsys, tmp_path):
    out = ["--out", tmp_path / "out"] if word == "fit" else []
    assert message in read_error([word, case(**change), *out], capsys)
    assert not (tmp_path / "out").exists()


def test_recording_without_rows(case, capsys):
    folder = case()
    table = folder / "recording.csv"
    table.write_text(table.read_text().splitlines()[0] + "\n")
    assert "recording.csv" in read_error(["check", folder], capsys)


def test_cell_without_a_number(case, capsys):
    folder = case()
    table = folder / "recording.csv"
    lines = table.read_text().splitlines()
    lines[4] = lines[4].replace(lines[4].split(",")[3], "many")
    table.write_text("\n".join(lines) + "\n")
    line = read_error(["check", folder], capsys)
    assert "row 5" in line
    assert "many" in line


def test_new_refuses_a_folder_with_files(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert "a new case needs an empty folder" in read_error(["new", tmp_path], capsys)
    assert "a new fleet needs an empty folder" in read_error(["new", tmp_path, "--fleet"], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("out", ["file", "file/below"])
def test_fit_checks_its_output_folder_first(out, bench, tmp_path, capsys, monkeypatch):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(pamjax.infer.fitting.fit, "fit", None)
    line = read_error(["fit", bench / "made", "--out", tmp_path / out], capsys)
    assert "`--out` must be a writable folder" in line


WRITES = {
    "fit": ["fit", "{made}", "--out"],
    "sample": ["sample", "{made}", "--out"],
    "diagnose": ["diagnose", "{made}", "--out"],
    "plan": ["plan", "{stated}/muscle.toml", "--out"],
    "prove": ["prove", "--out"],
    "size": ["size", str(SPEC), "--out"],
    "inverse": ["inverse", "{stated}", "--export"],
    "simulate": ["simulate", "{stated}", "--out"],
    "new": ["new"],
}


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder here that root cannot write to")
@pytest.mark.parametrize("word", WRITES)
def test_folder_without_write_permission_gives_one_error_line(word, bench, capsys):
    words = [w.format(made=bench / "made", stated=bench / "stated") for w in WRITES[word]]
    line = read_error([*words, "/proc/pamjax"], capsys)
    assert "must be a writable folder" in line or "must be writable" in line


def test_disk_error_gives_one_error_line(bench, tmp_path, capsys):
    long = tmp_path / ("a" * 300)
    assert "File name too long" in read_error(
        ["plan", bench / "stated" / "muscle.toml", "--out", long], capsys
    )


@pytest.mark.parametrize(
    ("goal", "to", "message"),
    [
        (
            "thread.modulus",
            "5 kg",
            "this value must have a unit that converts to Pa; got 'kg' in `--to`",
        ),
        ("thread.modulus", "5 flurbs", "unknown unit 'flurbs' (`--to`). Write it in Pa."),
        ("muscle.turns", "3 mm", "a dimensionless value has no unit; got 'mm' in `--to`"),
    ],
)
def test_option_with_a_wrong_unit(goal, to, message, bench, tmp_path, capsys):
    words = ["plan", bench / "stated" / "muscle.toml", "--goal", goal, "--to", to, "--out", tmp_path]
    assert message in read_error(words, capsys)


def test_simulate_overwrites_no_file(bench, capsys):
    before = (bench / "made" / "recording.csv").read_bytes()
    line = read_error(["simulate", bench / "stated", bench / "plan.toml", "--out", bench / "made"], capsys)
    assert "a new case needs an empty folder" in line
    assert (bench / "made" / "recording.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--correlation-time", "3"], "a time needs a unit"),
        (["--correlation-time", "3 N"], "--correlation-time"),
        (["--seed", "-2"], "`seed` must be at least 0; got -2."),
        (["--case", "a"], "`--case` needs a fit.json"),
        (["--with", "force_offset.offset"], "must have the form mechanism.parameter=value"),
        (["--with", "force_offset.offset=5 kg"], "force_offset.offset"),
        (["--with", "force_offset.offset=5"], "needs a unit; got '5' in --with force_offset.offset."),
        (["--with", "bladder_elasticity.modulus=1"], "this value needs a unit; got '1' in --with"),
        (["--with", "nonsense=5"], "unknown parameter 'nonsense' (--with). `pamjax explain` lists"),
        (["--with", "braid_friction.coeficient=1"], "Did you mean `braid_friction.coefficient`?"),
        (["--with", "thread.modulus=5 GPa"], "only parameters of mechanisms can be set here"),
    ],
)
def test_invalid_options_of_simulate(words, message, bench, tmp_path, capsys):
    words = ["simulate", bench / "stated", bench / "plan.toml", "--out", tmp_path / "new", *words]
    assert message in read_error(words, capsys)
    assert not (tmp_path / "new").exists()


def test_interrupted_command_leaves_no_file(bench, tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(pamjax.infer.fitting.fit, "cross_validate", interrupted)
    assert main(["fit", str(bench / "made"), "--out", str(tmp_path / "out"), "--starts", "1"]) == 130
    assert capsys.readouterr().err.strip().endswith("pamjax: interrupted; no incomplete file was written")
    assert not (tmp_path / "out").exists()


def list_loaded_modules(*words):
    """Return the modules that a command line loads, and its exit code."""
    code = (
        "import sys; from pamjax.cli.main import main; code = main(sys.argv[1:]);"
        "names = ('jax', 'pandas', 'matplotlib', 'xarray', 'pint', 'optimistix');"
        "heavy = [m for m in names if m in sys.modules];"
        "print(code, *heavy, file=sys.stderr)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True, timeout=60
    )
    return process.stderr.splitlines()[-1]


@pytest.mark.parametrize("words", [["--help"], [], ["fit", "--help"], ["--version"]])
def test_help_loads_no_heavy_module(words):
    assert list_loaded_modules(*words) == "0"


def test_wrong_folder_is_refused_before_heavy_modules_load(tmp_path):
    assert list_loaded_modules("fit", str(tmp_path / "nowhere")).split() == ["2"]


@pytest.mark.skipif(os.name == "nt", reason="pipes")
@pytest.mark.parametrize("words", [["explain"], ["explain", "muscle.turns"]])
def test_closed_pipe_is_accepted(words):
    code = f"import sys; from pamjax.cli.main import main; sys.exit(main({words}))"
    running = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert running.stdout
    assert running.stderr
    running.stdout.close()
    output = running.stderr.read()
    running.stderr.close()
    assert running.wait(timeout=60) == 0, output
    assert b"Traceback" not in output
    assert b"BrokenPipe" not in output


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.slow
def test_ctrl_c_ends_the_command_at_any_time(bench, tmp_path):
    # If a shell starts the tests in the background, child processes ignore the signal.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heed}; from pamjax.cli import run; run()"
    words = ["fit", str(bench / "made"), "--out", str(tmp_path / "out"), "--starts", "1000"]
    running = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True)
    time.sleep(3.0)
    running.send_signal(signal.SIGINT)
    _, output = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "pamjax: interrupted" in output
    assert "Traceback" not in output


def test_check_loads_only_what_it_needs(bench):
    assert list_loaded_modules("check", str(bench / "made")) == "0 jax"
