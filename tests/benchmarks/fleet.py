"""Time of a fleet: small simulated cases with one and two workers, and the overhead of a task.

    python -m tests.benchmarks.fleet [CASES] [EMPTY_TASKS] [--json FILE]

The cases have four isobars of 61 rows of a simulated muscle each, with different noise. The stages are check
and fit, without figures and reports. Two workers run all cases, and one worker a fifth of them. Then one
worker runs all cases in another store, while the command is killed at ten random moments and started again.
The files of both stores are compared. The overhead is measured with tasks that only return. The times are
reported, and no test depends on them.
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from pamjax.cli.main import main as run_command
from pamjax.cluster.connect import start_cluster
from pamjax.cluster.engine import TaskChain, TaskEngine
from pamjax.cluster.run_fleet import list_open_chains, run_chains
from pamjax.fleet.plan import read_plan
from pamjax.fleet.store import FleetStore, TaskOutcome
from pamjax.fleet.tables import build_tables
from pamjax.fleet.task import FleetTask
from tests.benchmarks.keep import arguments, keep
from tests.faults.read_back import find_differences, list_results

PROTOCOL = """\
[protocol]
kind = "strokes"
pressures = ["100 kPa", "250 kPa", "450 kPa", "600 kPa"]
contractions = [0.2]
speed = "1.57 mm/s"
cycles = 1
"""


def write_cases(folder: Path, count: int) -> None:
    """Write cases that differ in the noise of their force."""
    (folder / "plan.toml").write_text(PROTOCOL)
    run_command(["new", str(folder / "stated")])
    words = [str(folder / "stated"), str(folder / "plan.toml"), "--out", str(folder / "made")]
    run_command(["simulate", *words, "--seed", "1"])
    table = pd.read_csv(folder / "made" / "recording.csv", comment="#")
    for k in range(count):
        case = folder / "cases" / f"case-{k:05d}"
        case.mkdir(parents=True)
        noise = np.random.default_rng(k).normal(0.0, 2.0, len(table))
        table.assign(**{"force [N]": (table["force [N]"] + noise).round(4)}).to_csv(
            case / "recording.csv", index=False
        )
        shutil.copy(folder / "made" / "muscle.toml", case)


def measure_fleet(cases: Path, out: Path, workers: int, count: int) -> tuple[float, float]:
    """Return the time of a run, without the start of its workers, and the sum of its tasks' times, s.

    Args:
        cases: folder of the cases.
        out: folder of the store.
        workers: number of workers.
        count: number of cases that run.
    """
    plan = read_plan([cases], stages=["check", "fit"], figures=False, report=False)
    plan = dataclasses.replace(plan, cases=plan.cases[:count])
    store = FleetStore(out)
    store.prepare()
    store.write_plan(plan)
    # One case for each worker loads the programs before the measurement.
    warm_up = dataclasses.replace(plan, cases=plan.cases[:workers])
    with start_cluster(workers) as client:
        run_chains(client, list_open_chains(store, warm_up))
        begin = time.perf_counter()
        run_chains(client, list_open_chains(store, plan))
        clock = time.perf_counter() - begin
    tasks = build_tables(out).frames["tasks"]
    warm_names = {case.name for case in warm_up.cases}
    busy = sum(s for s, case in zip(tasks["seconds"], tasks["case"], strict=True) if case not in warm_names)
    return clock, float(busy)


def run_killed(cases: Path, out: Path, kills: int, duration: float) -> int:
    """Run a fleet with one worker, kill it at random moments, and start it again each time.

    Args:
        cases: folder of the cases.
        out: folder of the store.
        kills: number of kills.
        duration: estimated time of the whole run, s.

    Returns:
        the number of kills before the end of the run.
    """
    command = [sys.executable, "-m", "pamjax", *_list_words(cases, out), "--workers", "1"]
    random, landed = np.random.default_rng(0), 0
    for _ in range(kills):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            process.wait(timeout=float(random.uniform(0.0, 2.0 * duration / kills)))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        landed += process.wait() == -signal.SIGKILL
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return landed


def _list_words(cases: Path, out: Path) -> list[str]:
    return ["fleet", str(cases), "--out", str(out), "--stage", "check", "fit", "--no-figures", "--no-report"]


def return_at_once(task: FleetTask, timeout: float | None) -> TaskOutcome:
    """Return an outcome without any work."""
    return TaskOutcome(task.key, "done")


def measure_overhead(count: int, workers: int) -> tuple[float, float]:
    """Return the time of a task without work, s, and the growth of the memory of client and scheduler, MB."""
    place = Path()
    chains = [
        TaskChain((FleetTask(f"{k:064x}", f"case-{k}", place, place, "fit", "0", {}),)) for k in range(count)
    ]
    with start_cluster(workers) as client:
        engine = TaskEngine(client, return_at_once)
        engine.run(chains[:10], lambda *_: None)
        before, begin = read_memory(), time.perf_counter()
        engine.run(chains, lambda *_: None)
        return (time.perf_counter() - begin) / count, read_memory() - before


def read_memory() -> float:
    """Return the memory of this process, MB; it contains client and scheduler."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    words, file = arguments()
    count, empty = int(words[0]) if words else 100, int(words[1]) if len(words) > 1 else 2000
    figures: dict[str, float] = {"cases": count, "tasks without work": empty}
    table = Table("fleet", "result")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        cases, stores = folder / "cases", [folder / name for name in ("one", "two", "killed")]
        write_cases(folder, count)
        for workers, part in ((1, max(count // 5, 2)), (2, count)):
            clock, busy = measure_fleet(cases, stores[workers - 1], workers, part)
            # The cases of the warm-up are not counted.
            figures[f"cases per second, {workers} workers"] = (part - workers) / clock
            figures[f"share of the clock in tasks, {workers} workers, %"] = 100 * busy / (workers * clock)
            figures[f"time in one case, {workers} workers, s"] = busy / (part - workers)
        duration = count / figures["cases per second, 1 workers"]
        figures["kills that ended a run"] = run_killed(cases, stores[2], 10, duration)
        # This run finds no open task, and writes the tables.
        run_command(_list_words(cases, stores[1]))
        figures["files of a store"] = sum(1 for _ in list_results(stores[1]))
        figures["files that differ after the kills"] = len(find_differences(stores[1], stores[2]))
    overhead, memory = measure_overhead(empty, 2)
    figures["time of a task without work, ms"] = 1e3 * overhead
    figures["growth of memory, MB"] = memory
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    Console().print(table)
    keep(file, figures)


if __name__ == "__main__":
    main()
