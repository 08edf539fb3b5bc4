"""Progress reports of long computations: a callback with step and completed fraction, 0 to 1."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]


def ignore_progress(step: str, fraction: float) -> None:
    """Do nothing; for callers without a progress display."""
