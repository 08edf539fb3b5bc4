"""`pamjax new`: a commented case folder to fill in."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.screen import say


def new(folder: Path, /) -> None:
    """Write a case folder to fill in; each entry says how it is measured.

    Args:
        folder: a folder that does not exist yet, or is empty.
    """
    from pamjax.check import refuse
    from pamjax.records.template import write_template

    if folder.is_dir() and any(folder.iterdir()):
        raise refuse("a new case needs an empty folder", f"{folder}, which is not", remedy="Name another.")
    write_template(folder)
    say(f"wrote {folder}/muscle.toml and {folder}/recording.csv: put your own numbers in")
    say(f"then: pamjax check {folder}")
