"""Case folders and the key of simulated recordings with effects in other forms."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pamjax.benchmark.other_forms.case_text import build_muscle_text, build_text_case
from pamjax.benchmark.other_forms.draw import BankRecording
from pamjax.records.case import Case
from pamjax.records.files import write_atomically
from pamjax.records.writing.case_folder import write_case

#: Identifies the format of the key.
_KEY_SCHEMA = "pamjax.bank/1"


def build_bank_case(bank_recording: BankRecording, name: str) -> Case:
    """Return the case of a recording, as it is read from its folder."""
    return build_text_case(bank_recording.muscle_toml, bank_recording.recording, name)


def _build_key_entry(bank_recording: BankRecording) -> dict[str, Any]:
    """Return what a recording conceals: effects with sizes, true braid and sensors, SI."""
    r, braid = bank_recording, bank_recording.braid
    stated_sensors, true_sensors = r.muscle_toml.sensors, r.sensors
    channels = ("force", "diameter", "pressure", "length")
    return {
        "kind": r.kind,
        "baseline": r.muscle_toml.baseline,
        "rows": r.recording.n,
        "correlation": r.correlation,
        "misstated": r.misstated,
        "stated_sensor_sd": {name: getattr(stated_sensors, name) for name in channels},
        "true_over_stated": r.sensor_ratios,
        "sensor_sd": {name: getattr(true_sensors, name) for name in channels},
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
    folder: Path, bank_recordings: Sequence[BankRecording], more_entries: Sequence[dict[str, Any]] = ()
) -> Path:
    """Write the case folders r-001, r-002, ... and key.json, and return the path of the key.

    Args:
        folder: a folder that does not exist, or is empty.
        bank_recordings: the recordings.
        more_entries: more entries of the key for each recording.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cases = {}
    for k, bank_recording in enumerate(bank_recordings):
        name = f"r-{k + 1:03d}"
        write_case(folder / name, bank_recording.recording, build_muscle_text(bank_recording.muscle_toml))
        cases[name] = _build_key_entry(bank_recording) | (dict(more_entries[k]) if more_entries else {})
    key = folder / "key.json"
    with write_atomically(key) as temporary:
        temporary.write_text(
            json.dumps({"schema": _KEY_SCHEMA, "cases": cases}, indent=1, allow_nan=False) + "\n"
        )
    return key
