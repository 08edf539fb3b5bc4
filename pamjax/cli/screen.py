"""What a command shows while it works and when it is done."""

from __future__ import annotations

import json
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from pamjax.errors import refuse

#: The page that most commands write, unless told not to.
REPORT_FILE = "report.html"
#: The words of the command that runs, for reports that say how to repeat them.
_command_words: list[str] = []
#: Interruptions that were asked for.
_interrupts: list[int] = []


def remember_command(words: Sequence[str]) -> None:
    """Remember the words of a command."""
    _command_words[:] = words


def format_command() -> str:
    """What repeats the command that runs, in a shell."""
    return shlex.join(["pamjax", *_command_words])


@contextmanager
def show_progress(quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """A progress bar with an estimate, on standard error; yields what a verb's `progress` takes."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description:<20}"), BarColumn(), TimeRemainingColumn()
    # Where nobody watches, a bar would leave blank lines in the log.
    progress_bar = Progress(
        *columns, console=console, transient=True, disable=quiet or not console.is_terminal
    )
    with progress_bar as bar:
        task = bar.add_task("starting", total=1.0)

        def report_progress(doing: str, share: float) -> None:
            raise_interrupt()
            bar.update(task, description=doing, completed=share)

        yield report_progress
        raise_interrupt()


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Remember an interruption: what is raised inside a callback, as of an import, is swallowed there."""

    def remember(number: int, _: object) -> NoReturn:
        _interrupts.append(number)
        raise KeyboardInterrupt

    def ignore_interrupt(swallowed: sys.UnraisableHookArgs) -> None:
        # It is told when it is heeded; here it would be a traceback.
        if not isinstance(swallowed.exc_value, KeyboardInterrupt):
            hook(swallowed)

    _interrupts.clear()
    hook = sys.unraisablehook
    before = signal.getsignal(signal.SIGINT)
    handles_interrupts = (
        before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    )
    if handles_interrupts:
        signal.signal(signal.SIGINT, remember)
        sys.unraisablehook = ignore_interrupt
    try:
        yield
    finally:
        if handles_interrupts:
            sys.unraisablehook = hook
            signal.signal(signal.SIGINT, before)


def raise_interrupt() -> None:
    """Be interrupted, if that was asked for and swallowed."""
    if _interrupts:
        raise KeyboardInterrupt


def check_writable(folder: Path, what: str = "`--out`") -> None:
    """Refuse a folder that cannot be written to, or made.

    Raises:
        BadInput: naming what stands in the way.
    """
    from pamjax.records.files import is_writable

    nearest = folder.absolute()
    while not nearest.exists():
        nearest = nearest.parent
    if not nearest.is_dir() or not is_writable(nearest):
        raise refuse(
            f"{what} must be a folder to write to", f"{nearest}, which is none", remedy="Name another."
        )


def print_text(text: str) -> None:
    """Print for people."""
    print(text)


def print_json(document: Any) -> None:
    """Print for programs."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_written_files(files: list[Path]) -> None:
    """Tell what was written, folder by folder, and what lies beside it from an earlier run."""
    for folder in dict.fromkeys(file.parent for file in files):
        names = [file.name for file in files if file.parent == folder]
        print(f"wrote {folder}/: {', '.join(names)}", file=sys.stderr)
        if REPORT_FILE not in names and (folder / REPORT_FILE).exists():
            print(f"{folder / REPORT_FILE} is of an earlier run", file=sys.stderr)
