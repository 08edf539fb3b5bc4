"""Store the figures of a benchmark in a small JSON file, which the documentation quotes.

    python -m tests.benchmarks.bench --json docs/benchmarks/bench.json

Each benchmark accepts `--json FILE`. The file contains the command, date, machine, versions and figures.
Without the option nothing is written.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

OPTION = "--json"
PACKAGES = ("jax", "numpy", "pamjax")

#: Significant digits of a stored figure.
DIGITS = 4

#: Load of the machine before the benchmark; None if the system does not report it.
LOAD = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def arguments(words: Sequence[str] | None = None) -> tuple[list[str], Path | None]:
    """Return the command-line arguments without `--json FILE`, and FILE (None if absent)."""
    left = list(sys.argv[1:] if words is None else words)
    if OPTION not in left:
        return left, None
    k = left.index(OPTION)
    if k + 1 == len(left):
        raise SystemExit(f"{OPTION} needs the name of a file")
    return left[:k] + left[k + 2 :], Path(left[k + 1])


def keep(file: Path | None, figures: Mapping[str, Any], gpu: str = "") -> None:
    """Write the figures of a benchmark to a file, with command, date, machine and versions.

    Args:
        file: file to write; nothing is written if None.
        figures: values, or (value, low, high), by label with the unit in brackets.
        gpu: name of the GPU, if the benchmark used one.
    """
    if file is None:
        return
    about = {
        "command": command(),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": machine() | ({"GPU": gpu} if gpu else {}),
        "versions": versions(),
    }
    rounded = {name: _rounded(value) for name, value in figures.items()}
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(about | {"figures": rounded}, indent=1, ensure_ascii=False)
    file.write_text(f"{text}\n", encoding="utf-8")


def command() -> str:
    """Return the command of this process, without the option `--json`."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    program = f"-m {spec.name}" if spec else Path(sys.argv[0]).name
    return " ".join(["python", program, *arguments()[0]])


def machine() -> dict[str, Any]:
    """Return the processor, the usable and all cores, and the load before the run."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"processor": _processor(), "cores used": cores, "cores": os.cpu_count(), "load before": LOAD}


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that affect a figure."""
    return {"python": platform.python_version()} | {p: importlib.metadata.version(p) for p in PACKAGES}


def _processor() -> str:
    """Return the name of the processor."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def _rounded(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_rounded(item) for item in value]
    if isinstance(value, str | int):
        return value
    return float(f"{float(value):.{DIGITS}g}")
