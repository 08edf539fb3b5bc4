"""Case folders and the key of simulated recordings with effects in other forms."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from pamjax.benchmark.other_forms.draw import BankRecording
from pamjax.records.case import Case, build_case
from pamjax.records.files import write_atomically
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.writing.case_folder import build_table, write_case

#: Identifies the format of the key.
KEY_SCHEMA = "pamjax.bank/1"


def build_muscle_text(entry: MuscleToml) -> str:
    """Return the text of muscle.toml with the stated values of a drawn muscle."""
    assert entry.thread_length is not None
    assert entry.turns is not None
    sensors = entry.sensors
    document: dict[str, Any] = {
        "muscle": {
            "name": entry.name,
            "rest_length": _format(entry.rest_length.value, "mm", 1e-3),
            "thread_length": _state(entry.thread_length, "mm", 1e-3),
            "turns": {"value": _round(entry.turns.value), "sd": _round(entry.turns.sd)},
        }
    }
    if entry.stiffness is not None:
        document["thread"] = {"stiffness": _state(entry.stiffness, "N", 1.0)}
    document["sensors"] = {
        "force": _format(sensors.force or 0.0, "N", 1.0),
        "pressure": _format(sensors.pressure or 0.0, "kPa", 1e3),
        "diameter": _format(sensors.diameter or 0.0, "mm", 1e-3),
        "length": _format(sensors.length or 0.0, "mm", 1e-3),
    }
    document["baseline"] = {"model": entry.baseline}
    return tomlkit.dumps(document)


def _round(value: float) -> float:
    return float(f"{value:.7g}")


def _format(value: float, unit: str, scale: float) -> str:
    return f"{_round(value / scale):.7g} {unit}"


def _state(measured: MeasuredValue, unit: str, scale: float) -> dict[str, str]:
    return {"value": _format(measured.value, unit, scale), "sd": _format(measured.sd, unit, scale)}


def build_bank_case(bank_recording: BankRecording, name: str) -> Case:
    """Return the case of a recording, as it is read from its folder."""
    table = build_table(bank_recording.recording).to_csv(index=False).encode()
    toml = build_muscle_text(bank_recording.entry).encode()
    return build_case(toml, table, Path(name), "carry", "relaxed")


def build_key_entry(bank_recording: BankRecording) -> dict[str, Any]:
    """Return what a recording conceals: effects with sizes, true braid and sensors, SI."""
    r, braid = bank_recording, bank_recording.braid
    stated, true = r.entry.sensors, r.sensors
    channels = ("force", "diameter", "pressure", "length")
    return {
        "kind": r.kind,
        "baseline": r.entry.baseline,
        "rows": r.recording.n,
        "correlation": r.correlation,
        "misstated": r.misstated,
        "stated_sensor_sd": {name: getattr(stated, name) for name in channels},
        "true_over_stated": r.sensor_ratios,
        "sensor_sd": {name: getattr(true, name) for name in channels},
        "truth": {
            "thread_length_m": braid.thread,
            "turns": braid.turns,
            "stiffness_N": 1 / braid.compliance if braid.compliance else None,
        },
        "effects": [
            {
                "id": effect.id, "form": effect.form, "in_library": effect.in_library, "size": effect.size,
                "target_size": effect.target, "parameters": effect.parameters,
            }
            for effect in r.effects
        ],
        "unexplained": any(not effect.in_library for effect in r.effects),
        "largest_force_N": float(np.nanmax(r.recording.force)),
    }  # fmt: skip


def write_bank(
    folder: Path, bank_recordings: Sequence[BankRecording], notes: Sequence[dict[str, Any]] = ()
) -> Path:
    """Write the case folders r-001, r-002, ... and key.json, and return the path of the key.

    Args:
        folder: a folder that does not exist, or is empty.
        bank_recordings: the recordings.
        notes: more entries of the key for each recording.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cases = {}
    for k, bank_recording in enumerate(bank_recordings):
        name = f"r-{k + 1:03d}"
        write_case(folder / name, bank_recording.recording, build_muscle_text(bank_recording.entry))
        cases[name] = build_key_entry(bank_recording) | (dict(notes[k]) if notes else {})
    key = folder / "key.json"
    with write_atomically(key) as temporary:
        temporary.write_text(
            json.dumps({"schema": KEY_SCHEMA, "cases": cases}, indent=1, allow_nan=False) + "\n"
        )
    return key
