"""Progress of a fleet: a bar with an estimate in a terminal, else a line from time to time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from pamjax.cli.screen import raise_interrupt
from pamjax.fleet.store import REFUSED, SET_ASIDE

if TYPE_CHECKING:
    from pamjax.cluster.run_fleet import RunProgress

#: Time between two lines outside a terminal, s.
_LINE_INTERVAL = 60.0


@contextmanager
def show_fleet_progress() -> Iterator[Callable[[RunProgress], None]]:
    """Show the progress on standard error; yield the callback."""
    console = Console(stderr=True)
    columns = BarColumn(), TextColumn("{task.description}")
    printed_at = time.monotonic()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting workers", total=1.0)

        def report_progress(progress: RunProgress) -> None:
            nonlocal printed_at
            raise_interrupt()
            text = _format_progress(progress)
            bar.update(task, description=text, completed=progress.finished / max(progress.total, 1))
            if not console.is_terminal and time.monotonic() - printed_at >= _LINE_INTERVAL:
                printed_at = time.monotonic()
                print(text, file=sys.stderr, flush=True)

        yield report_progress


def _format_progress(progress: RunProgress) -> str:
    """Return the numbers of a run in one line."""
    text = f"{progress.finished} of {progress.total} tasks"
    for state in (REFUSED, SET_ASIDE):
        if progress.states[state]:
            text += f", {progress.states[state]} {state}"
    left = progress.seconds_left
    return text if left is None else f"{text}, about {_format_duration(left)} left"


def _format_duration(seconds: float) -> str:
    """Return a duration as text.

    >>> _format_duration(20), _format_duration(600), _format_duration(7200)
    ('20 s', '10 min', '2.0 h')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
