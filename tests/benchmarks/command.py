"""Time and memory of a command: the first run, which compiles, and a second run.

    python -m tests.benchmarks.command diagnose CASE --no-report [--json FILE]

Each run is a new process; the first starts with an empty cache of compiled programs. A command with `--out`
writes to a temporary folder. The times are reported, and no test depends on them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from tests.benchmarks.keep import arguments, keep

RUNS = ("first, compiling", "again")

#: Commands without the option `--out`.
WITHOUT_OUT = ("check", "explain", "validate", "compare", "inverse")


#: Program of each run, so that the command's start is measured too.
PROGRAM = "import sys; from pamjax.cli.main import main; sys.exit(main(sys.argv[1:]))"

#: Program that starts a run and prints its exit code, clock and processor time (s) and memory (MB). Linux
#: counts the memory of the process that starts a run as the run's own: this one has some MB.
MEASURE = """
import os, subprocess, sys, time
begin = time.perf_counter()
run = subprocess.Popen([sys.executable, "-c", *sys.argv[1:]], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(run.pid, 0)
clock = time.perf_counter() - begin
print(os.waitstatus_to_exitcode(status), clock, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


@dataclass(frozen=True)
class Cost:
    """What one run of a command takes.

    Attributes:
        clock: time from start to end, s.
        processor: time of all its threads, s.
        memory: largest memory of the process, MB.
    """

    clock: float
    processor: float
    memory: float

    def list_figures(self, label: str) -> dict[str, float]:
        """Return the numbers by label."""
        return {
            f"{label}, clock [s]": self.clock,
            f"{label}, processor [s]": self.processor,
            f"{label}, peak memory [MB]": self.memory,
        }


def run_command(words: Sequence[object], cache: str) -> Cost:
    """Run a command of pamjax as a new process, and return its cost; stop if it fails.

    Args:
        words: its arguments.
        cache: folder of the compiled programs.
    """
    command = [sys.executable, "-c", MEASURE, PROGRAM, *map(str, words)]
    environment = os.environ | {"PAMJAX_CACHE_DIR": cache}
    measured = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    code, clock, processor, memory = measured.stdout.split()
    if int(code):
        raise SystemExit(f"pamjax {words[0]} failed with exit code {code}")
    return Cost(float(clock), float(processor), float(memory))


def measure(words: Sequence[object]) -> dict[str, Cost]:
    """Return the cost of a first run, with an empty cache of programs, and of a second one."""
    with tempfile.TemporaryDirectory() as scratch:
        out = [] if words[0] in WITHOUT_OUT else ["--out", f"{scratch}/out"]
        return {run: run_command([*words, *out], f"{scratch}/cache") for run in RUNS}


def main() -> None:
    words, file = arguments()
    if not words:
        raise SystemExit(__doc__)
    costs = measure(words)
    table = Table(f"pamjax {words[0]}", "clock", "processor", "memory")
    for run, cost in costs.items():
        table.add_row(run, f"{cost.clock:.1f} s", f"{cost.processor:.1f} s", f"{cost.memory:.0f} MB")
    Console().print(table)
    keep(file, {k: v for run, cost in costs.items() for k, v in cost.list_figures(run).items()})


if __name__ == "__main__":
    main()
