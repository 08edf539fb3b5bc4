"""Time and memory of what a user waits for, as listed in docs/performance.md.

    python -m tests.benchmarks.targets [--json FILE]

Each row is a new process. The recordings are simulated: strokes of the example of `pamjax new` at ten
pressures, with noise and friction of the braid, at the sampling rate that gives the number of rows. It needs
a quiet machine and about four minutes. The times are reported, and no test depends on them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tests.benchmarks.command import Cost, run_command
from tests.benchmarks.keep import arguments, keep

ROOT = Path(__file__).resolve().parents[2]
PAPER = ROOT / "fits" / "chambers_wereley_2022"

#: Pressures of the isobars, psi.
PRESSURES = range(10, 101, 10)

PROTOCOL = """\
[protocol]
kind = "strokes"
pressures = [{pressures}]
contractions = [0.15]
speed = "1.57 mm/s"
cycles = 1
rate = "{rate:.6g} Hz"
"""


def write_recording(folder: Path, rows: int, cache: str) -> Path:
    """Write a simulated case with about this many rows, and return its folder."""
    slow = _simulate(folder / f"{rows}-slow", 1.0, cache)
    with (slow / "recording.csv").open() as file:
        at_one_hertz = sum(1 for _ in file) - 1
    return _simulate(folder / str(rows), rows / at_one_hertz, cache)


def _simulate(folder: Path, rate: float, cache: str) -> Path:
    """Simulate in another process: the peak memory of a process includes that of its parent."""
    protocol = folder.with_suffix(".toml")
    pressures = ", ".join(f'"{psi} psi"' for psi in PRESSURES)
    protocol.write_text(PROTOCOL.format(rate=rate, pressures=pressures))
    stated = folder.parent / "stated"
    if not stated.exists():
        run_command(["new", stated], cache)
    run_command(
        ["simulate", stated, protocol, "--with", "braid_friction.coefficient=0.1", "--out", folder], cache
    )
    return folder


def measure(folder: Path) -> Iterator[tuple[str, Cost]]:
    """Yield each label with its cost.

    Args:
        folder: an empty folder for recordings, results and compiled programs.
    """
    cache = str(folder / "cache")
    fit = folder / "fit"
    for run in ("first", "again"):
        yield f"fit of the paper's case, {run}", run_command(["fit", PAPER, "--out", fit], cache)
    words = ["inverse", fit / "fit.json", "--force", "300 N", "--length", "170 mm"]
    yield "inverse, one number", run_command(words, cache)
    yield "inverse --export", run_command(["inverse", fit / "fit.json", "--export", folder / "robot"], cache)
    for rows in (6607, 10**6):
        yield f"check of {rows:,} rows", run_command(["check", write_recording(folder, rows, cache)], cache)
    recording = write_recording(folder, 10**5, cache)
    yield "fit of 100,000 rows", run_command(["fit", recording, "--out", folder / "long"], cache)
    recording = write_recording(folder, 5000, cache)
    for run in ("first", "again"):
        words = ["diagnose", recording, "--out", folder / "diagnosis"]
        yield f"diagnosis of 5,000 rows, {run}", run_command(words, cache)


def main() -> None:
    words, file = arguments()
    if words:
        raise SystemExit(__doc__)
    table = Table("what", "clock", "processor", "memory")
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for label, cost in measure(Path(scratch)):
            print(label, cost, file=sys.stderr, flush=True)
            table.add_row(label, f"{cost.clock:.1f} s", f"{cost.processor:.1f} s", f"{cost.memory:.0f} MB")
            figures |= cost.list_figures(label)
            keep(file, figures)
    Console().print(table)


if __name__ == "__main__":
    main()
