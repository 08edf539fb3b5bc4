"""Arrays of a MAT file, read by a process of its own: a corrupt file ends that process only."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from pamjax.errors import BadInput, suggest_word
from pamjax.records.importing.mat_child import EXIT_UNUSABLE

#: Longest time for one file, s.
_READER_TIMEOUT = 120.0

_READER_REMEDY = "Save it again in MATLAB."


def read_mat(path: Path, matrix: str) -> dict[str, np.ndarray]:
    """Return the arrays of a MAT file by name ("structure.field"), or the columns of a matrix by number.

    Args:
        path: a MAT file of version 4 to 7.3.
        matrix: name of the variable whose columns are the channels; "" if each channel is a variable.

    Raises:
        BadInput: if the file cannot be read, or has no variable of this name.
    """
    arrays = _read_arrays(path)
    if not arrays:
        raise BadInput.from_rule(f"{path.name} must contain arrays of numbers", "none", remedy=_READER_REMEDY)
    if not matrix:
        is_vector = {name: values.size == max(values.shape, default=1) for name, values in arrays.items()}
        return {name: values.ravel() for name, values in arrays.items() if is_vector[name]}
    if matrix not in arrays:
        raise BadInput.from_rule(
            f"{path.name} must have a variable `{matrix}`", "none", "", suggest_word(matrix, arrays)
        )
    table = np.atleast_2d(arrays[matrix])
    if table.shape[0] < table.shape[1]:  # one row per sample, also for a transposed matrix
        table = table.T
    return {str(k): column for k, column in enumerate(table.T, 1)}


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    # With -P the working directory, which may have a numpy.py among the data, is not in sys.path.
    words = [sys.executable, "-P", "-m", "pamjax.records.importing.mat_child", str(path)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    rule = f"{path.name} must be a MAT file"
    try:
        process = subprocess.run(
            words, capture_output=True, env=environment, timeout=_READER_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired as error:
        got = f"a file that takes more than {_READER_TIMEOUT:g} s"
        raise BadInput.from_rule(rule, got, remedy=_READER_REMEDY) from error
    if process.returncode == EXIT_UNUSABLE:
        raise BadInput.from_rule(rule, process.stderr.decode("utf-8", "replace"), remedy=_READER_REMEDY)
    if process.returncode:
        raise BadInput.from_rule(rule, "a corrupt file, which stopped the reader", remedy=_READER_REMEDY)
    content = np.load(io.BytesIO(process.stdout), allow_pickle=False)
    return {str(name): content[f"arr_{k}"] for k, name in enumerate(content["names"])}
