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
REPORT = "report.html"
#: The words of the command that runs, for reports that say how to repeat them.
_said: list[str] = []
#: Interruptions that were asked for.
_asked: list[int] = []


def heard(words: Sequence[str]) -> None:
    """Remember the words of a command."""
    _said[:] = words


def command() -> str:
    """What repeats the command that runs, in a shell."""
    return shlex.join(["pamjax", *_said])


@contextmanager
def working(quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """A progress bar with an estimate, on standard error; yields what a verb's `progress` takes."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description:<20}"), BarColumn(), TimeRemainingColumn()
    # Where nobody watches, a bar would leave blank lines in the log.
    shown = Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal)
    with shown as bar:
        task = bar.add_task("starting", total=1.0)

        def tell(doing: str, share: float) -> None:
            heed()
            bar.update(task, description=doing, completed=share)

        yield tell
        heed()


@contextmanager
def heeding() -> Iterator[None]:
    """Remember an interruption: what is raised inside a callback, as of an import, is swallowed there."""

    def remember(number: int, _: object) -> NoReturn:
        _asked.append(number)
        raise KeyboardInterrupt

    def quiet(swallowed: sys.UnraisableHookArgs) -> None:
        # It is told when it is heeded; here it would be a traceback.
        if not isinstance(swallowed.exc_value, KeyboardInterrupt):
            hook(swallowed)

    _asked.clear()
    hook = sys.unraisablehook
    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if ours:
        signal.signal(signal.SIGINT, remember)
        sys.unraisablehook = quiet
    try:
        yield
    finally:
        if ours:
            sys.unraisablehook = hook
            signal.signal(signal.SIGINT, before)


def heed() -> None:
    """Be interrupted, if that was asked for and swallowed."""
    if _asked:
        raise KeyboardInterrupt


def writable(folder: Path, what: str = "`--out`") -> None:
    """Refuse a folder that cannot be written to, or made.

    Raises:
        BadInput: naming what stands in the way.
    """
    from pamjax.records.files import takes_files

    nearest = folder.absolute()
    while not nearest.exists():
        nearest = nearest.parent
    if not nearest.is_dir() or not takes_files(nearest):
        raise refuse(
            f"{what} must be a folder to write to", f"{nearest}, which is none", remedy="Name another."
        )


def say(text: str) -> None:
    """Print for people."""
    print(text)


def say_json(document: Any) -> None:
    """Print for programs."""
    print(json.dumps(document, indent=2, allow_nan=False))


def say_written(files: list[Path]) -> None:
    """Tell what was written, folder by folder, and what lies beside it from an earlier run."""
    for folder in dict.fromkeys(file.parent for file in files):
        names = [file.name for file in files if file.parent == folder]
        print(f"wrote {folder}/: {', '.join(names)}", file=sys.stderr)
        if REPORT not in names and (folder / REPORT).exists():
            print(f"{folder / REPORT} is of an earlier run", file=sys.stderr)
