"""Process that reads one MAT file and writes its arrays to standard output.

Readers of MAT files are written in C. A corrupt file can end their process, or occupy all memory, so
`mat_file.py` starts this module as a process of its own. Exit code 3: the file is refused, and standard error
has the reason.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

#: Exit code for a file that is refused.
EXIT_UNUSABLE = 3
#: Largest array, bytes; HDF5 declares sizes that the file does not contain.
_MAX_ARRAY_BYTES = 10**9
#: Largest memory of this process, bytes.
_MAX_MEMORY_BYTES = 6 * 10**9
#: Largest depth of structures in structures.
_MAX_DEPTH = 20


def main() -> int:
    """Read the file named by the first argument; return the exit code."""
    _limit_memory()
    try:
        with open(sys.argv[1], "rb") as file:
            arrays = dict(_iterate_arrays(_load_variables(file.read())))
        stream = io.BytesIO()
        # A name of an array may contain any character, so it is an entry and not the name of a member.
        np.savez(stream, *arrays.values(), names=np.array([*arrays], dtype=str))
    except MemoryError:
        return _report_unusable("it needs too much memory")
    # The readers raise errors of many types on corrupt files.
    except Exception as error:
        return _report_unusable(" ".join(str(error).split()).rstrip(".") or type(error).__name__)
    sys.stdout.buffer.write(stream.getvalue())
    return 0


def _report_unusable(reason: str) -> int:
    sys.stderr.write(reason)
    return EXIT_UNUSABLE


def _limit_memory() -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY_BYTES, _MAX_MEMORY_BYTES))


def _load_variables(raw: bytes) -> Mapping[str, Any]:
    from scipy.io import loadmat

    if raw[:4] == b"\x89HDF" or b"MATLAB 7.3" in raw[:128]:
        import h5py

        return _unfold_group(h5py.File(io.BytesIO(raw), "r"), ())
    return loadmat(io.BytesIO(raw), simplify_cells=True)


def _unfold_group(group: Any, parents: tuple[int, ...]) -> dict[str, Any]:
    """Return the arrays of an HDF5 group; links to other files and to a parent are refused."""
    import h5py

    if len(parents) > _MAX_DEPTH:
        raise ValueError(f"structures are nested deeper than {_MAX_DEPTH}")
    variables: dict[str, Any] = {}
    for name in group:
        if name.startswith("#"):
            continue
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise ValueError(f"`{name}` is a link")
        part = group[name]
        address = h5py.h5o.get_info(part.id).addr  # pyright: ignore[reportAttributeAccessIssue]
        if address in parents:
            raise ValueError(f"`{name}` contains itself")
        variables[name] = (
            _unfold_group(part, (*parents, address)) if hasattr(part, "keys") else _read_array(part, name)
        )
    return variables


def _read_array(part: Any, name: str) -> np.ndarray:
    if part.external or part.is_virtual:
        raise ValueError(f"`{name}` is in another file")
    if part.size * part.dtype.itemsize > _MAX_ARRAY_BYTES:
        raise ValueError(f"`{name}` has more than 1 GB")
    return np.asarray(part)


def _iterate_arrays(variables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _iterate_arrays(value, f"{prefix}{name}.")
        elif np.ndim(value) and np.asarray(value).dtype.kind in "biuf":
            yield f"{prefix}{name}", np.asarray(value)


if __name__ == "__main__":
    sys.exit(main())
