"""`pamjax import`: make a case folder from the files of a test rig."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def import_(rig: Path, /, *, out: Path, json: Json = False) -> None:
    """Make a case folder from the CSV, XLSX or MAT files of a test rig, one file for each test or channel.

    Args:
        rig: TOML file that describes the files. It has the columns and their units, the muscle length in each
            test, the place of the sensor zeros, and how to reduce the samples.
        out: case folder to write; it must be empty or not exist yet.
        json: print one JSON document.
    """
    from pamjax.records.importing.importer import import_case

    import_result = import_case(rig, out)
    if json:
        print_json(import_result.as_dict())
    else:
        print_text(str(import_result))
        print_text(f"next: pamjax check {out}")
