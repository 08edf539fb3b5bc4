"""`pamjax import`: a case folder from what a rig really writes."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def import_(rig: Path, /, *, out: Path, json: Json = False) -> None:
    """Make a case folder from a rig's files, CSV or MAT, one file a test or a channel.

    Args:
        rig: TOML that says what the files look like: which column is which and in what unit, how long the
            muscle was in each test, where the zero is read, how samples are thinned.
        out: the case folder to write; must not exist, or be empty.
        json: print for programs.
    """
    from pamjax.records.importing.importer import import_case

    imported = import_case(rig, out)
    if json:
        print_json(imported.as_dict())
    else:
        print_text(str(imported))
        print_text(f"then: pamjax check {out}")
