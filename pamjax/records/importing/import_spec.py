"""What a rig's files look like, as its owner says it in a TOML: columns, tests, zero, thinning."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from pamjax.errors import BadInput, refuse, suggest_word
from pamjax.records.files import decode_text, read_bytes
from pamjax.records.reading import toml_errors as wrong
from pamjax.records.reading.header import COLUMN_KINDS, split_title
from pamjax.units import parse_quantity, parse_unit

#: Ways to read an entry, which stand among the names of entries where something is wrong.
READER_NAME_PATTERN = re.compile(r"function-.*|str|int|constrained-int|list\[.*|dict\[.*")


class _ImportTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FilesTable(_ImportTable):
    """[files]: how one file is written.

    Attributes:
        separator: what stands between cells.
        decimal: what stands before the decimals.
        header: whether a line of names stands above the numbers.
        skip: lines above that line, or above the first row where there is none.
        matrix: the variable of a MAT file whose columns are meant, where it is one matrix.
        rate: samples in a time, as "500 Hz", where no column tells the time.
    """

    separator: Literal[",", ";", "tab", "space"] = ","
    decimal: Literal[".", ","] = "."
    header: bool = True
    skip: Annotated[int, Field(ge=0)] = 0
    matrix: str = ""
    rate: str = ""


class ChannelEntry(_ImportTable):
    """One entry of [columns]: where a channel stands, and what one of its units is worth.

    Attributes:
        column: its header, or its number from 1; of a MAT file a variable, or the number of a column.
        unit: of the channel; may stand in the header instead, as in "Load [lbf]".
        zero: the reading at which the channel is zero, in units of the file.
        scale: units for one unit of the file, as 22.2 where a volt is 22.2 N.
    """

    column: Annotated[int, Field(ge=1)] | str
    unit: str = ""
    zero: float = 0.0
    scale: float = 1.0

    def to_si(self, name: str, where: str) -> float:
        """SI units for one unit of the file."""
        unit = self.unit or (split_title(self.column)[1] if isinstance(self.column, str) else None) or ""
        return self.scale * parse_unit(unit, COLUMN_KINDS[name], where)


def _wrap_column(raw: object) -> object:
    return {"column": raw} if isinstance(raw, str | int) else raw


class TareTable(_ImportTable):
    """[tare]: the part of each test in which the channels read what they are known to read.

    Attributes:
        start, end: from the first sample of the test; both belong to it.
        cut: whether that part is left out of the recording; nothing is where it ends as it starts.
        force, pressure, length: the true reading there; a channel that is not named keeps its zero.
    """

    start: str = "0 s"
    end: str
    cut: bool = True
    force: str = ""
    pressure: str = ""
    length: str = ""

    def parse_span(self) -> tuple[float, float]:
        """Start and end, s."""
        return parse_quantity(self.start, "time", "[tare] start"), parse_quantity(
            self.end, "time", "[tare] end"
        )

    def parse_true_values(self) -> dict[str, float]:
        """What each named channel truly was, SI."""
        texts = {name: getattr(self, name) for name in ("force", "pressure", "length")}
        return {n: parse_quantity(text, COLUMN_KINDS[n], f"[tare] {n}") for n, text in texts.items() if text}


class TestTable(_ImportTable):
    """[[tests]]: one test, or several of one setting.

    Attributes:
        file: a path beside the TOML, or a pattern as "run_*.csv", taken in natural order, or a list of such;
            or one for each channel where a channel has a file of its own.
        length, pressure: what was set, where no column tells it.
    """

    __test__ = False  # no test of ours
    file: str | list[str] | dict[str, str]
    length: str = ""
    pressure: str = ""


class ImportSpec(_ImportTable):
    """The whole TOML.

    Attributes:
        muscle: path of the muscle.toml that goes into the case.
        gap: time between the last sample of a test and the zero of the next one's clock.
        median: the recording keeps the median of each block of this time; every sample where left out.
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
            if name not in COLUMN_KINDS:
                raise refuse(
                    f"`{name}` is no column of a recording", "", "[columns]", suggest_word(name, COLUMN_KINDS)
                )
        for k, test in enumerate(self.tests, 1):
            _check_test(self, test, k)
        return self


def _check_test(spec: ImportSpec, test: TestTable, k: int) -> None:
    where = f"test {k} of [[tests]]"
    for name in ("pressure", "length"):
        sources = bool(getattr(test, name)), name in spec.columns
        if all(sources):
            raise refuse(f"`{name}` must be a column or stated for the test", "both", where, "Keep one.")
        if not any(sources):
            remedy = f'Add it to [columns], or state it for the test: {name} = "...".'
            raise refuse(f"`{name}` must be a column or stated for the test", "neither", where, remedy)
    if isinstance(test.file, dict):
        wanted = set(spec.columns) - {"time"}
        if set(test.file) != wanted:
            got = ", ".join(f"`{name}`" for name in test.file) or "none"
            rule = "`file` must name a file for each channel: " + ", ".join(f"`{n}`" for n in sorted(wanted))
            raise refuse(rule, got, where)


def read_import_spec(path: str | Path) -> ImportSpec:
    """Read the TOML that says what a rig's files look like.

    Raises:
        BadInput: in one sentence, if it is missing, no TOML, or says what it cannot say.
    """
    path = Path(path)
    try:
        raw = tomllib.loads(decode_text(read_bytes(path), path.name))
    except tomllib.TOMLDecodeError as error:
        raise refuse(f"{path.name} must be TOML", f"{error}", remedy="See `pamjax import --help`.") from error
    try:
        return ImportSpec.model_validate(raw)
    except ValidationError as error:
        raise _translate_error(error, path.name) from error


def _translate_error(error: ValidationError, file: str) -> BadInput:
    """The first complaint of pydantic in our wording."""
    first = error.errors()[0]
    own = first.get("ctx", {}).get("error")
    if isinstance(own, BadInput):
        return BadInput(f"{file}: {own}")
    # Beside names, a place has numbers of lists and ways in which the library tried to read it.
    path = [p for p in first["loc"] if isinstance(p, str) and not READER_NAME_PATTERN.fullmatch(p)]
    key = path[-1]
    table = {"tests": "[[tests]]"}.get(path[0], f"[{path[0]}]")
    where = f"{table} of {file}" if len(path) > 1 else file
    if first["type"] == "missing":
        remedy = "It says " + {
            "muscle": "which muscle.toml goes into the case.",
            "columns": "which column is which.",
            "tests": "which files there are.",
            "end": "how long the tare takes.",
            "column": "which column of the file it is.",
            "file": "where the test was written to.",
        }.get(key, "what cannot be guessed.")
        return refuse(f"`{key}` must be stated", "", where, remedy)
    if first["type"] == "extra_forbidden":
        table_class = {
            "files": FilesTable,
            "tare": TareTable,
            "tests": TestTable,
            "columns": ChannelEntry,
        }.get(path[0], ImportSpec)
        known = (ImportSpec if len(path) == 1 else table_class).model_fields
        return refuse(f"`{key}` is no entry", "", where, suggest_word(key, known))
    return refuse(wrong.format_rule(first, key), wrong.format_input(first), where)
