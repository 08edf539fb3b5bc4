"""Rows of pandas frames: a selection, and a list of dictionaries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd


def select_rows(table: pd.DataFrame, condition: Any) -> pd.DataFrame:
    """Return the rows of a table where a condition is true; a missing condition counts as false."""
    mask = [False if pd.isna(value) else bool(value) for value in condition]
    return table.iloc[np.flatnonzero(mask)]


def list_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table as dictionaries by column; a missing value is None.

    >>> list_rows(pd.DataFrame({"case": ["a"], "bench": pd.Series([None], dtype="string")}))
    [{'case': 'a', 'bench': None}]
    """
    columns = {name: table[name].tolist() for name in table.columns}
    return [
        {str(name): _replace_missing(values[k]) for name, values in columns.items()}
        for k in range(len(table))
    ]


def _replace_missing(value: Any) -> Any:
    return None if pd.isna(value) else value
