"""Time of a command: the first run, which compiles, and a second run.

    python -m tests.benchmarks.command diagnose CASE --no-report [--json FILE]

Each run is a new process; the first starts with an empty cache of compiled programs. A command with `--out`
writes to a temporary folder. The times are reported, and no test depends on them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from rich.console import Console
from rich.table import Table

from tests.benchmarks.keep import arguments, keep

RUNS = ("first, compiling", "again")

#: Commands without the option `--out`.
WITHOUT_OUT = ("check", "explain", "validate", "compare", "inverse")


def measure(words: list[str]) -> dict[str, tuple[float, float]]:
    """Return wall-clock and processor times of each run, s."""
    code = "import sys; from pamjax.cli.main import main; sys.exit(main(sys.argv[1:]))"
    times = {}
    with tempfile.TemporaryDirectory() as scratch:
        environment = os.environ | {"PAMJAX_CACHE_DIR": f"{scratch}/cache"}
        out = [] if words[0] in WITHOUT_OUT else ["--out", f"{scratch}/out"]
        for run in RUNS:
            before, begin = os.times(), time.perf_counter()
            subprocess.run([sys.executable, "-c", code, *words, *out], env=environment, check=True)
            clock, after = time.perf_counter() - begin, os.times()
            busy = after.children_user + after.children_system - before.children_user - before.children_system
            times[run] = (clock, busy)
    return times


def main() -> None:
    words, file = arguments()
    if not words:
        raise SystemExit(__doc__)
    times = measure(words)
    table = Table(f"pamjax {words[0]}", "clock", "processor")
    for run, (clock, busy) in times.items():
        table.add_row(run, f"{clock:.1f} s", f"{busy:.1f} s")
    Console().print(table)
    clocks = {f"{run}, clock [s]": clock for run, (clock, _) in times.items()}
    keep(file, clocks | {f"{run}, processor [s]": busy for run, (_, busy) in times.items()})


if __name__ == "__main__":
    main()
