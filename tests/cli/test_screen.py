"""An interruption is heeded, even where what was running swallowed it."""

import contextlib
import signal

import pytest

from pamjax.cli.screen import defer_interrupts, print_written_files, show_progress


@pytest.fixture(autouse=True)
def heeded(interruptible):
    with defer_interrupts():
        yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def swallowed():
    """As a callback in the midst of a compilation does."""
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_an_interruption_that_was_swallowed_ends_the_next_step():
    steps = []
    with pytest.raises(KeyboardInterrupt), show_progress(quiet=True) as progress:  # noqa: PT012
        progress("one", 0.1)
        swallowed()
        steps.append("between")
        progress("two", 0.2)
        steps.append("after")
    assert steps == ["between"]


def test_it_ends_the_work_before_anything_is_written():
    with pytest.raises(KeyboardInterrupt), show_progress(quiet=True):
        swallowed()


def test_what_was_swallowed_before_the_work_ends_it_at_once():
    swallowed()
    with pytest.raises(KeyboardInterrupt), show_progress(quiet=True) as progress:
        progress("one", 0.1)


def test_a_command_does_not_remember_the_one_before():
    swallowed()
    with defer_interrupts(), show_progress(quiet=True) as progress:
        progress("one", 0.1)


def test_a_report_of_an_earlier_run_is_told(tmp_path, capsys):
    (tmp_path / "report.html").write_text("")
    print_written_files([tmp_path / "fit.json"])
    assert f"{tmp_path / 'report.html'} is of an earlier run" in capsys.readouterr().err
    print_written_files([tmp_path / "fit.json", tmp_path / "report.html"])
    assert "is of an earlier" not in capsys.readouterr().err
