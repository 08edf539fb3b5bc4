"""Time of a complete bench: every mechanism active, a recording of 5,000 rows.

    taskset -c 0 python -m tests.benchmarks.bench [rows] [--json FILE]

The times are reported, and no test depends on them. Warm prediction and Jacobian of all parameters are
compared with the same physics in NumPy with finite differences (`by_hand.py`); the script checks that both
predictions agree. It also reports the compilation time of a new process with an empty cache, and with the
cache of an earlier process. Wall-clock and processor times are both reported, because other processes of
a shared machine affect the former. Without `taskset` JAX uses all cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from pamjax.compile.jax_cache import keep_compiled
from pamjax.jit import list_compiler_options
from pamjax.model.history import build_time_history
from pamjax.model.registry import MECHANISMS
from pamjax.parameter import list_values, replace_values
from tests.benchmarks.by_hand import ByHand
from tests.benchmarks.keep import arguments, keep
from tests.model.mechanisms.typical import LENGTH, full

#: Typical parameters of the paper's muscle, by path; all others have their defaults, and mechanisms
#: that are not listed are compiled with their neutral values.
TYPICAL = {
    "braid_elasticity.compliance": 1 / (144 * 0.0858e-6 * 80e9),
    "thread_crimp.crimp": 5e-4,
    "bladder_elasticity.modulus": 0.3e6,
    "bladder_elasticity.mooney": 0.2,
    "braid_friction.coefficient": 0.2,
    "braid_friction.constant": 3.0,
    "braid_friction.exponent": 0.8,
    "braid_friction.give": 1e-9,
    "braid_friction.start": 0.3,
    "viscous_damping.coefficient": 2e3,
    "viscoelastic_creep.modulus": 0.05e6,
    "mullins_softening.modulus": 0.05e6,
    "thread_slip.bedding": 5e-4,
    "thread_slip.step": 2e-4,
    "pressure_drop.impedance": 1e8,
    "contact_pressure.threshold": 5e3,
    "rig_compliance.compliance": 2e-7,
    "pressure_offset.offset": 3e3,
    "pressure_gain.gain": 0.01,
    "length_offset.offset": 0.5e-3,
    "force_gain.gain": 0.01,
    "force_offset.offset": 5.0,
    "force_drift.rate": 1e-3,
    "force_drift.bend": 1e-7,
    "channel_lag.lag": 0.3,
}


class Task:
    """A recording of strokes at ten pressures, and a bench with every mechanism."""

    def __init__(self, rows: int) -> None:
        row = np.arange(rows)
        cycle = row / rows * 30
        level = np.minimum(cycle // 3, 9).astype(int)
        pressure = 69e3 * (1 + level) * (1 + 2e-3 * np.sin(0.7 * row))
        # Low pressures have shorter strokes, as in the paper: otherwise the bladder would lose contact.
        top = np.array([0.02, 0.08, 0.12, *[0.15] * 7])[level]
        length = LENGTH * (1 - top * (1 - np.abs(2 * (cycle % 1) - 1)))
        starts = np.diff(level, prepend=-1) > 0
        moment = np.cumsum(1.0 + 0.3 * np.sin(row)) + 60.0 * level
        self.bench = full()
        self.at = jnp.asarray(pressure), jnp.asarray(length), build_time_history(moment, starts)
        self.numbers = {k: float(v) for k, v in list_values(self.bench).items()} | TYPICAL
        self.x = np.array(list(self.numbers.values()))
        self.hand = ByHand(pressure, length, moment, starts)
        self.scale = np.array([5e3, 0.03])[:, None]

    def plain(self, x, at):
        shown = replace_values(self.bench, dict(zip(self.numbers, x, strict=True)))(*at)
        return jnp.stack([shown.force, shown.diameter])

    @cached_property
    def predict(self) -> Callable:
        return jax.jit(self.plain, compiler_options=list_compiler_options())

    @cached_property
    def slopes(self) -> Callable:
        """Return Jacobian and prediction of a least-squares step, in one program."""
        slopes = jax.jacfwd(lambda x, at: 2 * (self.plain(x, at),), has_aux=True)
        return jax.jit(slopes, compiler_options=list_compiler_options())

    def by_hand(self, x) -> np.ndarray:
        return self.hand(dict(zip(self.numbers, x, strict=True)))

    def differences(self) -> np.ndarray:
        """Return the Jacobian by forward differences, as in SciPy: one prediction more than parameters."""
        begin, columns = self.by_hand(self.x), []
        for k, value in enumerate(self.x):
            step = 1.5e-8 * max(abs(value), 1e-3)
            columns.append((self.by_hand(self.x + step * (np.arange(self.x.size) == k)) - begin) / step)
        return np.stack(columns, axis=-1)


def milliseconds(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Return the median wall-clock and processor times, ms."""
    jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        clock, busy = time.perf_counter(), time.process_time()
        jax.block_until_ready(call())
        times.append((time.perf_counter() - clock, time.process_time() - busy))
    return tuple(1e3 * np.median(times, axis=0))


def agreement(console: Console, task: Task) -> dict[str, float]:
    off = np.max(np.abs(task.predict(task.x, task.at) - task.by_hand(task.x)) / task.scale)
    console.print(f"By hand and pamjax differ by {off:.1g} of full scale at most.")
    return {"largest difference of NumPy and pamjax [full scale]": off}


def warm(console: Console, rows: int, repeats: int = 15) -> dict[str, float]:
    task = Task(rows)
    figures = agreement(console, task)
    mine = {
        "prediction": lambda: task.predict(task.x, task.at),
        f"Jacobian in {task.x.size} numbers": lambda: task.slopes(task.x, task.at),
    }
    theirs = (lambda: task.by_hand(task.x), 5), (task.differences, 1)
    title = f"{len(MECHANISMS)} mechanisms, {rows:,} rows, warm"
    table = Table(
        "", "pamjax, clock", "processor", "NumPy, clock", "processor", "NumPy / pamjax", title=title
    )
    for (name, own), (hand, often) in zip(mine.items(), theirs, strict=True):
        (clock, busy), (slow, slow_busy) = milliseconds(own, repeats), milliseconds(hand, often)
        row = (f"{t:,.1f} ms" for t in (clock, busy, slow, slow_busy))
        table.add_row(name, *row, f"{slow_busy / busy:.0f}")
        figures |= {
            f"{name}, clock [ms]": clock,
            f"{name}, processor [ms]": busy,
            f"{name}, NumPy, clock [ms]": slow,
            f"{name}, NumPy, processor [ms]": slow_busy,
            f"{name}, NumPy over pamjax, processor": slow_busy / busy,
        }
    console.print(table)
    return figures


def compiling(rows: int) -> None:
    """Print the compilation time of each program in a new process as JSON, s."""
    keep_compiled()
    task, seconds = Task(rows), {}
    for name in ("slopes", "predict"):
        clock, busy = time.perf_counter(), time.process_time()
        getattr(task, name).lower(task.x, task.at).compile()
        seconds[name] = (time.perf_counter() - clock, time.process_time() - busy)
    print(json.dumps(seconds))


def cold(console: Console, rows: int) -> dict[str, float]:
    titles = {"slopes": "value and Jacobian", "predict": "value alone"}
    columns = [f"{t}, {w}" for t in titles.values() for w in ("clock", "processor")]
    table, figures = Table("compiling", *columns), {}
    with tempfile.TemporaryDirectory() as scratch:
        environment = os.environ | {"PAMJAX_CACHE_DIR": scratch}
        words = [sys.executable, "-m", "tests.benchmarks.bench", str(rows), "compiling"]
        for name in ("empty cache", "with the cache"):
            output = subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout
            times = [t for k in titles for t in json.loads(output)[k]]
            table.add_row(name, *(f"{t:.1f} s" for t in times))
            figures |= {f"compile, {name}, {c} [s]": t for c, t in zip(columns, times, strict=True)}
    console.print(table)
    return figures


def main() -> None:
    words, file = arguments()
    rows = int(words[0]) if words else 5000
    if words[1:] == ["compiling"]:
        return compiling(rows)
    console = Console()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    console.print(f"{cores} of {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before this began")
    return keep(file, warm(console, rows) | cold(console, rows))


if __name__ == "__main__":
    main()
