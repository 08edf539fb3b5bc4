"""`pamjax new`: a commented case folder to fill in."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def new(folder: Path, /, *, json: Json = False) -> None:
    """Write a case folder to fill in; each entry says how it is measured.

    Args:
        folder: a folder that does not exist yet, or is empty.
        json: print for programs.
    """
    from pamjax.errors import refuse
    from pamjax.records.writing.template import write_template

    if folder.is_dir() and any(folder.iterdir()):
        raise refuse("a new case needs an empty folder", f"{folder}, which is not", remedy="Name another.")
    recording, muscle = write_template(folder)
    if json:
        print_json({"case": str(folder), "files": [muscle.name, recording.name]})
        return
    print_text(f"wrote {muscle} and {recording}: put your own numbers in")
    print_text(f"then: pamjax check {folder}")
