"""Results and times on a GPU, compared with the processor of the same machine.

    python -m tests.benchmarks.gpu [PART ...] [--json FILE]

The parts are `states` (a braid without mechanisms), `mechanisms` (every mechanism active), `fit` (the paper's
case) and `diagnose` (the example of `pamjax new`). Each part runs as a new process on each device. Both
devices run at the same time, each with half of the processor's cores. A fit and a diagnosis run twice: the
first run starts with an empty cache of compiled programs. The differences of the results are fractions of the
largest value of each output. Needs a GPU and JAX for CUDA.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import pamjax
from pamjax.cli.main import main as run_pamjax
from pamjax.compile.jax_cache import keep_compiled
from pamjax.model.muscle import Muscle
from pamjax.model.thread import LinearThread
from tests.benchmarks.bench import Task, milliseconds
from tests.benchmarks.keep import arguments, keep
from tests.model.mechanisms.typical import AREA, LENGTH, THREAD, TURNS

#: Devices by their name in JAX.
DEVICES = {"cuda": "GPU", "cpu": "processor"}

#: A run that takes longer is stopped, s.
LIMIT = 300.0

PAPER = Path(__file__).parents[2] / "fits" / "chambers_wereley_2022"

Result = tuple[dict[str, float], dict[str, np.ndarray]]


def states() -> Result:
    """Return times and results of a braid in states that cover the range of a muscle."""
    muscle = Muscle(LENGTH, THREAD, TURNS, LinearThread(AREA * 80e9))

    def total_force(muscle, pressure, length):
        return pamjax.predict(muscle, pressure, length).force.sum()

    gradient = jax.jit(jax.grad(total_force, argnums=(0, 1, 2)))
    times, results = {}, {}
    for count in (5_000, 1_000_000):
        rng = np.random.default_rng(0)
        pressure = jax.numpy.asarray(rng.uniform(20e3, 900e3, count))
        length = jax.numpy.asarray(LENGTH * rng.uniform(0.7, 1.0, count))
        calls = {
            "prediction": lambda p=pressure, l=length: pamjax.predict(muscle, p, l),
            "gradient": lambda p=pressure, l=length: gradient(muscle, p, l),
        }
        for name, call in calls.items():
            times |= time_call(f"{name}, {count:,} states", call)
            leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(call())]
            results |= {f"{name} {count} {k}": leaf for k, leaf in enumerate(leaves)}
    return times, results


def mechanisms() -> Result:
    """Return times and results of a recording of 5,000 rows with every mechanism."""
    task, times, results = Task(5000), {}, {}
    calls = {
        "prediction, 5,000 rows": lambda: task.predict(task.x, task.at),
        f"Jacobian in {task.x.size} numbers": lambda: task.slopes(task.x, task.at),
    }
    for name, call in calls.items():
        times |= time_call(name, call)
        for k, leaf in enumerate(jax.tree.leaves(call())):
            # One column of a Jacobian is one output.
            columns = np.asarray(leaf).reshape(*leaf.shape[:2], -1)
            results |= {
                f"{name} {k} {c} {j}": columns[c, :, j] for c in range(2) for j in range(columns.shape[2])
            }
    return times, results


def fit() -> Result:
    """Return the estimates of the paper's case and their standard deviations."""
    estimates = pamjax.fit(PAPER).estimates
    return {}, {name: np.array([e.value, e.sd], dtype=float) for name, e in estimates.items()}


def diagnose() -> Result:
    """Return the parameters of the mechanisms that are named for the example case."""
    with tempfile.TemporaryDirectory() as scratch:
        run_pamjax(["new", f"{scratch}/mine"])
        diagnosis = pamjax.diagnose(f"{scratch}/mine")
    named = {m.id: np.array([m.probability]) for m in diagnosis.named_mechanisms}
    estimates = {f"{i}.{name}": e for i, all_of in diagnosis.parameters.items() for name, e in all_of.items()}
    return {}, named | {name: np.array([e.value, e.sd], dtype=float) for name, e in estimates.items()}


PARTS: dict[str, Callable[[], Result]] = {
    "states": states,
    "mechanisms": mechanisms,
    "fit": fit,
    "diagnose": diagnose,
}
#: Parts whose whole process is timed.
COMMANDS = ("fit", "diagnose")


def time_call(name: str, call: Callable[[], object]) -> dict[str, float]:
    """Return the time of the first call, which compiles (s), and of later calls (ms)."""
    begin = time.perf_counter()
    jax.block_until_ready(call())
    first = time.perf_counter() - begin
    return {f"{name}, first [s]": first, f"{name} [ms]": milliseconds(call, 5)[0]}


def use_half_of_the_cores(device: str) -> None:
    """Restrict this process to the first half of its cores, or to the second half for the processor."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        half = max(len(cores) // 2, 1)
        os.sched_setaffinity(0, cores[-half:] if device == "cpu" else cores[:half])


def run_part(part: str, device: str, file: str) -> None:
    """Run a part on a device; print the device and the times, and write the results to a file."""
    use_half_of_the_cores(device)
    if part in COMMANDS:
        keep_compiled()
    times, results = PARTS[part]()
    np.savez(file, **results)  # pyright: ignore[reportArgumentType]
    print(json.dumps({"device": jax.devices()[0].device_kind, "times": times}))


def measure(part: str, device: str, scratch: str) -> tuple[str, dict[str, float]]:
    """Return the name of a device, and the times of a part on it; without those of a run that was stopped."""
    file, model, times = f"{scratch}/{part}-{device}.npz", "", {}
    environment = os.environ | {"JAX_PLATFORMS": device, "PAMJAX_CACHE_DIR": f"{scratch}/{part}-{device}"}
    command = [sys.executable, "-m", "tests.benchmarks.gpu", "run", part, device, file]
    for run in ("first", "again") if part in COMMANDS else ("first",):
        begin = time.perf_counter()
        try:
            done = subprocess.run(
                command, env=environment, stdout=subprocess.PIPE, text=True, check=True, timeout=LIMIT
            )
        except subprocess.TimeoutExpired:
            print(f"{part} on {device}: stopped after {LIMIT:.0f} s", file=sys.stderr)
            break
        clock = time.perf_counter() - begin
        output = json.loads(done.stdout.splitlines()[-1])
        model = output["device"]
        times |= output["times"] | ({f"{run} [s]": clock} if part in COMMANDS else {})
    return model, times


def compare(results: Mapping[str, np.ndarray], others: Mapping[str, np.ndarray]) -> float:
    """Return the largest difference, as a fraction of the largest value of its output.

    It is infinite if an output or a NaN is on one side only.
    """
    if set(results) != set(others):
        return np.inf
    return max(_compare_output(results[k], others[k]) for k in results)


def _compare_output(result: np.ndarray, other: np.ndarray) -> float:
    if result.shape != other.shape or not np.array_equal(np.isnan(result), np.isnan(other)):
        return np.inf
    return float(np.max(np.abs(np.nan_to_num(result - other))) / max(np.nanmax(np.abs(other)), 1e-300))


def main() -> None:
    words, file = arguments()
    if words[:1] == ["run"]:
        return run_part(*words[1:])
    figures, gpu, table = {}, "", Table("", *DEVICES.values())
    with tempfile.TemporaryDirectory() as scratch:
        for part in words or PARTS:
            with ThreadPoolExecutor(len(DEVICES)) as pool:
                measured = list(pool.map(lambda device, part=part: measure(part, device, scratch), DEVICES))
            gpu = measured[0][0] or gpu
            for name in measured[1][1]:
                times = dict(zip(DEVICES.values(), (t for _, t in measured), strict=True))
                row = {title: t[name] for title, t in times.items() if name in t}
                table.add_row(
                    f"{part}: {name}", *(f"{row[t]:.4g}" if t in row else "" for t in DEVICES.values())
                )
                figures |= {f"{part}, {title}, {name}": value for title, value in row.items()}
            files = [Path(scratch, f"{part}-{device}.npz") for device in DEVICES]
            if all(f.exists() for f in files):
                with np.load(files[0]) as results, np.load(files[1]) as others:
                    difference = compare(results, others)
                figures[f"{part}, largest difference of GPU and processor"] = difference
                table.add_row(f"{part}: largest difference", f"{difference:.2g}", "")
    Console(width=110).print(gpu, table)
    return keep(file, figures, gpu)


if __name__ == "__main__":
    main()
