"""Command-line arguments that the scripts of this folder share."""

from __future__ import annotations

import argparse
from pathlib import Path


def build_parser(description: str | None, writes: bool = True) -> argparse.ArgumentParser:
    """Return a parser for the folder of cases and, if the script writes files, for `--out`.

    Args:
        description: docstring of the script.
        writes: whether the script writes files.
    """
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=description, formatter_class=style)
    parser.add_argument("cases", type=Path, help="folder that contains one case folder per hose")
    if writes:
        default = Path("out/portland_hose")
        parser.add_argument("--out", type=Path, default=default, help="folder for the results")
    return parser


def list_cases(folder: Path) -> list[Path]:
    """Return the case folders in a folder, sorted by name."""
    return sorted(path.parent for path in folder.glob("*/muscle.toml"))
