"""The words that every script of this folder takes."""

from __future__ import annotations

import argparse
from pathlib import Path


def taker(about: str | None, writes: bool = True) -> argparse.ArgumentParser:
    """A parser for the folder with the cases and, where something is written, the one for results.

    Args:
        about: the script's own docstring.
        writes: whether it writes.
    """
    style = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=style)
    parser.add_argument("cases", type=Path, help="folder with a folder for each case")
    if writes:
        usual = Path("out/portland_hose")
        parser.add_argument("--out", type=Path, default=usual, help="folder for the results")
    return parser
