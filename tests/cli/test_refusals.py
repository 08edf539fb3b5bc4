"""A bad input leaves one sentence, code 2, and no file."""

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


def refused(words, capsys):
    """The one line on standard error."""
    assert main([str(word) for word in words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("pamjax: ")
    return line


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["check", "nowhere"], "got nowhere, which is none. `pamjax new` makes one to fill in."),
        (["fit"], "requires an argument"),
        (["fti"], "`fti` is no command of `pamjax`. Did you mean `fit`?"),
        (
            ["bogus"],
            "Known are `new`, `import`, `check`, `fit`, `sample`, `compare`, `diagnose`, `validate`,",
        ),
        (["bogus"], "`plan`, `simulate`, `explain`."),
        (["--nonsense"], "`--nonsense` is no option of `pamjax`. See `pamjax --help`."),
        (
            ["fit", "a", "--nonsense", "3"],
            "`--nonsense` is no option of `pamjax fit`. See `pamjax fit --help`.",
        ),
        (["fit", "a", "--sede", "3"], "`--sede` is no option of `pamjax fit`. Did you mean `--seed`?"),
        (["check", "a", "b"], "`pamjax check` has no place for 'b'. See `pamjax check --help`."),
        (["prove", "--empty-correlation"], "is no option of `pamjax prove`."),
        (["explain", "thread.moduls"], "Did you mean `thread.modulus`?"),
        (["explain", "braid_frction"], "Did you mean `braid_friction`?"),
        (["explain", "nonsense"], "mechanism pamjax knows. `pamjax explain` lists what there is."),
        (["explain", "nonsense", "--json"], "`pamjax explain` lists what there is."),
        (["simulate", "nowhere", "--out", "x"], "there is no file nowhere. Check its path."),
        (["fit", "nowhere", "--loss", "hard"], 'Choose from: "square", "soft".'),
        (["fit", "nowhere", "--folds", "few"], "--folds"),
        (["size", SPEC, "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["plan", PAPER, "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["diagnose", PAPER, "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["prove", "--seed", "-1"], "`seed` must be at least 0; got -1."),
        (["inverse", "no.json", "--export", "x"], "pamjax: there is no file no.json."),
    ],
)
def test_wrong_words(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert told in refused(words, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--law", "elastik"], "'elastik' is no thread law. Did you mean `elastic`?"),
        (["--share", "muscle.turns"], "`--share` says what several cases have in common; got one case. Name"),
        (["--with", "braid_frction"], "Did you mean `braid_friction`?"),
        (["--gaps", "anwe"], "`gaps` is carry or anew; got 'anwe'. Did you mean `anew`?"),
        (["--before", "rested"], "`before` is relaxed or settled; got 'rested'."),
        (["--gaps", "mad=anew"], "'mad' is no case of this fit (--gaps). Did you mean `made`?"),
        (["--starts", "0"], "`starts` must be at least 1; got 0."),
        (["--seed", "-1"], "`seed` must be at least 0; got -1."),
    ],
)
def test_wrong_options_of_a_fit(words, told, bench, capsys, tmp_path):
    assert told in refused(["fit", bench / "made", "--out", tmp_path / "out", *words], capsys)
    assert not (tmp_path / "out").exists()


def test_two_cases_share_what_both_have(bench, case, capsys, tmp_path):
    words = ["fit", bench / "made", case(), "--share", "muscle.rest_length", "--out", tmp_path / "out"]
    assert "no case can move 'muscle.rest_length', so it cannot be shared." in refused(words, capsys)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"recording": ("force [N]", "force [kg]")}, "force"),
        ({"recording": ("pressure [kPa]", "pressure [psi]")}, "pressure in kPa under a header of psi"),
        ({"muscle": ("\nthread_length", "\nthread_lenght")}, "Did you mean `thread_length`?"),
        ({"muscle": ('"200 mm"', '"200 kg"')}, "rest_length"),
        ({"muscle": ("[thread]", "[tread]")}, "Did you mean `thread`?"),
    ],
)
@pytest.mark.parametrize("word", ["check", "fit"])
def test_wrong_files(word, change, told, case, capsys, tmp_path):
    out = ["--out", tmp_path / "out"] if word == "fit" else []
    assert told in refused([word, case(**change), *out], capsys)
    assert not (tmp_path / "out").exists()


def test_a_table_with_nothing_but_a_header(case, capsys):
    folder = case()
    table = folder / "recording.csv"
    table.write_text(table.read_text().splitlines()[0] + "\n")
    assert "recording.csv" in refused(["check", folder], capsys)


def test_a_cell_that_is_no_number(case, capsys):
    folder = case()
    table = folder / "recording.csv"
    lines = table.read_text().splitlines()
    lines[4] = lines[4].replace(lines[4].split(",")[3], "many")
    table.write_text("\n".join(lines) + "\n")
    line = refused(["check", folder], capsys)
    assert "row 5" in line
    assert "many" in line


def test_new_takes_no_folder_with_something_in_it(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert "a new case needs an empty folder" in refused(["new", tmp_path], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("out", ["file", "file/below"])
def test_a_fit_that_could_not_be_written_is_not_begun(out, bench, tmp_path, capsys, monkeypatch):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(pamjax.infer.fitting.fit, "fit", None)
    line = refused(["fit", bench / "made", "--out", tmp_path / out], capsys)
    assert "`--out` must be a folder to write to" in line


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
def test_a_place_that_takes_no_files_is_told_in_a_sentence(word, bench, capsys):
    words = [w.format(made=bench / "made", stated=bench / "stated") for w in WRITES[word]]
    line = refused([*words, "/proc/pamjax"], capsys)
    assert "must be a folder to write to" in line or "must be writable" in line


def test_what_the_disk_says_is_told_in_a_sentence(bench, tmp_path, capsys):
    long = tmp_path / ("a" * 300)
    assert "File name too long" in refused(["plan", bench / "stated" / "muscle.toml", "--out", long], capsys)


@pytest.mark.parametrize(
    ("goal", "to", "told"),
    [
        (
            "thread.modulus",
            "5 kg",
            "this number must be in Pa, or in a unit that converts to it; got 'kg' in --to",
        ),
        ("thread.modulus", "5 flurbs", "no unit that pamjax knows (--to). Write it in Pa."),
        ("muscle.turns", "3 mm", "this number has no unit; got 'mm' in --to"),
    ],
)
def test_a_wish_in_a_unit_of_something_else(goal, to, told, bench, tmp_path, capsys):
    words = ["plan", bench / "stated" / "muscle.toml", "--goal", goal, "--to", to, "--out", tmp_path]
    assert told in refused(words, capsys)


def test_a_simulated_case_overwrites_nothing(bench, capsys):
    before = (bench / "made" / "recording.csv").read_bytes()
    line = refused(["simulate", bench / "stated", bench / "plan.toml", "--out", bench / "made"], capsys)
    assert "a new case needs an empty folder" in line
    assert (bench / "made" / "recording.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--correlation-time", "3"], "a time needs a unit"),
        (["--correlation-time", "3 N"], "--correlation-time"),
        (["--seed", "-2"], "`seed` must be at least 0; got -2."),
        (["--case", "a"], "`--case` names a case of a fit.json"),
        (["--with", "force_offset.offset"], "is written id.number=value"),
        (["--with", "force_offset.offset=5 kg"], "force_offset.offset"),
        (["--with", "force_offset.offset=5"], "needs a unit; got '5' in --with force_offset.offset."),
        (["--with", "bladder_elasticity.modulus=1"], "this number needs a unit; got '1' in --with"),
        (["--with", "nonsense=5"], "'nonsense' is no number pamjax knows (--with). `pamjax explain` lists"),
        (["--with", "braid_friction.coeficient=1"], "Did you mean `braid_friction.coefficient`?"),
        (["--with", "thread.modulus=5 GPa"], "only numbers of mechanisms can be set here"),
    ],
)
def test_wrong_options_of_a_simulation(words, told, bench, tmp_path, capsys):
    words = ["simulate", bench / "stated", bench / "plan.toml", "--out", tmp_path / "new", *words]
    assert told in refused(words, capsys)
    assert not (tmp_path / "new").exists()


def test_an_interruption_leaves_nothing(bench, tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(pamjax.infer.fitting.fit, "cross_validate", interrupted)
    assert main(["fit", str(bench / "made"), "--out", str(tmp_path / "out"), "--starts", "1"]) == 130
    assert capsys.readouterr().err.strip().endswith("pamjax: interrupted; nothing was written half")
    assert not (tmp_path / "out").exists()


def loaded(*words):
    """What a command line loads, and its exit code."""
    code = (
        "import sys; from pamjax.cli.main import main; code = main(sys.argv[1:]);"
        "heavy = [m for m in ('jax', 'pandas', 'matplotlib', 'xarray') if m in sys.modules];"
        "print(code, *heavy, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True, timeout=60
    )
    return done.stderr.splitlines()[-1]


@pytest.mark.parametrize("words", [["--help"], [], ["fit", "--help"], ["--version"]])
def test_help_loads_nothing_heavy(words):
    assert loaded(*words) == "0"


def test_a_wrong_folder_is_told_before_anything_heavy_loads(tmp_path):
    assert loaded("fit", str(tmp_path / "nowhere")).split() == ["2"]


@pytest.mark.skipif(os.name == "nt", reason="pipes")
@pytest.mark.parametrize("words", [["explain"], ["explain", "muscle.turns"]])
def test_a_reader_may_have_enough(words):
    code = f"import sys; from pamjax.cli.main import main; sys.exit(main({words}))"
    running = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert running.stdout
    assert running.stderr
    running.stdout.close()
    said = running.stderr.read()
    running.stderr.close()
    assert running.wait(timeout=60) == 0, said
    assert b"Traceback" not in said
    assert b"BrokenPipe" not in said


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.slow
def test_ctrl_c_at_any_time(bench, tmp_path):
    # A shell that starts the tests in the background has its children ignore the signal.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heed}; from pamjax.cli import run; run()"
    words = ["fit", str(bench / "made"), "--out", str(tmp_path / "out"), "--starts", "1000"]
    running = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True)
    time.sleep(3.0)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "pamjax: interrupted" in said
    assert "Traceback" not in said
