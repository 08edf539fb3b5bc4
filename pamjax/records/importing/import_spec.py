"""Import specification (TOML): format of a rig's files, columns, tests, tare and median filter."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from pamjax.errors import BadInput, suggest_word
from pamjax.records.files import read_bytes
from pamjax.records.importing.column_unit import convert_unit
from pamjax.records.reading import toml_errors
from pamjax.records.reading.header import COLUMN_KINDS, split_title
from pamjax.records.toml_text import parse_toml
from pamjax.units import parse_quantity

#: Names of pydantic's readers, which occur in the location of an error.
_READER_NAME_PATTERN = re.compile(r"function-.*|str|int|constrained-int|list\[.*|dict\[.*")


class _ImportTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FilesTable(_ImportTable):
    """[files]: format of the files.

    Attributes:
        separator: separator of cells.
        decimal: decimal mark.
        thousands: mark between thousands, as "." in 1.130,0; empty if there is none.
        header: whether there is a header line.
        units: whether the line below the header contains the units.
        skip: number of lines before the header, or before the first row if there is no header.
        encoding: encoding of a text file; Excel writes cp1252 if it does not write UTF-8.
        matrix: name of the variable of a MAT file, if the channels are columns of one matrix.
        sheet: name of the sheet of a spreadsheet; empty for the first.
        rate: sampling rate, as "500 Hz", if there is no time column.
    """

    separator: Literal[",", ";", "tab", "space"] = ","
    decimal: Literal[".", ","] = "."
    thousands: Literal["", ".", ",", " ", "'"] = ""
    header: bool = True
    units: bool = False
    encoding: Literal["utf-8", "cp1252"] = "utf-8"
    skip: Annotated[int, Field(ge=0)] = 0
    matrix: str = ""
    sheet: str = ""
    rate: str = ""

    @property
    def lines_above(self) -> int:
        """Return the number of lines above the first row of numbers."""
        return self.skip + self.header + self.units

    @property
    def skipped_lines(self) -> list[int]:
        """Return the indices of the lines that are neither header nor row; the first line is 0."""
        return [*range(self.skip), *([self.skip + 1] if self.units else [])]

    @model_validator(mode="after")
    def _check_units(self) -> FilesTable:
        if self.units and not self.header:
            rule, remedy = "`units` needs a header above the units", "Remove `header = false` or `units`."
            raise BadInput.from_rule(rule, "no header", "[files]", remedy)
        return self

    @model_validator(mode="after")
    def _check_marks(self) -> FilesTable:
        if self.thousands == self.decimal:
            rule, remedy = "`thousands` and `decimal` must differ", "Correct one of them."
            raise BadInput.from_rule(rule, repr(self.decimal), "[files]", remedy)
        return self


#: Columns from which the length is computed with the rest length, with their kinds of quantity.
LENGTH_SOURCES = {"contraction": "contraction", "shortening": "length"}

#: Kind of quantity of each column of [columns].
_KINDS = COLUMN_KINDS | LENGTH_SOURCES

#: Unit of each kind of channel, for the messages.
_EXAMPLE_UNITS = {"force": "N", "pressure": "kPa", "length": "mm", "time": "s", "contraction": "%"}

#: Value of the units of a contraction.
_CONTRACTION_UNITS = {"%": 0.01, "1": 1.0}


def _check_scale(scale: float) -> float:
    if scale == 0.0:
        remedy = "Write the channel's units per unit of the file."
        raise BadInput.from_rule("`scale` must not be zero", "0", "[columns]", remedy)
    return scale


class ChannelEntry(_ImportTable):
    """One entry of [columns]: column, unit, zero and scale of a channel.

    Attributes:
        column: header, or number from 1; in a MAT file, name of a variable, or number of a matrix column.
        unit: unit of the channel, if it is not in the header, as in "Load [lbf]".
        zero: the reading at which the channel is zero, in the file's numbers.
        scale: channel units per unit of the file, as 22.2 if 1 V is 22.2 N.
    """

    column: Annotated[int, Field(ge=1)] | str
    unit: str = ""
    zero: Annotated[float, Field(allow_inf_nan=False)] = 0.0
    scale: Annotated[float, Field(allow_inf_nan=False), AfterValidator(_check_scale)] = 1.0

    def find_unit(self, header: str) -> str:
        """Return the unit of a column with this header; "" if there is none."""
        return self.unit or split_title(header)[1] or ""

    def to_si(self, name: str, header: str, file: str) -> float:
        """Return the SI value of one unit of the file, for a channel whose column has this header."""
        in_header = not self.unit and bool(split_title(header)[1])
        where = f"column `{header}` of {file}" if in_header else f"[columns] {name}"
        unit = self.find_unit(header)
        kind = _KINDS[name]
        if not unit and kind != "count":
            rule = f"`{name}` needs a unit"
            column = self.column if isinstance(self.column, int) else f'"{self.column}"'
            example = f'{{column = {column}, unit = "{_EXAMPLE_UNITS[kind]}"}}'
            raise BadInput.from_rule(rule, "none", where, f"Write, for example, {name} = {example}.")
        if kind != "contraction":
            return self.scale * convert_unit(name, kind, unit, where, in_header)
        if unit not in _CONTRACTION_UNITS:
            remedy = "Use `%` or `1`; for a distance, use `shortening` or `length`."
            raise BadInput.from_rule("a contraction is a ratio", f"{unit!r}", where, remedy)
        return self.scale * _CONTRACTION_UNITS[unit]


def _wrap_column(raw: object) -> object:
    if isinstance(raw, list):
        remedy = (
            "Write one header without brackets. If dates and clock times have a column each, state that of"
            " the clock: the dates are joined to it."
        )
        raise BadInput.from_rule("a channel must have one column", f"{raw!r}", "[columns]", remedy)
    return {"column": raw} if isinstance(raw, str | int) else raw


class TareTable(_ImportTable):
    """[tare]: the part of each test in which the true values of channels are stated.

    Attributes:
        start, end: times from the first sample of the test, both included.
        cut: whether this part is removed from the recording; if `start` equals `end`, nothing is removed.
        force, pressure, length: true value of the channel; other channels are unchanged.
    """

    start: str = "0 s"
    end: str
    cut: bool = True
    force: str = ""
    pressure: str = ""
    length: str = ""

    def parse_span(self) -> tuple[float, float]:
        """Return start and end, s."""
        return parse_quantity(self.start, "time", "[tare] start"), parse_quantity(
            self.end, "time", "[tare] end"
        )

    def parse_true_values(self) -> dict[str, float]:
        """Return the true value of each stated channel, SI."""
        texts = {name: getattr(self, name) for name in ("force", "pressure", "length")}
        return {n: parse_quantity(text, COLUMN_KINDS[n], f"[tare] {n}") for n, text in texts.items() if text}


class TestTable(_ImportTable):
    """[[tests]]: one test, or several at one set value.

    Attributes:
        file: a path relative to the TOML, a pattern as "run_*.csv" (natural order), or a list of them. If
            channels are in separate files, one of these for each channel.
        length, pressure: the set value, if there is no such column.
    """

    __test__ = False  # pytest must not collect this class
    file: str | list[str] | dict[str, str]
    length: str = ""
    pressure: str = ""


class ImportSpec(_ImportTable):
    """The whole TOML file.

    Attributes:
        muscle: path of the muscle.toml for the case.
        gap: time between the last sample of a test and the first one of the next.
        median: duration of the blocks that are replaced by their medians; empty for all samples.
        files: format of the files.
        columns: column of each channel.
        tare: part of each test with stated true values, or None.
        tests: the tests in order.
    """

    muscle: str
    gap: str = "1 s"
    median: str = ""
    files: FilesTable = Field(default_factory=FilesTable)
    columns: dict[str, Annotated[ChannelEntry, BeforeValidator(_wrap_column)]]
    tare: TareTable | None = None
    tests: Annotated[list[TestTable], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_columns(self) -> ImportSpec:
        for name in self.columns:
            if name not in _KINDS:
                raise BadInput.from_rule(
                    f"unknown channel `{name}`", "", "[columns]", suggest_word(name, _KINDS)
                )
        lengths = [name for name in ("length", *LENGTH_SOURCES) if name in self.columns]
        if len(lengths) > 1:
            got = " and ".join(f"`{name}`" for name in lengths)
            raise BadInput.from_rule("the length must have one column", got, "[columns]", "Remove one.")
        for k, test in enumerate(self.tests, 1):
            _check_test(self, test, k)
        return self


def _check_test(spec: ImportSpec, test: TestTable, k: int) -> None:
    where = f"test {k} of [[tests]]"
    for name in ("pressure", "length"):
        columns = {name, *LENGTH_SOURCES} if name == "length" else {name}
        sources = bool(getattr(test, name)), bool(columns & set(spec.columns))
        if all(sources):
            raise BadInput.from_rule(
                f"`{name}` must be a column or stated for the test", "both", where, "Remove one."
            )
        if not any(sources):
            remedy = f'Add it to [columns], or state it for the test: {name} = "...".'
            raise BadInput.from_rule(
                f"`{name}` must be a column or stated for the test", "neither", where, remedy
            )
    if not test.file:
        raise BadInput.from_rule(
            "`file` must name at least one file", repr(test.file), where, "Write a path."
        )
    if isinstance(test.file, dict):
        channels = set(spec.columns) - {"time"}
        if set(test.file) != channels:
            got = ", ".join(f"`{name}`" for name in test.file) or "none"
            rule = "`file` must state a file for each channel: " + ", ".join(
                f"`{n}`" for n in sorted(channels)
            )
            raise BadInput.from_rule(rule, got, where, "Add or remove channels of `file`.")


def read_import_spec(path: str | Path) -> ImportSpec:
    """Return the import specification of a file.

    Raises:
        BadInput: if the file is missing or not TOML, or if an entry is unknown or invalid.
    """
    path = Path(path)
    # Often the file is the recording itself.
    tests = f'[{{file = "{path.name}"}}]'
    remedy = (
        "Name the recording in a TOML file with the lines"
        f' muscle = "muscle.toml", columns = {{force = "Load [N]", …}} and tests = {tests}.'
    )
    content = read_bytes(path)
    try:
        raw = parse_toml(content, path.name, remedy)
    except BadInput as error:
        if path.suffix.lower() == ".toml":
            raise
        rule = "`pamjax import` needs a TOML file that describes the recording"
        raise BadInput.from_rule(rule, path.name, remedy=remedy) from error
    try:
        return ImportSpec.model_validate(raw)
    except ValidationError as error:
        raise _translate_error(error, path.name) from error


def _translate_error(error: ValidationError, file: str) -> BadInput:
    """Return the first error of pydantic as a message of this package."""
    first = error.errors()[0]
    own_error = first.get("ctx", {}).get("error")
    if isinstance(own_error, BadInput):
        return BadInput(f"{file}: {own_error}")
    # The location also has list indices and the names of pydantic's readers.
    path = [p for p in first["loc"] if isinstance(p, str) and not _READER_NAME_PATTERN.fullmatch(p)]
    key = path[-1]
    table = {"tests": "[[tests]]"}.get(path[0], f"[{path[0]}]")
    where = f"{table} of {file}" if len(path) > 1 else file
    if first["type"] == "missing":
        remedy = "Write " + {
            "muscle": "the path of the muscle.toml for the case.",
            "columns": "the column of each channel.",
            "tests": "the files of the tests.",
            "end": "the end of the tare interval.",
            "column": "the header or the number of the column.",
            "file": "the file of the test.",
        }.get(key, "its value: it has no default.")
        return BadInput.from_rule(f"`{key}` must be stated", "", where, remedy)
    if first["type"] == "extra_forbidden":
        table_class = {
            "files": FilesTable,
            "tare": TareTable,
            "tests": TestTable,
            "columns": ChannelEntry,
        }.get(path[0], ImportSpec)
        valid_names = (ImportSpec if len(path) == 1 else table_class).model_fields
        return BadInput.from_rule(f"unknown entry `{key}`", "", where, suggest_word(key, valid_names))
    return BadInput.from_rule(toml_errors.format_rule(first, key), toml_errors.format_input(first), where)
