"""The files of a drawn recording as text, and the case that is read from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import tomlkit

from pamjax.records.case import Case, build_case
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.recording import Recording
from pamjax.records.writing.case_folder import build_table


def build_muscle_text(muscle_toml: MuscleToml) -> str:
    """Return the text of muscle.toml with the stated values of a drawn muscle."""
    assert muscle_toml.thread_length is not None
    assert muscle_toml.turns is not None
    sensors = muscle_toml.sensors
    document: dict[str, Any] = {
        "muscle": {
            "name": muscle_toml.name,
            "rest_length": _format(muscle_toml.rest_length.value, "mm", 1e-3),
            "thread_length": _state(muscle_toml.thread_length, "mm", 1e-3),
            "turns": {"value": _round(muscle_toml.turns.value), "sd": _round(muscle_toml.turns.sd)},
        }
    }
    if muscle_toml.stiffness is not None:
        document["thread"] = {"stiffness": _state(muscle_toml.stiffness, "N", 1.0)}
    document["sensors"] = {
        "force": _format(sensors.force or 0.0, "N", 1.0),
        "pressure": _format(sensors.pressure or 0.0, "kPa", 1e3),
        "diameter": _format(sensors.diameter or 0.0, "mm", 1e-3),
        "length": _format(sensors.length or 0.0, "mm", 1e-3),
    }
    document["baseline"] = {"model": muscle_toml.baseline}
    return tomlkit.dumps(document)


def _round(value: float) -> float:
    return float(f"{value:.7g}")


def _format(value: float, unit: str, scale: float) -> str:
    return f"{_round(value / scale):.7g} {unit}"


def _state(measured: MeasuredValue, unit: str, scale: float) -> dict[str, str]:
    return {"value": _format(measured.value, unit, scale), "sd": _format(measured.sd, unit, scale)}


def build_text_case(muscle_toml: MuscleToml, recording: Recording, name: str) -> Case:
    """Return the case of stated values and channels, as it is read from its folder.

    Raises:
        BadInput: if the reader refuses the recording, for example a pressure far below zero.
    """
    table = build_table(recording).to_csv(index=False).encode()
    return build_case(build_muscle_text(muscle_toml).encode(), table, Path(name), "carry", "relaxed")
