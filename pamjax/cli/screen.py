"""Output of a command: progress bar, text, JSON and list of written files; handling of interruptions."""

from __future__ import annotations

import json
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from pamjax.errors import BadInput

#: Name of the report that most commands write.
REPORT_FILE = "report.html"
#: Time between two lines of progress outside a terminal, s.
SECONDS_BETWEEN_LINES = 10.0
#: Arguments of the running command, printed in reports to repeat it.
_command_words: list[str] = []
#: Received interruptions.
_interrupts: list[int] = []


def store_command(words: Sequence[str]) -> None:
    """Store the arguments of a command."""
    _command_words[:] = words


def format_command() -> str:
    """Return the running command as text for a shell."""
    return shlex.join(["pamjax", *_command_words])


@contextmanager
def show_progress(quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar on standard error; yield the callback for the argument `progress`."""
    console = Console(stderr=True)
    if not quiet and not console.is_terminal:
        with _print_steps() as report_step:
            yield report_step
            raise_interrupt()
        return
    columns = TextColumn("{task.description:<20}"), BarColumn(), TimeRemainingColumn()
    progress_bar = Progress(*columns, console=console, transient=True, disable=quiet)
    with progress_bar as bar:
        task = bar.add_task("starting", total=1.0)

        def report_progress(step: str, fraction: float) -> None:
            raise_interrupt()
            bar.update(task, description=step, completed=fraction)

        yield report_progress
        raise_interrupt()


@contextmanager
def _print_steps() -> Iterator[Callable[[str, float], None]]:
    """Print a line with the present step every ten seconds: a log file has no bar."""
    state = {"step": "starting", "fraction": 0.0}
    start, is_finished = time.monotonic(), threading.Event()

    def report_progress(step: str, fraction: float) -> None:
        raise_interrupt()
        state.update(step=step, fraction=fraction)

    def print_lines() -> None:
        # A thread of its own, because a compilation reports no progress.
        while not is_finished.wait(SECONDS_BETWEEN_LINES):
            elapsed = time.monotonic() - start
            percent = 100 * float(state["fraction"])
            # Within a compilation no fraction is known: 0 % would read as no progress.
            share = f", {percent:.0f} %" if percent >= 1 else ""
            print(f"pamjax: {state['step']}{share}, {elapsed:.0f} s elapsed", file=sys.stderr, flush=True)

    printer = threading.Thread(target=print_lines, daemon=True)
    printer.start()
    try:
        yield report_progress
    finally:
        is_finished.set()
        printer.join()


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Record interruptions: an exception raised inside a callback, for example of an import, gets lost."""

    def record_interrupt(number: int, _: object) -> NoReturn:
        _interrupts.append(number)
        raise KeyboardInterrupt

    def ignore_interrupt(unraisable: sys.UnraisableHookArgs) -> None:
        # `raise_interrupt` raises it later; the default hook would print a traceback here.
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            hook(unraisable)

    _interrupts.clear()
    hook = sys.unraisablehook
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        defaults = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
        # Another handler, as in a notebook, has precedence.
        handlers = {number: h for number, h in defaults.items() if signal.getsignal(number) is h}
    for number in handlers:
        signal.signal(number, record_interrupt)
    if handlers:
        sys.unraisablehook = ignore_interrupt
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if handlers:
            sys.unraisablehook = hook


def is_terminated() -> bool:
    """Return whether another process terminated the command, for example a batch system."""
    return signal.SIGTERM in _interrupts


def raise_interrupt() -> None:
    """Raise an interruption that was recorded but got lost."""
    if _interrupts:
        raise KeyboardInterrupt


def check_writable(folder: Path, label: str = "`--out`") -> None:
    """Check that a folder can be created or written to.

    Raises:
        BadInput: with the path that prevents it.
    """
    from pamjax.records.files import is_writable

    existing_parent = folder.absolute()
    while not existing_parent.exists():
        existing_parent = existing_parent.parent
    if not existing_parent.is_dir() or not is_writable(existing_parent):
        raise BadInput.from_rule(
            f"{label} must be a writable folder",
            f"{existing_parent}, which is not",
            remedy="Choose another folder.",
        )


def announce_compilation(folder: Path | None, quiet: bool) -> None:
    """Print one line before the first diagnosis on a machine, because it compiles the model.

    Args:
        folder: the folder for compiled programs; None if each process compiles its own.
        quiet: whether to print nothing.
    """
    from pamjax.compile.aot_cache import has_programs

    if quiet or has_programs("pamjax.diagnosis"):
        return
    repetition = "once on this machine" if folder else "in each run, because it has no folder for programs"
    print(f"pamjax: compiling the model, about a minute, {repetition}", file=sys.stderr, flush=True)


def print_text(text: str) -> None:
    """Print text for the user."""
    print(text)


def print_json(document: Any) -> None:
    """Print one JSON document for other programs."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_written_files(files: list[Path]) -> None:
    """Print the written files of each folder, and a note about a report of an earlier run."""
    for folder in dict.fromkeys(file.parent for file in files):
        names = [file.name for file in files if file.parent == folder]
        print(f"wrote {folder}/: {', '.join(names)}", file=sys.stderr)
        if REPORT_FILE not in names and (folder / REPORT_FILE).exists():
            print(f"{folder / REPORT_FILE} is from an earlier run", file=sys.stderr)
