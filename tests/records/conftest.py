"""Case folders for tests of invalid inputs, and all cases of the project."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pamjax.records.case import read_case

SHARED = Path(__file__).parents[2].parent / "shared"

#: A counted braid: thread 214 mm, 1.2 turns.
THREAD, TURNS = 0.214, 1.2
MUSCLE = """\
[muscle]
name = "test muscle"
rest_length = "200 mm"
thread_length = {value = "214 mm", sd = "0.5 mm"}
turns = 1.2
"""
HEADER = "time [s],pressure [kPa],length [mm],force [N],diameter [mm],cycle\n"


def real_folders() -> list[Path]:
    """Return all recorded or simulated case folders of the project; empty if there are none."""
    patterns = ("data/portland-hose/*", "practice/case-*", "sealed/*/*")
    return sorted(path for pattern in patterns for path in SHARED.glob(pattern) if path.is_dir())


def strokes(levels=(100e3, 200e3, 300e3), samples=120, rest=0.2, cycles=1, noise=0.0, seed=0):
    """Return isobaric strokes of the ideal braid, SI, as columns by name."""
    random = np.random.default_rng(seed)
    phase = np.tile(np.abs(np.linspace(-1.0, 1.0, samples)), cycles)
    length = np.concatenate([rest * (0.8 + 0.2 * phase)] * len(levels))
    pressure = np.repeat(np.asarray(levels, dtype=float), samples * cycles)
    n = len(length)
    block = np.arange(n) // (samples * cycles)
    columns = {
        "time": 0.5 * np.arange(n) + 20.0 * block,
        "pressure": pressure + noise * 400.0 * random.standard_normal(n),
        "length": length + noise * 2e-5 * random.standard_normal(n),
        "cycle": np.arange(n) // samples % cycles + 1,
    }
    columns["force"] = pressure * (3 * length**2 - THREAD**2) / (4 * math.pi * TURNS**2)
    columns["force"] += noise * 1.0 * random.standard_normal(n)
    columns["diameter"] = np.sqrt(THREAD**2 - length**2) / (math.pi * TURNS)
    return columns


def as_csv(columns, header=HEADER) -> str:
    """Return the columns in the units of the standard header."""
    size = {"time": 1, "pressure": 1e-3, "length": 1e3, "force": 1, "diameter": 1e3, "cycle": 1}
    rows = zip(*(columns[name] * factor for name, factor in size.items()), strict=True)
    return header + "".join(",".join(f"{value:.10g}" for value in row) + "\n" for row in rows)


@pytest.fixture
def write(tmp_path):
    """Write a CSV file from rows below the standard header, or from a complete text; return its path."""

    def _write(rows="", header=HEADER, text=None):
        path = tmp_path / "recording.csv"
        content = header + rows if text is None else text
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return _write


@pytest.fixture
def folder(tmp_path):
    """Write a case folder and return its path."""

    def _folder(recording=None, muscle=MUSCLE):
        path = tmp_path / "my-muscle"
        path.mkdir(exist_ok=True)
        (path / "recording.csv").write_text(as_csv(strokes()) if recording is None else recording)
        (path / "muscle.toml").write_text(muscle)
        return path

    return _folder


@pytest.fixture(params=real_folders() or [None], ids=lambda path: path.name if path else "none")
def real_case(request):
    """Return each real case, read once."""
    if request.param is None:
        pytest.skip("no real recordings next to the project")
    return _read(request.param)


@cache
def _read(path):
    return read_case(path)
