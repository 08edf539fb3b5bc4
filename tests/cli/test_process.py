"""Streams, signals and devices of the process: each problem is one line, and no result is lost."""

import os
import signal
import subprocess
import sys
import time

import pytest

from pamjax.cli.main import main
from pamjax.cli.process import replace_characters

pytestmark = pytest.mark.slow

START = [sys.executable, "-m", "pamjax"]
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def run(*words, **settings):
    return subprocess.run(
        [*START, *map(str, words)],
        capture_output=True,
        encoding=settings.get("PYTHONIOENCODING", "utf-8"),
        env={**os.environ, **settings},
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize(
    "settings", [C_LOCALE, {"PYTHONIOENCODING": "cp1252"}, {"PYTHONIOENCODING": "ascii"}]
)
def test_narrow_encoding_replaces_characters(settings, bench):
    process = run("check", bench / "made", **settings)
    assert process.returncode == 0
    assert process.stderr == ""
    assert "mm prior" in process.stdout
    assert "Traceback" not in process.stdout


def test_error_message_in_a_narrow_encoding(tmp_path):
    process = run("check", tmp_path / "Kräfte-→", **C_LOCALE)
    assert process.returncode == 2
    assert "Traceback" not in process.stderr


def test_other_errors_of_an_encoding_are_raised():
    error = UnicodeDecodeError("ascii", b"\xff", 0, 1, "no ASCII")
    with pytest.raises(UnicodeDecodeError):
        replace_characters(error)


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
@pytest.mark.parametrize("closing", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_stream_is_no_error(closing):
    words = " ".join([*START, "explain", "thread.modulus", closing])
    process = subprocess.run(words, shell=True, capture_output=True, text=True, timeout=60, check=False)
    assert process.returncode == 0
    assert process.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_full_disk_for_the_output_is_one_line():
    with open("/dev/full", "w") as full:
        process = subprocess.run(
            [*START, "explain"], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert process.returncode == 2
    assert process.stderr == (
        "pamjax: cannot read or write a file: No space left on device. Use another path.\n"
    )


@pytest.mark.skipif(os.name == "nt", reason="needs a limit of the size of files")
def test_file_above_the_limit_of_its_size_is_one_line(tmp_path):
    program = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "from pamjax.__main__ import run; run()"
    )
    words = [sys.executable, "-c", program, "new", str(tmp_path / "mine")]
    process = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert process.returncode == 2
    assert process.stderr.startswith("pamjax: cannot read or write a file: File too large")
    assert len(process.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_platform_without_a_device_is_one_line(bench):
    process = run("check", bench / "made", JAX_PLATFORMS="no_such_platform")
    assert process.returncode == 2
    assert process.stderr == (
        "pamjax: JAX must have a device of the platform in JAX_PLATFORMS; got 'no_such_platform' in the"
        " environment, without such a device. Unset JAX_PLATFORMS, or write JAX_PLATFORMS=cpu.\n"
    )


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_signal_ends_a_command_with_one_line(number, code, word, bench, tmp_path):
    # A shell that starts the tests in the background makes child processes ignore Ctrl-C.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{heed}; from pamjax.__main__ import run; run()"
    words = ["fit", str(bench / "made"), "--out", str(tmp_path / "out"), "--starts", "1000"]
    running = subprocess.Popen([sys.executable, "-c", program, *words], stderr=subprocess.PIPE, text=True)
    time.sleep(2.0)
    running.send_signal(number)
    _, output = running.communicate(timeout=60)
    assert running.returncode == code
    assert output == f"pamjax: {word}; no incomplete file was written\n"
    assert not (tmp_path / "out").exists()


def test_interruption_while_modules_load_is_one_line():
    # The finder interrupts the import of the command line, as Ctrl-C does.
    program = (
        "import sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name == 'cyclopts': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Finder())\n"
        "from pamjax.__main__ import run; run()"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert process.returncode == 130
    assert process.stderr == "pamjax: interrupted; no incomplete file was written\n"


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
def test_interruption_after_the_last_output_is_no_error():
    program = (
        "import atexit, os, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "atexit.register(os.kill, os.getpid(), signal.SIGINT)\n"
        "from pamjax.__main__ import run; run()"
    )
    words = [sys.executable, "-c", program, "explain", "thread.modulus"]
    process = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize(("chosen", "platform"), [(None, "cpu"), ("cuda", "cuda")])
def test_command_uses_the_cpu_unless_the_user_chose_a_platform(chosen, platform, monkeypatch):
    monkeypatch.delenv("JAX_PLATFORM_NAME", raising=False)
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    if chosen:
        monkeypatch.setenv("JAX_PLATFORMS", chosen)
    assert main(["explain", "braid_friction"]) == 0
    assert os.environ["JAX_PLATFORMS"] == platform
