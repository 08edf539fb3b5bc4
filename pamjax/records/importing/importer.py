"""Import of a rig's files into a case folder: read, tare, filter and join the tests."""

from __future__ import annotations

import glob
import itertools
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import BadInput
from pamjax.notebook import NotebookText
from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE, Case, build_case, read_case
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.importing.blank_cells import BlankCells, format_notes
from pamjax.records.importing.channel import check_time_steps, read_channel, read_clock
from pamjax.records.importing.import_spec import LENGTH_SOURCES, ImportSpec, TestTable, read_import_spec
from pamjax.records.importing.rig_file import RigFile
from pamjax.records.reading.header import COLUMN_KINDS, GAUGE_UNITS
from pamjax.records.reading.muscle_toml import read_muscle_toml
from pamjax.records.recording import MAX_CYCLE, Recording
from pamjax.records.writing.case_folder import write_case
from pamjax.records.writing.template import MUSCLE_TEMPLATE
from pamjax.units import format_count, format_quantity, parse_quantity

#: Separator of the names of a test's files.
_FILE_SEPARATOR = " + "
#: Longest time between two tests, s: ten years.
_MAX_GAP = 3.2e8
_EXAMPLE_NOTE = (
    "muscle.toml has the rest length and the braid of the template. Replace them by yours, and import again."
)
#: Order in which channels are read; the file of the first one determines the time of a test.
_CHANNEL_ORDER = ("force", "pressure", "length", *LENGTH_SOURCES, "diameter", "cycle")


@dataclass(frozen=True, repr=False)
class ImportResult(NotebookText):
    """Result of an import.

    Attributes:
        case: the case.
        tests: names of each test's files, in the order of the recording.
        samples: number of samples before the median filter.
        tare: lowest and highest tare reading of all tests, and the true value, for each channel; SI.
        notes: notes about the cells of the files, one sentence or two each.
    """

    case: Case
    tests: tuple[str, ...]
    samples: int
    tare: dict[str, tuple[float, float, float]]
    notes: tuple[str, ...] = ()

    @property
    def has_example_values(self) -> bool:
        """Return whether rest length and braid are those of the template of `pamjax new`."""
        own, example = self.case.muscle_toml, read_muscle_toml(MUSCLE_TEMPLATE.encode())
        return all(
            getattr(own, name) == getattr(example, name) for name in ("rest_length", "thread_length", "turns")
        )

    def __str__(self) -> str:
        files = {name for test in self.tests for name in test.split(_FILE_SEPARATOR)}
        lines = [
            f"{self.case}",
            f"  from {format_count(len(files), 'file')} with {format_count(self.samples, 'sample')}",
        ]
        for name, (low, high, true) in self.tare.items():
            low, high, true = (format_quantity(value, DISPLAY_UNIT[name]) for value in (low, high, true))
            lines.append(f"  tare: {name} reading {low} to {high}, true value {true}")
        recording = self.case.recording
        for name in recording.channels:
            if blank := int(np.isnan(getattr(recording, name)).sum()):
                lines.append(f"  {format_count(blank, 'row')} without {name}")
        return "\n".join(lines + [f"  note: {note}" for note in self._all_notes])

    @property
    def _all_notes(self) -> list[str]:
        return [*self.notes, *([_EXAMPLE_NOTE] if self.has_example_values else [])]

    def as_dict(self) -> dict:
        """Return the result as a dictionary, for JSON."""
        return {
            "case": str(self.case.folder),
            "rows": self.case.recording.n,
            "samples": self.samples,
            "tests": list(self.tests),
            "tare": {n: dict(zip(("low", "high", "true"), v, strict=True)) for n, v in self.tare.items()},
            "warnings": [*self.case.warnings, *self._all_notes],
        }


def import_case(rig: str | Path, folder: str | Path) -> ImportResult:
    """Write a case folder from the files of a rig.

    Args:
        rig: path of the import specification (TOML); its paths are relative to its folder.
        folder: the case folder to write; must not exist, or be empty.

    Returns:
        the `ImportResult` with the case and the number of samples; `print` shows its summary.

    Raises:
        BadInput: with file, row and column, if the files cannot be used. Then nothing is written.

    Example:
        print(pamjax.import_case("rig.toml", "mine"))
    """
    rig, folder = Path(rig), Path(folder)
    spec, base_folder = read_import_spec(rig), rig.absolute().parent
    if not spec.muscle or not (base_folder / spec.muscle).is_file():
        remedy = "Check the path, or create one with `pamjax new`."
        raise BadInput.from_rule("`muscle` must be the path of a muscle.toml", spec.muscle, rig.name, remedy)
    _check_inside(base_folder / spec.muscle, base_folder, spec.muscle, rig.name)
    muscle = read_bytes(base_folder / spec.muscle)
    rest_length = read_muscle_toml(muscle, Path(spec.muscle).name).rest_length.value
    tests = [(files, test) for test in spec.tests for files in _find_files(test, base_folder)]
    pieces, tare_readings, blanks, file_notes, units = zip(
        *(_read_test(spec, files, test, rest_length) for files, test in tests), strict=True
    )
    chain = itertools.chain.from_iterable
    notes = (*format_notes(chain(blanks)), *dict.fromkeys(chain(file_notes)))
    recording = _join_tests(pieces, spec)
    text = decode_text(muscle, Path(spec.muscle).name)
    # An invalid case is not written: read it first in a temporary folder.
    with TemporaryDirectory() as trial_folder:
        write_case(Path(trial_folder) / "case", recording, text)
        try:
            _check_case(Path(trial_folder) / "case", units[0])
        except BadInput as error:
            message = " ".join([f"{error}", *(f"Note: {note}" for note in notes)])
            raise BadInput(f"the case of {rig.name} is invalid and was not written: {message}") from error
    write_case(folder, recording, text)
    names = tuple(
        _FILE_SEPARATOR.join(dict.fromkeys(path.name for path in files.values())) for files, _ in tests
    )
    samples = sum(len(piece["pressure"]) for piece in pieces)
    return ImportResult(read_case(folder), names, samples, _summarise_tare(spec, tare_readings), notes)


def _check_case(folder: Path, units: dict[str, str]) -> None:
    """Refuse an invalid case.

    Args:
        folder: the case folder.
        units: unit of each channel in the files of the rig.
    """
    muscle, recording = read_bytes(folder / MUSCLE_FILE), read_bytes(folder / RECORDING_FILE)
    build_case(muscle, recording, folder, "carry", "relaxed", source_units=units)


def _summarise_tare(
    spec: ImportSpec, tare_readings: Sequence[dict[str, float]]
) -> dict[str, tuple[float, float, float]]:
    """Return lowest and highest reading of all tests, and the true value, by channel."""
    true = spec.tare.parse_true_values() if spec.tare else {}
    return {
        n: (min(r[n] for r in tare_readings), max(r[n] for r in tare_readings), value)
        for n, value in true.items()
    }


def _find_files(test: TestTable, base_folder: Path) -> list[dict[str, Path]]:
    """Return the files by channel of each test that the patterns match."""
    patterns_by_channel = test.file if isinstance(test.file, dict) else {"": test.file}
    matches = {
        channel: _match_patterns(patterns, base_folder) for channel, patterns in patterns_by_channel.items()
    }
    counts = {len(paths) for paths in matches.values()}
    if len(counts) > 1:
        got = " and ".join(f"{len(paths)} for {channel}" for channel, paths in matches.items())
        rule = "the patterns of a test must match the same number of files for each channel"
        raise BadInput.from_rule(rule, got, remedy="Check the patterns in [[tests]].")
    return [dict(zip(matches, paths, strict=True)) for paths in zip(*matches.values(), strict=True)]


def _match_patterns(patterns: str | list[str], base_folder: Path) -> list[Path]:
    files = []
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        paths = glob.glob(os.path.join(glob.escape(str(base_folder)), pattern))
        for path in paths:
            _check_inside(Path(path), base_folder, pattern, "[[tests]]")
        if not paths:
            got = f"no match for {pattern}"
            raise BadInput.from_rule(
                "each test needs a file", got, f"{base_folder}", "Check `file` in [[tests]]."
            )
        files += sorted(paths, key=_build_sort_key)
    return [Path(path) for path in files]


def _check_inside(path: Path, base_folder: Path, text: str, where: str) -> None:
    """Refuse a file outside the folder of the specification: messages quote cells of the files."""
    # `Path.resolve` raises an error for a link to itself; `realpath` does not.
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(base_folder)):
        rule = "files of an import must be in the folder of its TOML file, or below"
        raise BadInput.from_rule(rule, text, where, "Copy the files there.")


def _build_sort_key(text: str) -> list:
    """Return a sort key of natural order: test 10 after test 9."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"([0-9]+)", text)]


def _read_test(
    spec: ImportSpec, paths: dict[str, Path], test: TestTable, rest_length: float
) -> tuple[dict[str, np.ndarray], dict[str, float], list[BlankCells], list[str], dict[str, str]]:
    """Return channels, SI, tared, with time from 0; tare readings; blank cells; notes; and units.

    Args:
        spec: the import specification.
        paths: file of each channel.
        test: the test.
        rest_length: rest length of the muscle, m.
    """
    rig_files = {channel: RigFile(path, spec.files) for channel, path in paths.items()}
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    blanks: list[BlankCells] = []
    clock, clock_file = None, None
    for name in (name for name in _CHANNEL_ORDER if name in spec.columns):
        file = rig_files.get(name) or rig_files[""]
        values, time = read_channel(spec, name, file), read_clock(spec, file)
        column = spec.columns[name].column
        blanks += file.find_blanks(column)
        if name in DISPLAY_UNIT and (unit := spec.columns[name].find_unit(file.find_header(column))):
            units[name] = GAUGE_UNITS.get(unit, unit)
        if clock is None:
            clock, clock_file = time, file
        first_channel = next(iter(columns.values()), values)
        row_count = len(first_channel) if clock is None else len(values)
        if len(values) != (row_count if time is None else len(time)):
            remedy = "State the column of `time`, or the `rate` in [files]."
            rule = "a channel must have as many rows as its `time`, or without `time` as the other channels"
            raise BadInput.from_rule(rule, f"{len(values)} rows of `{name}`", file.name, remedy)
        if time is not None and clock is not None and file is not clock_file:
            # Outside the time of its own file, a channel was not measured.
            values = np.interp(clock, time, values, left=np.nan, right=np.nan)
        columns[name] = values
    if "contraction" in columns:
        columns["length"] = rest_length * (1 - columns.pop("contraction"))
    if "shortening" in columns:
        columns["length"] = rest_length - columns.pop("shortening")
    n = len(next(iter(columns.values())))
    for name in ("pressure", "length"):
        if text := getattr(test, name):
            columns[name] = np.full(n, parse_quantity(text, COLUMN_KINDS[name], f"[[tests]] {name}"))
    if clock is not None:
        columns |= {"time": clock - clock[0], "row": np.arange(n)}
    columns, tare_readings = _subtract_tare(columns, spec, next(iter(paths.values())).name)
    if clock_file is not None and clock is not None:
        check_time_steps(spec, columns["time"], columns.pop("row"), clock_file)
    notes = list(itertools.chain.from_iterable(file.all_notes for file in rig_files.values()))
    return columns, tare_readings, blanks, notes, units


def _subtract_tare(
    columns: dict[str, np.ndarray], spec: ImportSpec, file: str
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the tared channels, and the reading of each channel with a stated true value."""
    if spec.tare is None:
        return columns, {}
    if "time" not in columns:
        remedy = "State the column of `time`, or the `rate` in [files]."
        raise BadInput.from_rule("[tare] needs the time of each row", "none", file, remedy)
    start, end = spec.tare.parse_span()
    inside = (columns["time"] >= start) & (columns["time"] <= end)
    if not inside.any():
        rule = "each test must have samples in the interval of [tare]"
        raise BadInput.from_rule(rule, f"none from {start:g} to {end:g} s", file, "Check `start` and `end`.")
    tare_readings: dict[str, float] = {}
    for name, true in spec.tare.parse_true_values().items():
        if name not in columns:
            rule = f"`{name}` of [tare] must be a column"
            raise BadInput.from_rule(rule, "none", "[columns]", "Add it there, or remove it from [tare].")
        readings = columns[name][inside]
        if not np.isfinite(readings).any():
            rule = f"`{name}` must be measured in the interval of [tare]"
            got = f"no value from {start:g} to {end:g} s"
            raise BadInput.from_rule(
                rule, got, file, f"Check `start` and `end`, or remove `{name}` from [tare]."
            )
        tare_readings[name] = float(np.nanmedian(readings))
        columns[name] = columns[name] - tare_readings[name] + true
    # A tare interval of zero length removes no row.
    if not spec.tare.cut or end == start:
        return columns, tare_readings
    if inside.all():
        got = f"{columns['time'][-1]:g} s in total"
        raise BadInput.from_rule("a test must be longer than its [tare]", got, file, "Check `end` of [tare].")
    return {name: values[~inside] for name, values in columns.items()}, tare_readings


def _thin_columns(columns: dict[str, np.ndarray], block: float) -> dict[str, np.ndarray]:
    """Return the medians over blocks of time, s; a block without samples gives no row."""
    import pandas as pd

    number = np.floor(columns["time"] / block * (1 + 1e-12)).astype(int)
    table = pd.DataFrame(columns).groupby(number).median()
    return {str(name): table[name].to_numpy() for name in table.columns}


def _join_tests(pieces: Sequence[dict[str, np.ndarray]], spec: ImportSpec) -> Recording:
    """Return all tests as one recording, numbered in `cycle` if there is no such column."""
    gap = parse_quantity(spec.gap, "time", "`gap`")
    if not 0.0 < gap <= _MAX_GAP:
        raise BadInput.from_rule(
            "`gap` must be positive and at most 10 years", spec.gap, "", "Write it as `1 s`."
        )
    has_time = {"time" in piece for piece in pieces} == {True}
    if spec.median:
        block = parse_quantity(spec.median, "time", "`median`")
        if not has_time or block <= 0:
            rule = "`median` must be a positive duration, and each row needs a time"
            raise BadInput.from_rule(
                rule, spec.median, "", "State the column of `time`, or the `rate` in [files]."
            )
        pieces = [_thin_columns(piece, block) for piece in pieces]
    start_time = 0.0
    for number, piece in enumerate(pieces, 1):
        piece.setdefault("cycle", np.full(len(piece["pressure"]), float(number)))
        if has_time:
            piece["time"] = piece["time"] + start_time
            start_time = float(piece["time"][-1]) + gap
    joined_columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    _check_cycles(joined_columns["cycle"])
    return Recording.from_arrays(
        time=joined_columns.get("time"),
        pressure=joined_columns["pressure"],
        length=joined_columns["length"],
        force=joined_columns.get("force"),
        diameter=joined_columns.get("diameter"),
        cycle=joined_columns["cycle"].astype(int),
    )


def _check_cycles(cycle: np.ndarray) -> None:
    is_valid = (cycle >= 0) & (cycle <= MAX_CYCLE) & (cycle == np.round(cycle))
    if not is_valid.all():
        rule = f"`cycle` must be a whole number from 0 to {MAX_CYCLE}"
        got = f"{cycle[np.argmin(is_valid)]:g}"
        raise BadInput.from_rule(rule, got, "the files of [[tests]]", "Number the strokes 1, 2, 3.")
