"""Progress reports of long computations: a callback with the current step and the share done, 0 to 1."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]


def ignore_progress(step: str, fraction: float) -> None:
    """Ignore the progress."""
