"""Start of the command `pamjax`. An interruption while Python loads modules also prints one line."""

from __future__ import annotations

import os
import sys
from typing import NoReturn


def run() -> NoReturn:
    """Run the command line on the arguments of the process, and exit with its code."""
    try:
        from pamjax.cli.main import run as run_command
    except KeyboardInterrupt:
        if sys.stderr is not None:
            print("pamjax: interrupted; no incomplete file was written", file=sys.stderr, flush=True)
        os._exit(130)
    run_command()


if __name__ == "__main__":
    run()
