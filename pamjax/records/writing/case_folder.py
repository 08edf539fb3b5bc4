"""Writing of a case folder from a recording and the text of a muscle.toml."""

from __future__ import annotations

from pathlib import Path

import tomlkit

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import BadInput
from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE
from pamjax.records.files import write_folder_atomically
from pamjax.records.recording import Recording

#: Decimals of each column in its display unit: finer than the resolution of any sensor.
COLUMN_DECIMALS = {"time": 4, "pressure": 4, "length": 5, "force": 4, "diameter": 5}


def write_case(folder: Path, recording: Recording, muscle: str) -> None:
    """Write recording.csv and muscle.toml, both or neither.

    Args:
        folder: a folder that does not exist, or is empty.
        recording: the recording.
        muscle: text of the muscle.toml; its table [columns] is removed, because the columns are written
            with their default headers.

    Raises:
        BadInput: if the folder is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        got = f"{folder}, which has files"
        raise BadInput.from_rule("a new case needs an empty folder", got, remedy="Choose another folder.")
    with write_folder_atomically(folder) as temporary:
        build_table(recording).to_csv(temporary / RECORDING_FILE, index=False)
        (temporary / MUSCLE_FILE).write_text(_drop_column_mapping(muscle), encoding="utf-8")


def build_table(recording: Recording):
    """Return the recording as a pandas table with default headers, rounded to `COLUMN_DECIMALS`."""
    frame = recording.to_frame()
    return frame.round({f"{name} [{unit}]": COLUMN_DECIMALS[name] for name, unit in DISPLAY_UNIT.items()})


def _drop_column_mapping(muscle: str) -> str:
    document = tomlkit.parse(muscle)
    document.pop("columns", None)
    return tomlkit.dumps(document)
