"""Time of a prediction in a diagnosis, by the mechanisms that act.

    taskset -c 1 python -m tests.benchmarks.acting [--json FILE]

The program of a diagnosis skips the mechanisms that are switched off. The script flags one mechanism, all or
none of them as acting, and measures a prediction and six derivatives of a simulated recording of 5,000 rows.
The times are reported, and no test depends on them.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from pamjax.compile import programs
from pamjax.compile.jax_cache import keep_compiled
from pamjax.diagnosis.library.library_problem import (
    LibraryProblem,
    _flag_mechanisms,
    _predict_channels,
    build_library_problem,
)
from pamjax.model.registry import MECHANISMS
from pamjax.records.case import ensure_case
from tests.benchmarks.keep import arguments, keep
from tests.benchmarks.targets import write_recording

ROWS, REPEATS, DERIVATIVES = 5000, 25, 6

#: Mechanisms that act, by label.
ACTING = {
    "none": (),
    "bladder_elasticity": ("bladder_elasticity",),
    "braid_friction": ("braid_friction",),
    "end_taper": ("end_taper",),
    "all": tuple(kind.id for kind in MECHANISMS),
}


def milliseconds(call: Callable[[], object]) -> float:
    """Return the shortest of several times of a call, ms."""
    call()
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return 1e3 * min(times)


def measure(problem: LibraryProblem, ids: tuple[str, ...]) -> tuple[float, float]:
    """Return the times of a prediction and of six derivatives by baseline parameters, ms."""
    indices = np.flatnonzero(problem.is_baseline)[:DERIVATIVES].tolist()
    flags = _flag_mechanisms(ids)
    return (
        milliseconds(
            lambda: np.asarray(
                programs.run_compiled(_predict_channels, problem.dataset, problem.neutral, flags)
            )
        ),
        milliseconds(lambda: problem._run_sweep(problem.neutral, indices, [ids] * len(indices))),
    )


def main() -> None:
    words, file = arguments()
    if words:
        raise SystemExit(__doc__)
    keep_compiled()
    with tempfile.TemporaryDirectory() as scratch:
        folder = write_recording(Path(scratch), ROWS, str(Path(scratch) / "cache"))
        problem = build_library_problem(ensure_case(folder))
    table, figures = Table("mechanisms that act", "prediction", f"{DERIVATIVES} derivatives"), {}
    for label, ids in ACTING.items():
        prediction, derivatives = measure(problem, ids)
        table.add_row(label, f"{prediction:.2f} ms", f"{derivatives:.2f} ms")
        figures |= {
            f"prediction, acting: {label} [ms]": prediction,
            f"{DERIVATIVES} derivatives, acting: {label} [ms]": derivatives,
        }
    keep(file, figures)
    Console().print(table)


if __name__ == "__main__":
    main()
