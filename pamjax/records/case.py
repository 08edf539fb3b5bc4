"""A case: one folder with what was measured and what the muscle is, checked against each other."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import nearest, refuse
from pamjax.records.checks.stuck_sensors import stuck
from pamjax.records.checks.unit_errors import no_slip
from pamjax.records.files import decode, read_bytes
from pamjax.records.reading.muscle_toml import Entry, Measured, read_entry
from pamjax.records.reading.table import parse_table
from pamjax.records.recording import Recording
from pamjax.units import many, show

RECORDING = "recording.csv"
MUSCLE = "muscle.toml"

#: At a jump of the recording memory goes on, time and all, or begins anew (a new specimen, a long rest).
GAPS = ("carry", "anew")
#: The muscle was at rest in its first state, or had been through the whole recording once.
BEFORE = ("relaxed", "settled")


@dataclass(frozen=True, eq=False)
class Case:
    """One case folder as read.

    Attributes:
        name: the folder's name.
        folder: where it lies.
        entry: what muscle.toml says.
        recording: what recording.csv says.
        gaps: what became of the muscle where the rig was moved: one of `GAPS`.
        before: what it had gone through before the first sample: one of `BEFORE`.
        checksum: SHA-256 over the bytes of recording.csv, then muscle.toml: the same data, the same sum.
        warnings: what its owner should know, one sentence each; the reader of a case shows them.
        text: of muscle.toml.
    """

    name: str
    folder: Path
    entry: Entry
    recording: Recording
    checksum: str
    warnings: tuple[str, ...] = ()
    gaps: str = "carry"
    before: str = "relaxed"
    text: str = field(default="", repr=False)

    def __str__(self) -> str:
        recording = self.recording
        measured = recording.usable
        rest, rows = show(self.entry.rest_length.value, "mm"), many(recording.n, "row")
        lines = [
            f"{self.name}: {self.entry.name}, {rows} of {' and '.join(recording.channels)}",
            f"  pressure {_range(recording.pressure[measured], 'kPa')}",
            f"  length {_range(recording.length[measured], 'mm')}, rest {rest}",
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
            f"a case is a folder with {RECORDING} and {MUSCLE}", f"{folder}, which is none", remedy=remedy
        )
    said, measured = read_bytes(folder / MUSCLE), read_bytes(folder / RECORDING)
    return case_of(said, measured, folder, gaps, before)


def as_case(source: Case | str | Path) -> Case:
    """The case, or the one that lies in a folder.

    Raises:
        BadInput: as `read_case`, or for what is neither.
    """
    if isinstance(source, Case):
        return source
    if not isinstance(source, str | Path):
        raise refuse("a case is what `read_case` or `case_from` makes, or its folder", repr(source)[:60])
    return read_case(source)


def as_muscle(source: Entry | Case | str | Path) -> Entry | Case:
    """What a lab knows of a muscle: the case of a folder that holds a recording, else what muscle.toml says.

    Args:
        source: either of them already, a case folder, a folder with muscle.toml alone, or that file.

    Raises:
        BadInput: as `read_case`, or for what is none of these.
    """
    if isinstance(source, Entry | Case):
        return source
    if not isinstance(source, str | Path):
        raise refuse("a muscle is a case, what `read_entry` reads, or its file or folder", repr(source)[:60])
    path = Path(source)
    if (path / RECORDING).exists():
        return read_case(path)
    file = path / MUSCLE if path.is_dir() else path
    return read_entry(read_bytes(file), file.name)


def case_of(
    said: bytes, measured: bytes, folder: Path, gaps: str, before: str, file: str = RECORDING
) -> Case:
    """A case from the bytes of its two files.

    Args:
        said: of muscle.toml.
        measured: of recording.csv.
        folder: where they lie, or would lie.
        gaps, before: as for `read_case`.
        file: what the recording is called in error texts.
    """
    _one_of("gaps", gaps, GAPS)
    _one_of("before", before, BEFORE)
    entry = read_entry(said, MUSCLE)
    recording, notes, units = parse_table(measured, file, entry.columns, entry.length)
    notes += [*no_slip(recording, entry, units, file), *stuck(recording, file)]
    _within_thread(recording, entry, units.get("length", DISPLAY_UNIT["length"]), file)
    return Case(
        name=folder.resolve().name,
        folder=folder,
        entry=entry,
        recording=recording,
        checksum=hashlib.sha256(measured + said).hexdigest(),
        warnings=tuple(notes),
        gaps=gaps,
        before=before,
        text=decode(said, MUSCLE),
    )


def _one_of(name: str, got: str, known: tuple[str, ...]) -> None:
    if got not in known:
        raise refuse(f"`{name}` is {' or '.join(known)}", f"{got!r}", remedy=nearest(got, known))


def _within_thread(recording: Recording, entry: Entry, unit: str, file: str) -> None:
    """No length beyond the thread's, but for its stretch and what the thread's length may be wrong by."""
    thread = _thread(entry)
    beyond = recording.length > thread.value + max(4.0 * thread.sd, 0.02 * thread.value)
    if beyond.any():
        i = int(np.argmax(beyond))
        rule = f"`length` must be shorter than the thread ({show(thread.value, unit)})"
        remedy = "Check the unit in its header and `thread_length`."
        raise refuse(rule, show(recording.length[i], unit), f"row {recording.row[i]} of {file}", remedy)


def _thread(entry: Entry) -> Measured:
    if entry.thread_length is not None:
        return entry.thread_length
    assert entry.braid_angle is not None
    length, rest, angle = entry.braid[0], entry.rest_length, entry.braid_angle
    # B = L / sin θ, so dB / B = dL / L - dθ / tan θ.
    return Measured(length, length * float(np.hypot(rest.sd / rest.value, angle.sd / np.tan(angle.value))))


def _range(values: np.ndarray, unit: str) -> str:
    return f"{show(float(values.min()), unit)} to {show(float(values.max()), unit)}"
