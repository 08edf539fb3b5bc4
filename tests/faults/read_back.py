"""Check that every file of a folder is complete, and compare the results of two folders.

Names that begin with a dot are temporary files and locks; no reader of pamjax takes them for a result.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import matplotlib.image
import numpy as np
import pandas as pd

from pamjax.benchmark.prove import read_trials

#: Entries of a result that state computing times.
TIME_ENTRIES = ("seconds",)
#: Files that have nothing but times.
TIME_FILES = ("time.json", "tables/tasks.parquet")


def list_results(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder without temporary files and locks."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and not any(part.startswith(".") for part in parts):
            yield path


def list_leftovers(folder: Path) -> list[Path]:
    """Return the temporary files and folders of a folder, without those inside another one."""
    hidden = [path for path in sorted(folder.rglob(".*")) if path.name != ".lock"]
    return [path for path in hidden if not any(parent in hidden for parent in path.parents)]


def find_incomplete_files(folder: Path) -> list[str]:
    """Return the files of a folder that cannot be read to their end, each with its error."""
    broken = []
    for path in list_results(folder):
        try:
            READERS[path.suffix](path)
        # Each format has its own errors; every one of them means an incomplete file.
        except Exception as error:
            broken.append(f"{path.relative_to(folder)}: {type(error).__name__}: {error}")
    return broken


def find_differences(folder: Path, other: Path) -> list[str]:
    """Return the names of the files that differ between two folders, apart from times."""
    first, second = _read_results(folder), _read_results(other)
    return sorted(name for name in first | second if first.get(name) != second.get(name))


def list_unequal_variables(file: Path, other: Path) -> list[str]:
    """Return the names of the variables of two netCDF files that differ, with the largest difference."""
    lines = []
    with h5py.File(file) as first, h5py.File(other) as second:
        for name in sorted(set(map(str, first)) | set(map(str, second))):
            values, others = (
                np.asarray(part[name]) if name in part else np.empty(0) for part in (first, second)
            )
            is_float = values.dtype.kind == "f"
            if not np.array_equal(values, others, equal_nan=is_float):
                is_float &= values.shape == others.shape
                lines.append(f"{name}: {np.nanmax(np.abs(values - others)):g}" if is_float else name)
    return lines


def _read_results(folder: Path) -> dict[str, Any]:
    names = {path.relative_to(folder).as_posix(): path for path in list_results(folder)}
    return {name: _read_content(path) for name, path in names.items() if not name.endswith(TIME_FILES)}


def _read_content(path: Path) -> Any:
    """Return the content of a file without its times."""
    if path.suffix == ".json":
        return _drop_times(json.loads(path.read_text("utf-8")))
    if path.name == "trials.jsonl":
        # A killed run may leave an incomplete line, which the reader ignores.
        return [_drop_times(json.loads(trial.format_line())) for trial in read_trials(path)]
    return path.read_bytes()


def _drop_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _drop_times(part) for key, part in value.items() if key not in TIME_ENTRIES}
    return [_drop_times(part) for part in value] if isinstance(value, list) else value


def _read_ending(ending: str) -> Callable[[Path], None]:
    """Return a reader that requires the last characters of a text."""

    def read(path: Path) -> None:
        tail = path.read_bytes()[-64:].decode("utf-8", "replace").rstrip()
        if not tail.endswith(ending):
            raise ValueError(f"no {ending!r} at its end")

    return read


def _read_hdf(path: Path) -> None:
    with h5py.File(path) as file:
        file.visititems(lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None)


def _read_arrays(path: Path) -> None:
    with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
        dict(file)


def _read_csv(path: Path) -> None:
    if not path.read_bytes().endswith(b"\n"):
        raise ValueError("no end of line at its end")
    pd.read_csv(path, comment="#")


READERS: dict[str, Callable[[Path], Any]] = {
    ".json": lambda path: json.loads(path.read_text("utf-8")),
    ".jsonl": read_trials,
    ".nc": _read_hdf,
    ".npz": _read_arrays,
    ".parquet": pd.read_parquet,
    ".png": lambda path: matplotlib.image.imread(io.BytesIO(path.read_bytes())),
    ".pdf": _read_ending("%%EOF"),
    ".html": _read_ending("</html>"),
    ".csv": _read_csv,
    ".md": lambda path: path.read_text("utf-8"),
    ".toml": lambda path: path.read_text("utf-8"),
}
