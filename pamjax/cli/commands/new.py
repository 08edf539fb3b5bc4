"""`pamjax new`: write a commented case folder as a template, or an example of a fleet."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def new(folder: Path, /, *, fleet: bool = False, json: Json = False) -> None:
    """Write a case folder as a template; a comment at each entry explains how to measure it.

    Args:
        folder: case folder to write; it must be empty or not exist yet.
        fleet: write an example of a fleet instead: simulated recordings on two rigs, and FLEET.toml.
        json: print one JSON document.
    """
    from pamjax.errors import BadInput
    from pamjax.records.writing.template import write_template

    if fleet:
        _write_fleet(folder, json)
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise BadInput.from_rule(
            "a new case needs an empty folder", f"{folder}, which has files", remedy="Choose another folder."
        )
    recording, muscle = write_template(folder)
    if json:
        print_json({"case": str(folder), "files": [muscle.name, recording.name]})
        return
    print_text(f"wrote {muscle} and {recording}: replace the values by yours")
    print_text(f"next: pamjax check {folder}")


def _write_fleet(folder: Path, json: bool) -> None:
    """Write the example of a fleet, and print what to do next."""
    from pamjax.records.writing.example_fleet import write_example_fleet

    file = write_example_fleet(folder)
    if json:
        print_json({"fleet": str(file)})
        return
    print_text(f"wrote {file} and the simulated recordings of two rigs")
    print_text(f"next: pamjax fleet {file} --out store")
