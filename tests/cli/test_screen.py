"""Interruptions end a command, even if a library catches them."""

import contextlib
import signal
import time

import jax
import pytest

import pamjax.cli.screen
import pamjax.compile.aot_cache
from pamjax.cli.screen import announce_compilation, defer_interrupts, print_written_files, show_progress
from pamjax.compile.aot_cache import load_or_compile


@pytest.fixture(autouse=True)
def defer(interruptible):
    with defer_interrupts():
        yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def raise_and_catch():
    """Raise and catch an interruption, as a callback during compilation does."""
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_caught_interruption_ends_the_next_step():
    steps = []
    with pytest.raises(KeyboardInterrupt), show_progress(quiet=True) as progress:  # noqa: PT012
        progress("one", 0.1)
        raise_and_catch()
        steps.append("between")
        progress("two", 0.2)
        steps.append("after")
    assert steps == ["between"]


def test_caught_interruption_ends_the_command_before_writing():
    with pytest.raises(KeyboardInterrupt), show_progress(quiet=True):
        raise_and_catch()


def test_interruption_before_the_first_step_ends_it():
    raise_and_catch()
    with pytest.raises(KeyboardInterrupt), show_progress(quiet=True) as progress:
        progress("one", 0.1)


def test_interruption_does_not_affect_the_next_command():
    raise_and_catch()
    with defer_interrupts(), show_progress(quiet=True) as progress:
        progress("one", 0.1)


def test_report_of_an_earlier_run_is_announced(tmp_path, capsys):
    (tmp_path / "report.html").write_text("")
    print_written_files([tmp_path / "fit.json"])
    assert f"{tmp_path / 'report.html'} is from an earlier run" in capsys.readouterr().err
    print_written_files([tmp_path / "fit.json", tmp_path / "report.html"])
    assert "is from an earlier" not in capsys.readouterr().err


def test_progress_without_a_terminal_is_a_line_from_time_to_time(capsys, monkeypatch):
    monkeypatch.setattr(pamjax.cli.screen, "SECONDS_BETWEEN_LINES", 0.05)
    with show_progress() as progress:
        progress("fitting", 0.25)
        time.sleep(0.12)
    lines = capsys.readouterr().err.splitlines()
    assert 1 <= len(lines) <= 2
    assert set(lines) == {"pamjax: fitting, 25 %, 0 s elapsed"}


def test_step_without_a_fraction_has_no_percentage(capsys, monkeypatch):
    monkeypatch.setattr(pamjax.cli.screen, "SECONDS_BETWEEN_LINES", 0.05)
    with show_progress() as progress:
        progress("fit, step 1 of 4: first fit", 0.0)
        time.sleep(0.12)
    assert "%" not in capsys.readouterr().err


def test_short_or_quiet_command_prints_no_progress(capsys, monkeypatch):
    with show_progress() as progress:
        progress("fitting", 0.25)
    monkeypatch.setattr(pamjax.cli.screen, "SECONDS_BETWEEN_LINES", 0.01)
    with show_progress(quiet=True) as progress:
        progress("fitting", 0.25)
        time.sleep(0.03)
    assert capsys.readouterr().err == ""


@pytest.fixture
def program_folder(tmp_path):
    """Use a temporary folder for compiled programs."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def store_program(home):
    def double(x):
        return 2 * x

    double.__module__ = home
    load_or_compile(jax.jit(double), jax.numpy.ones(3))


def test_first_compilation_is_announced(program_folder, capsys):
    line = "pamjax: compiling the model, about a minute, once on this machine\n"
    # The programs of an inverse command are not those of a diagnosis.
    store_program("pamjax.control.inverse")
    announce_compilation(program_folder, quiet=False)
    assert capsys.readouterr().err == line
    announce_compilation(program_folder, quiet=True)
    store_program("pamjax.diagnosis.library.library_problem")
    announce_compilation(program_folder, quiet=False)
    assert capsys.readouterr().err == ""


def test_programs_of_other_sources_do_not_count(program_folder, capsys, monkeypatch):
    store_program("pamjax.diagnosis.library.library_problem")
    monkeypatch.setattr(pamjax.compile.aot_cache, "_describe_tracer", lambda: "other sources")
    announce_compilation(program_folder, quiet=False)
    assert "once on this machine" in capsys.readouterr().err


def test_without_a_cache_folder_each_run_compiles(program_folder, capsys):
    jax.config.update("jax_compilation_cache_dir", None)
    announce_compilation(None, quiet=False)
    line = capsys.readouterr().err
    assert "in each run" in line
    assert "once" not in line
