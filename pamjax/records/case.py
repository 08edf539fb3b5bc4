"""Case folders: a recording and the description of its muscle, checked for consistency."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import BadInput, suggest_word
from pamjax.notebook import NotebookText
from pamjax.records.checks.clipped_sensors import find_clipped_sensors
from pamjax.records.checks.force_zero import check_force_zero
from pamjax.records.checks.isotonic_units import check_isotonic_units
from pamjax.records.checks.stuck_sensors import find_stuck_sensors
from pamjax.records.checks.unit_errors import check_units
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.reading.muscle_toml import MeasuredValue, MuscleToml, read_muscle_toml
from pamjax.records.reading.table import parse_table
from pamjax.records.recording import Recording
from pamjax.units import format_count, format_quantity

RECORDING_FILE = "recording.csv"
MUSCLE_FILE = "muscle.toml"

#: At a jump of the recording, the memory of mechanisms continues (with the time that passed) or restarts, as
#: after a change of the specimen or a long rest.
_GAP_CHOICES = ("carry", "anew")
#: Before the first sample, the muscle was at rest, or it had run through the whole recording once.
_BEFORE_CHOICES = ("relaxed", "settled")


@dataclass(frozen=True, eq=False, repr=False)
class Case(NotebookText):
    """Contents of one case folder.

    Attributes:
        name: name of the folder.
        folder: path of the folder.
        muscle_toml: contents of muscle.toml, SI.
        recording: contents of recording.csv, SI.
        checksum: SHA-256 of the bytes of recording.csv followed by muscle.toml.
        recording_checksum: SHA-256 of the bytes of recording.csv; "" for a recording without a file.
        warnings: warnings for the user, one sentence each; the caller shows them.
        gaps: memory at a jump of the recording: "carry" or "anew".
        before: load history before the first sample: "relaxed" or "settled".
        text: text of muscle.toml.
    """

    name: str
    folder: Path
    muscle_toml: MuscleToml
    recording: Recording
    checksum: str
    warnings: tuple[str, ...] = ()
    gaps: str = "carry"
    before: str = "relaxed"
    text: str = field(default="", repr=False)
    recording_checksum: str = ""

    def __str__(self) -> str:
        recording = self.recording
        measured = recording.usable
        rest_length, rows = (
            format_quantity(self.muscle_toml.rest_length.value, "mm"),
            format_count(recording.n, "row"),
        )
        lines = [
            f"{self.name}: {self.muscle_toml.name}, {rows} of {' and '.join(recording.channels)}",
            f"  pressure {_format_range(recording.pressure[measured], 'kPa')}",
            f"  length {_format_range(recording.length[measured], 'mm')}, rest {rest_length}",
        ]
        return "\n".join(lines + [f"  note: {warning}" for warning in self.warnings])


def read_case(folder: str | Path, *, gaps: str = "carry", before: str = "relaxed") -> Case:
    """Return the case of a folder with `recording.csv` and `muscle.toml`.

    Warnings are not issued but stored in `Case.warnings`.

    Args:
        folder: path of the folder.
        gaps: "carry" or "anew": mechanisms with memory continue or restart at a jump of the recording.
        before: "relaxed" or "settled": the muscle was at rest, or had run the whole recording once.

    Returns:
        the `Case` with the recording and the contents of muscle.toml, SI.

    Raises:
        BadInput: if a file is missing, cannot be used, or contradicts the other.

    Example:
        case = pamjax.read_case("mine")
        print(case)
        print(case.warnings)
    """
    folder = Path(folder)
    if not folder.is_dir():
        remedy = (
            "Describe its columns in a TOML file: `pamjax import` then makes the case."
            if folder.is_file()
            else "Check the path, or create a case with `pamjax new`."
        )
        raise BadInput.from_rule(
            f"a case must be a folder with {RECORDING_FILE} and {MUSCLE_FILE}",
            f"{folder}, which is not a folder",
            remedy=remedy,
        )
    for file in (MUSCLE_FILE, RECORDING_FILE):
        if not (folder / file).exists():
            remedy = "Copy the one that `pamjax new` writes, and replace its values."
            raise BadInput.from_rule(
                f"a case must have {MUSCLE_FILE} and {RECORDING_FILE}", f"no {file}", f"{folder}", remedy
            )
    toml_bytes, csv_bytes = read_bytes(folder / MUSCLE_FILE), read_bytes(folder / RECORDING_FILE)
    return build_case(toml_bytes, csv_bytes, folder, gaps, before)


def ensure_case(source: Case | str | Path) -> Case:
    """Return the case itself, or read it from its folder.

    Raises:
        BadInput: as `read_case`, or for another type of argument.
    """
    if isinstance(source, Case):
        return source
    if not isinstance(source, str | Path):
        raise BadInput.from_rule(
            "a case must be a folder, or a result of `read_case` or `case_from`",
            repr(source)[:60],
            remedy="Pass the path of a case folder.",
        )
    return read_case(source)


def ensure_case_or_toml(source: MuscleToml | Case | str | Path) -> MuscleToml | Case:
    """Return the case of a folder with a recording, else the contents of muscle.toml.

    Args:
        source: a case, the contents of a muscle.toml, a case folder, a folder with muscle.toml, or that file.

    Raises:
        BadInput: as `read_case`, or for another type of argument.
    """
    if isinstance(source, MuscleToml | Case):
        return source
    if not isinstance(source, str | Path):
        raise BadInput.from_rule(
            "a muscle must be a case, a folder, a muscle.toml, or a result of `read_muscle_toml`",
            repr(source)[:60],
            remedy="Pass the path of a case folder.",
        )
    path = Path(source)
    if (path / RECORDING_FILE).exists():
        return read_case(path)
    file = path / MUSCLE_FILE if path.is_dir() else path
    return read_muscle_toml(read_bytes(file), file.name)


def build_case(
    toml_bytes: bytes,
    csv_bytes: bytes,
    folder: Path,
    gaps: str,
    before: str,
    file: str = RECORDING_FILE,
    source_units: Mapping[str, str] | None = None,
) -> Case:
    """Return the case from the bytes of its two files.

    Args:
        toml_bytes: bytes of muscle.toml.
        csv_bytes: bytes of recording.csv.
        folder: path of the case folder; need not exist.
        gaps, before: as for `read_case`.
        file: name of the recording in error messages.
        source_units: unit of each channel before its import, for messages about unit errors.
    """
    _check_choice("gaps", gaps, _GAP_CHOICES)
    _check_choice("before", before, _BEFORE_CHOICES)
    muscle_toml = read_muscle_toml(toml_bytes, MUSCLE_FILE)
    recording, warnings, units = parse_table(
        csv_bytes,
        file,
        muscle_toml.columns,
        muscle_toml.length,
        muscle_toml.measures_length,
        muscle_toml.load,
    )
    units |= source_units or {}
    warnings += check_units(recording, muscle_toml, units, file)
    warnings += check_isotonic_units(recording, muscle_toml, units, file)
    warnings += check_force_zero(recording, muscle_toml, file)
    stuck = find_stuck_sensors(recording, file)
    # A long clipped sequence is also a stuck sensor: one warning is sufficient.
    stuck_names = {sentence.split("`")[1] for sentence in stuck}
    warnings += [*stuck, *find_clipped_sensors(recording, file, stuck_names)]
    _check_length_below_thread(recording, muscle_toml, units.get("length", DISPLAY_UNIT["length"]), file)
    return Case(
        name=folder.resolve().name,
        folder=folder,
        muscle_toml=muscle_toml,
        recording=recording,
        checksum=_compute_checksum(csv_bytes, toml_bytes),
        warnings=tuple(warnings),
        gaps=gaps,
        before=before,
        text=decode_text(toml_bytes, MUSCLE_FILE),
        recording_checksum=_compute_checksum(csv_bytes),
    )


def _compute_checksum(*parts: bytes) -> str:
    checksum = hashlib.sha256()
    for part in parts:
        checksum.update(part)
    return checksum.hexdigest()


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        rule = f"`{name}` must be {' or '.join(choices)}"
        raise BadInput.from_rule(rule, f"{value!r}", remedy=suggest_word(value, choices))


def _check_length_below_thread(recording: Recording, muscle_toml: MuscleToml, unit: str, file: str) -> None:
    """Refuse a length above the thread's, with tolerance for stretch and for the thread length's sd."""
    thread = _compute_thread_length(muscle_toml)
    too_long = recording.length > thread.value + max(4.0 * thread.sd, 0.02 * thread.value)
    if too_long.any():
        i = int(np.argmax(too_long))
        rule = f"`length` must be shorter than the thread ({format_quantity(thread.value, unit)})"
        remedy = "Check the unit in the header of `length`, and `thread_length` in muscle.toml."
        raise BadInput.from_rule(
            rule, format_quantity(recording.length[i], unit), f"row {recording.row[i]} of {file}", remedy
        )


def _compute_thread_length(muscle_toml: MuscleToml) -> MeasuredValue:
    if muscle_toml.thread_length is not None:
        return muscle_toml.thread_length
    assert muscle_toml.braid_angle is not None
    length, rest_length, angle = muscle_toml.braid[0], muscle_toml.rest_length, muscle_toml.braid_angle
    # B = L / sin θ, so dB / B = dL / L - dθ / tan θ.
    return MeasuredValue(
        length, length * float(np.hypot(rest_length.sd / rest_length.value, angle.sd / np.tan(angle.value)))
    )


def _format_range(values: np.ndarray, unit: str) -> str:
    return f"{format_quantity(float(values.min()), unit)} to {format_quantity(float(values.max()), unit)}"
