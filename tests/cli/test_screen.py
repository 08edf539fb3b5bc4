"""Interruptions end a command, even if a library catches them."""

import contextlib
import signal
import time

import pytest

import pamjax.cli.screen
from pamjax.cli.screen import announce_compilation, defer_interrupts, print_written_files, show_progress


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
    assert set(lines) == {"pamjax: fitting, 25 % after 0 s"}


def test_short_or_quiet_command_prints_no_progress(capsys, monkeypatch):
    with show_progress() as progress:
        progress("fitting", 0.25)
    monkeypatch.setattr(pamjax.cli.screen, "SECONDS_BETWEEN_LINES", 0.01)
    with show_progress(quiet=True) as progress:
        progress("fitting", 0.25)
        time.sleep(0.03)
    assert capsys.readouterr().err == ""


def test_first_compilation_is_announced(tmp_path, capsys):
    announce_compilation(tmp_path, quiet=False)
    line = "pamjax: compiling the model, one to three minutes, once on this machine\n"
    assert capsys.readouterr().err == line
    (tmp_path / "traced").mkdir()
    (tmp_path / "traced" / "a.stablehlo").write_text("")
    announce_compilation(tmp_path, quiet=False)
    announce_compilation(tmp_path / "other", quiet=True)
    assert capsys.readouterr().err == ""
