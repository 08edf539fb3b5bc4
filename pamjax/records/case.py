"""A case: one folder with what was measured and what the muscle is, checked against each other."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import refuse, suggest_word
from pamjax.records.checks.stuck_sensors import find_stuck_sensors
from pamjax.records.checks.unit_errors import check_units
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.reading.muscle_toml import MeasuredValue, MuscleToml, read_muscle_toml
from pamjax.records.reading.table import parse_table
from pamjax.records.recording import Recording
from pamjax.units import format_count, format_quantity

RECORDING_FILE = "recording.csv"
MUSCLE_FILE = "muscle.toml"

#: At a jump of the recording memory goes on, time and all, or begins anew (a new specimen, a long rest).
GAP_CHOICES = ("carry", "anew")
#: The muscle was at rest in its first state, or had been through the whole recording once.
BEFORE_CHOICES = ("relaxed", "settled")


@dataclass(frozen=True, eq=False)
class Case:
    """One case folder as read.

    Attributes:
        name: the folder's name.
        folder: where it lies.
        entry: what muscle.toml says.
        recording: what recording.csv says.
        gaps: what became of the muscle where the rig was moved: one of `GAP_CHOICES`.
        before: what it had gone through before the first sample: one of `BASELINE_MARK_COLOUR`.
        checksum: SHA-256 over the bytes of recording.csv, then muscle.toml: the same data, the same sum.
        warnings: what its owner should know, one sentence each; the reader of a case shows them.
        text: of muscle.toml.
    """

    name: str
    folder: Path
    entry: MuscleToml
    recording: Recording
    checksum: str
    warnings: tuple[str, ...] = ()
    gaps: str = "carry"
    before: str = "relaxed"
    text: str = field(default="", repr=False)

    def __str__(self) -> str:
        recording = self.recording
        measured = recording.usable
        rest, rows = format_quantity(self.entry.rest_length.value, "mm"), format_count(recording.n, "row")
        lines = [
            f"{self.name}: {self.entry.name}, {rows} of {' and '.join(recording.channels)}",
            f"  pressure {_format_range(recording.pressure[measured], 'kPa')}",
            f"  length {_format_range(recording.length[measured], 'mm')}, rest {rest}",
        ]
        return "\n".join(lines + [f"  note: {warning}" for warning in self.warnings])


def read_case(folder: str | Path, *, gaps: str = "carry", before: str = "relaxed") -> Case:
    """Read a case folder: `recording.csv` and `muscle.toml`.

    Nothing is warned aloud here: what the owner should know is in `warnings`.

    Args:
        folder: where it lies.
        gaps: "carry" or "anew", what mechanisms that remember do at a jump of the recording.
        before: "relaxed" or "settled", what the muscle had gone through before the first sample.

    Raises:
        BadInput: in one sentence, if a file is missing, cannot be used, or contradicts the other.
    """
    folder = Path(folder)
    if not folder.is_dir():
        remedy = "`pamjax new` makes one to fill in."
        raise refuse(
            f"a case is a folder with {RECORDING_FILE} and {MUSCLE_FILE}",
            f"{folder}, which is none",
            remedy=remedy,
        )
    toml_bytes, csv_bytes = read_bytes(folder / MUSCLE_FILE), read_bytes(folder / RECORDING_FILE)
    return build_case(toml_bytes, csv_bytes, folder, gaps, before)


def load_case(source: Case | str | Path) -> Case:
    """The case, or the one that lies in a folder.

    Raises:
        BadInput: as `read_case`, or for what is neither.
    """
    if isinstance(source, Case):
        return source
    if not isinstance(source, str | Path):
        raise refuse("a case is what `read_case` or `case_from` makes, or its folder", repr(source)[:60])
    return read_case(source)


def load_case_or_toml(source: MuscleToml | Case | str | Path) -> MuscleToml | Case:
    """What a lab knows of a muscle: the case of a folder that holds a recording, else what muscle.toml says.

    Args:
        source: either of them already, a case folder, a folder with muscle.toml alone, or that file.

    Raises:
        BadInput: as `read_case`, or for what is none of these.
    """
    if isinstance(source, MuscleToml | Case):
        return source
    if not isinstance(source, str | Path):
        raise refuse(
            "a muscle is a case, what `read_muscle_toml` reads, or its file or folder", repr(source)[:60]
        )
    path = Path(source)
    if (path / RECORDING_FILE).exists():
        return read_case(path)
    file = path / MUSCLE_FILE if path.is_dir() else path
    return read_muscle_toml(read_bytes(file), file.name)


def build_case(
    toml_bytes: bytes, csv_bytes: bytes, folder: Path, gaps: str, before: str, file: str = RECORDING_FILE
) -> Case:
    """A case from the bytes of its two files.

    Args:
        toml_bytes: of muscle.toml.
        csv_bytes: of recording.csv.
        folder: where they lie, or would lie.
        gaps, before: as for `read_case`.
        file: what the recording is called in error texts.
    """
    _check_choice("gaps", gaps, GAP_CHOICES)
    _check_choice("before", before, BEFORE_CHOICES)
    entry = read_muscle_toml(toml_bytes, MUSCLE_FILE)
    recording, notes, units = parse_table(csv_bytes, file, entry.columns, entry.length)
    notes += [*check_units(recording, entry, units, file), *find_stuck_sensors(recording, file)]
    _check_length_below_thread(recording, entry, units.get("length", DISPLAY_UNIT["length"]), file)
    return Case(
        name=folder.resolve().name,
        folder=folder,
        entry=entry,
        recording=recording,
        checksum=hashlib.sha256(csv_bytes + toml_bytes).hexdigest(),
        warnings=tuple(notes),
        gaps=gaps,
        before=before,
        text=decode_text(toml_bytes, MUSCLE_FILE),
    )


def _check_choice(name: str, got: str, known: tuple[str, ...]) -> None:
    if got not in known:
        raise refuse(f"`{name}` is {' or '.join(known)}", f"{got!r}", remedy=suggest_word(got, known))


def _check_length_below_thread(recording: Recording, entry: MuscleToml, unit: str, file: str) -> None:
    """No length beyond the thread's, but for its stretch and what the thread's length may be wrong by."""
    thread = _compute_thread_length(entry)
    beyond = recording.length > thread.value + max(4.0 * thread.sd, 0.02 * thread.value)
    if beyond.any():
        i = int(np.argmax(beyond))
        rule = f"`length` must be shorter than the thread ({format_quantity(thread.value, unit)})"
        remedy = "Check the unit in its header and `thread_length`."
        raise refuse(
            rule, format_quantity(recording.length[i], unit), f"row {recording.row[i]} of {file}", remedy
        )


def _compute_thread_length(entry: MuscleToml) -> MeasuredValue:
    if entry.thread_length is not None:
        return entry.thread_length
    assert entry.braid_angle is not None
    length, rest, angle = entry.braid[0], entry.rest_length, entry.braid_angle
    # B = L / sin θ, so dB / B = dL / L - dθ / tan θ.
    return MeasuredValue(
        length, length * float(np.hypot(rest.sd / rest.value, angle.sd / np.tan(angle.value)))
    )


def _format_range(values: np.ndarray, unit: str) -> str:
    return f"{format_quantity(float(values.min()), unit)} to {format_quantity(float(values.max()), unit)}"
