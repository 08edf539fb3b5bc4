"""Shipped tables of published data, each with a sidecar that states its source.

A table is `<folder>/<name>.csv` with headers `name [unit]` and a sidecar `<name>.toml`. The sidecar states
title, source, licence, how the table was read, the sha256 of the CSV's bytes, and a unit for each column.
Text columns have no unit.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from io import BytesIO
from pathlib import Path
from typing import Any

import pandas as pd

from pamjax.errors import BadInput, suggest_word
from pamjax.units import compute_si_factor

_HEADER_PATTERN = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\]]*)\]$")


def find_data_folder() -> Path:
    """Return the folder of the shipped tables: inside an installed package, or next to it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    # The package's own folder comes first: next to an installed package, `data` may belong to another one.
    for folder in (package / "data", package.parent / "data"):
        if folder.is_dir():
            return folder
    rule = "pamjax needs the folder `data` with its shipped tables"
    raise BadInput.from_rule(rule, "none", str(package), "Reinstall pamjax.")


def list_shipped() -> list[str]:
    """Return the names of all shipped tables, as "chambers_wereley_2022/table1"."""
    folder = find_data_folder()
    return sorted(p.relative_to(folder).with_suffix("").as_posix() for p in folder.glob("*/*.csv"))


def read_sidecar(name: str) -> dict[str, Any]:
    """Return title, source, licence, method of reading and column units of a shipped table.

    Raises:
        BadInput: if no table has this name.

    >>> read_sidecar("chambers_wereley_2022/table1")["source"]["licence"]
    'CC BY 4.0'
    """
    return tomllib.loads(_find_file(name, ".toml").read_text(encoding="utf-8"))


def read_shipped(name: str) -> pd.DataFrame:
    """Return a shipped table in its printed units, headers `name [unit]`; `convert_to_si` converts it.

    Raises:
        BadInput: if no table has this name, or if the file differs from the sidecar's sha256.

    >>> read_shipped("chambers_wereley_2022/table1")["diameter [mm]"].iloc[0].item()
    26.52
    """
    path = _find_file(name, ".csv")
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != read_sidecar(name)["sha256"]:
        raise BadInput.from_rule(
            "a shipped table must have the sha256 that its sidecar states",
            "another sha256",
            str(path),
            "Restore the file. If the change is intended, write the new sha256 into the sidecar.",
        )
    return pd.read_csv(BytesIO(content))


def convert_to_si(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table in SI with headers without units; columns without a unit are unchanged.

    >>> convert_to_si(read_shipped("chambers_wereley_2022/table1"))["pressure"].iloc[0].item()
    689000.0

    Raises:
        BadInput: if two columns would get the same name, as table 2's "force_change" in percent and in N.
    """
    columns = {}
    for header in table.columns:
        match = _HEADER_PATTERN.match(header)
        name = match["name"] if match else header
        if name in columns:
            raise BadInput.from_rule(
                "column names without units must be unique",
                f"`{name}` twice",
                remedy="Select one of the columns.",
            )
        columns[name] = table[header] * compute_si_factor(match["unit"]) if match else table[header]
    return pd.DataFrame(columns)


def read_quantities(name: str) -> dict[str, float]:
    """Return the SI values of a table with one quantity per row, by the quantity's name.

    >>> round(read_quantities("chambers_wereley_2022/materials")["rest_length"], 6)
    0.235744
    """
    table = read_shipped(name)
    if not {"quantity", "value", "unit"} <= set(table.columns):
        raise BadInput.from_rule(
            "a table of quantities must have the columns `quantity`, `value` and `unit`",
            where=name,
            remedy="Use `convert_to_si`.",
        )
    return {
        str(quantity): float(value) * compute_si_factor(str(unit))
        for quantity, value, unit in zip(table["quantity"], table["value"], table["unit"], strict=True)
    }


def _find_file(name: str, suffix: str) -> Path:
    path = find_data_folder() / f"{name}{suffix}"
    if name not in list_shipped() or not path.is_file():
        raise BadInput.from_rule(f"unknown shipped table `{name}`", remedy=suggest_word(name, list_shipped()))
    return path
