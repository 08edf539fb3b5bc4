"""Tables of a fleet: one row for each case, calibrated parameter and identified mechanism.

The tables follow from the files of the cases alone. Equal results therefore give equal tables, in whatever
order the tasks ran. Times are in a table of their own.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from pamjax.fleet.stage_rows import STAGE_ROWS
from pamjax.fleet.store import (
    DONE,
    OPEN,
    FleetStore,
    TaskOutcome,
    read_json,
    read_outcome,
    read_store_document,
)

if TYPE_CHECKING:
    import pyarrow as pa

#: Folder of the tables in a store.
_TABLE_FOLDER = "tables"

#: Columns of each table with their types.
_TABLE_COLUMNS: dict[str, dict[str, str]] = {
    "cases": {
        "case": "string", "folder": "string", "bench": "string", "serial": "string", "type": "string",
        "date": "date", "checksum": "string", "state": "string", "reason": "string", "report": "string",
        "law": "string", "rows": "int", "converged": "bool", "force_rmse_N": "float",
        "force_noise_N": "float", "force_held_out_N": "float", "diameter_rmse_mm": "float",
        "diameter_noise_mm": "float", "diameter_held_out_mm": "float", "length_rmse_mm": "float",
        "length_noise_mm": "float", "length_held_out_mm": "float", "baseline_law": "string",
        "misfit_p_value": "float", "misfit_detected": "bool", "mechanisms": "int", "unexplained": "bool",
        "unexplained_share": "float", "unexplained_like": "string", "sample_converged": "bool",
        "validation_blocks": "int", "validation_blocks_within_noise": "int",
        "validation_failed_rows": "int", "validation_seen": "bool", "force_validation_N": "float",
        "diameter_validation_mm": "float", "check_task": "string", "fit_task": "string",
        "sample_task": "string", "diagnose_task": "string", "validate_task": "string",
    },
    "numbers": {
        "case": "string", "source": "string", "name": "string", "value": "float", "sd": "float",
        "unit": "string", "prior": "float", "prior_sd": "float", "at_limit": "bool",
    },
    "mechanisms": {
        "case": "string", "id": "string", "name": "string", "probability": "float", "form_error": "float",
        "indistinguishable_from": "string",
    },
    "regions": {
        "case": "string", "channel": "string", "direction": "string", "pressure_low_kPa": "float",
        "pressure_high_kPa": "float", "contraction_low": "float", "contraction_high": "float",
        "share": "float",
    },
    "tasks": {"case": "string", "stage": "string", "state": "string", "reason": "string", "seconds": "float"},
}  # fmt: skip

_PANDAS_TYPES = {"string": "string", "float": "float64", "int": "Int64", "bool": "boolean", "date": "object"}


@dataclass(frozen=True)
class FleetTables:
    """Tables of a store as pandas frames, by name, and what they were built from.

    Attributes:
        frames: "cases", "numbers", "mechanisms", "regions" and "tasks".
        digest: SHA-256 of fleet.json and of all outcomes.
        document: contents of fleet.json.
    """

    frames: dict[str, pd.DataFrame]
    digest: str
    document: dict[str, Any]


def build_tables(folder: Path) -> FleetTables:
    """Return the tables of a store from the files of its cases.

    Raises:
        BadInput: if the folder is no store.
    """
    document, store = read_store_document(folder), FleetStore(folder)
    return _build_tables(store, document, _read_outcomes(store, document))


def _build_tables(
    store: FleetStore, document: dict[str, Any], outcomes: list[dict[str, TaskOutcome]]
) -> FleetTables:
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in _TABLE_COLUMNS}
    for entry, case_outcomes in zip(document["cases"], outcomes, strict=True):
        _collect_case(store, entry, case_outcomes, rows)
    frames = {name: _build_frame(name, table_rows) for name, table_rows in rows.items()}
    return FleetTables(frames, _compute_digest(document, outcomes), document)


def _read_outcomes(store: FleetStore, document: dict[str, Any]) -> list[dict[str, TaskOutcome]]:
    """Return the outcome of each stage of each case."""
    return [
        {
            stage: read_outcome(store.locate_stage(entry["name"], stage), key)
            for stage, key in entry["tasks"].items()
        }
        for entry in document["cases"]
    ]


def _compute_digest(document: dict[str, Any], outcomes: list[dict[str, TaskOutcome]]) -> str:
    """Return the SHA-256 of fleet.json and of the states of all tasks."""
    digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode())
    for case_outcomes in outcomes:
        for outcome in case_outcomes.values():
            digest.update(outcome.state.encode())
    return digest.hexdigest()


def write_tables(tables: FleetTables, folder: Path) -> list[Path]:
    """Write the tables of a store as Parquet files atomically, and return their paths."""
    import pyarrow.parquet as pq

    from pamjax.records.files import write_atomically

    (folder / _TABLE_FOLDER).mkdir(exist_ok=True)
    paths = []
    for name, frame in tables.frames.items():
        paths.append(folder / _TABLE_FOLDER / f"{name}.parquet")
        with write_atomically(paths[-1]) as temporary:
            pq.write_table(_to_arrow(name, frame, tables.digest), temporary)
    return paths


def read_tables(folder: Path) -> FleetTables:
    """Return the tables of a store: from its Parquet files, or from its cases if these are newer.

    Raises:
        BadInput: if the folder is no store.
    """
    import pyarrow.parquet as pq

    document, store = read_store_document(folder), FleetStore(folder)
    outcomes = _read_outcomes(store, document)
    digest, frames = _compute_digest(document, outcomes), {}
    for name in _TABLE_COLUMNS:
        try:
            table = pq.read_table(folder / _TABLE_FOLDER / f"{name}.parquet")
        except (OSError, ValueError):
            return _build_tables(store, document, outcomes)
        if (table.schema.metadata or {}).get(b"digest") != digest.encode():
            return _build_tables(store, document, outcomes)
        frames[name] = _build_frame(name, table.to_pylist())
    return FleetTables(frames, digest, document)


def _to_arrow(name: str, frame: pd.DataFrame, digest: str) -> pa.Table:
    import pyarrow as pa

    types = {
        "string": pa.string(),
        "float": pa.float64(),
        "int": pa.int64(),
        "bool": pa.bool_(),
        "date": pa.date32(),
    }
    columns = _TABLE_COLUMNS[name]
    schema = pa.schema([(column, types[kind]) for column, kind in columns.items()], {"digest": digest})
    arrays = [
        pa.array([None if pd.isna(v) else v for v in frame[column]], types[kind])
        for column, kind in columns.items()
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def _build_frame(name: str, rows: list[dict[str, Any]]) -> pd.DataFrame:
    columns = _TABLE_COLUMNS[name]
    data = {
        column: pd.Series([row.get(column) for row in rows], dtype=_PANDAS_TYPES[kind])
        for column, kind in columns.items()
    }
    return pd.DataFrame(data)


def _collect_case(
    store: FleetStore,
    entry: dict[str, Any],
    outcomes: dict[str, TaskOutcome],
    rows: dict[str, list[dict[str, Any]]],
) -> None:
    """Append the rows of one case."""
    name = entry["name"]
    done = [stage for stage, outcome in outcomes.items() if outcome.state == DONE]
    failed = next(((s, o) for s, o in outcomes.items() if o.state != DONE), None)
    rows["tasks"] += [
        {"case": name, "stage": s, "state": o.state, "reason": o.reason or None, "seconds": o.seconds}
        for s, o in outcomes.items()
    ]
    row: dict[str, Any] = {key: entry[key] for key in ("folder", "bench", "serial", "type", "checksum")}
    row |= {
        "case": name,
        "date": None if entry["date"] is None else pd.Timestamp(entry["date"]).date(),
        "state": DONE if failed is None else failed[1].state,
        "reason": f"{failed[0]}: {failed[1].reason}" if failed and failed[1].state != OPEN else None,
        "report": _find_report(store, name, done),
        **{f"{stage}_task": key for stage, key in entry["tasks"].items() if stage in done},
    }
    for stage, (file, collect_rows) in STAGE_ROWS.items():
        if stage in done:
            row |= collect_rows(name, read_json(store.locate_stage(name, stage) / file), rows)
    rows["cases"].append(row)


def _find_report(store: FleetStore, case: str, stages: list[str]) -> str | None:
    """Return the path of the last report of a case, relative to the store."""
    for stage in reversed(stages):
        path = store.locate_stage(case, stage) / "report.html"
        if path.is_file():
            return path.relative_to(store.folder).as_posix()
    return None
