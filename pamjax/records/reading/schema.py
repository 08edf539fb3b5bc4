"""Schema of muscle.toml: its tables and entries, and the error messages for wrong ones."""

from __future__ import annotations

import datetime
import difflib
import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo

from pamjax.errors import BadInput, suggest_word
from pamjax.records.reading.header import COLUMN_KINDS
from pamjax.records.reading.quantity import (
    EntryLocation,
    MeasuredValue,
    SensorNoise,
    read_count,
    read_load,
    read_quantity,
    read_sensor_noise,
)
from pamjax.records.reading.specimen import read_date, read_label
from pamjax.records.toml_text import parse_toml


def _locate_entry(info: ValidationInfo) -> EntryLocation:
    table = (info.config or {}).get("title")
    return EntryLocation(f"[{table}] {info.field_name}", (info.context or {}).get("file", "muscle.toml"))


def _build_validator(read: Callable[[Any, EntryLocation], Any]) -> BeforeValidator:
    """Return a reader as a pydantic validator; its error messages are kept."""
    return BeforeValidator(lambda raw, info: read(raw, _locate_entry(info)))


def _build_quantity_validator(kind: str) -> BeforeValidator:
    return _build_validator(lambda raw, location: read_quantity(raw, kind, location))


def _build_noise_validator(kind: str, allow_per_setting: bool = False) -> BeforeValidator:
    return _build_validator(lambda raw, location: read_sensor_noise(raw, kind, location, allow_per_setting))


def _read_angle(raw: Any, location: EntryLocation) -> MeasuredValue:
    angle = read_quantity(raw, "angle", location)
    if not angle.value < math.pi / 2:
        got = f"{math.degrees(angle.value):.4g} deg"
        remedy = "Measure it from the circumference."
        raise BadInput.from_rule(
            f"`{location.name}` must be between 0 and 90 deg", got, location.file, remedy
        )
    return angle


def _read_specimen_entry(read: Callable[[Any], Any]) -> Callable[[Any, EntryLocation], Any]:
    """Return a reader whose error message states entry and file."""

    def read_at(raw: Any, location: EntryLocation) -> Any:
        try:
            return read(raw)
        except BadInput as error:
            raise BadInput.from_rule(f"`{location.name}` {error}", f"{raw!r}", location.file) from error

    return read_at


Label = Annotated[str, _build_validator(_read_specimen_entry(read_label))]
Date = Annotated[datetime.date, _build_validator(_read_specimen_entry(read_date))]
Length = Annotated[MeasuredValue, _build_quantity_validator("length")]
Area = Annotated[MeasuredValue, _build_quantity_validator("area")]
Pressure = Annotated[MeasuredValue, _build_quantity_validator("pressure")]
Force = Annotated[MeasuredValue, _build_quantity_validator("force")]
Load = Annotated[float, _build_validator(read_load)]
Angle = Annotated[MeasuredValue, _build_validator(_read_angle)]
Number = Annotated[MeasuredValue, _build_quantity_validator("count")]
Count = Annotated[int, _build_validator(read_count)]


class _TomlTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class MuscleTable(_TomlTable):
    """[muscle]: the muscle at rest, with its braid in one of two forms."""

    model_config = ConfigDict(title="muscle")
    name: str = ""
    rest_length: Length | None = None
    threads: Count | None = None
    thread_area: Area | None = None
    thread_length: Length | None = None
    turns: Number | None = None
    braid_angle: Angle | None = None
    diameter: Length | None = None
    fitting_diameter: Length | None = None
    length: Length | None = None


class ThreadTable(_TomlTable):
    """[thread]: modulus of one thread or stiffness of all threads."""

    model_config = ConfigDict(title="thread")
    modulus: Pressure | None = None
    stiffness: Force | None = None


class BladderTable(_TomlTable):
    """[bladder]: the rubber tube, for the mechanism `bladder_elasticity`."""

    model_config = ConfigDict(title="bladder")
    inner_diameter: Length | None = None
    thickness: Length | None = None
    modulus: Pressure | None = None


class SensorsTable(_TomlTable):
    """[sensors]: noise of one sample."""

    model_config = ConfigDict(title="sensors")
    force: Annotated[SensorNoise, _build_noise_validator("force")] | None = None
    diameter: Annotated[SensorNoise, _build_noise_validator("length")] | None = None
    pressure: Annotated[SensorNoise, _build_noise_validator("pressure")] | None = None
    length: Annotated[SensorNoise, _build_noise_validator("length", allow_per_setting=True)] | None = None


class MeasurementTable(_TomlTable):
    """[test]: the measured channel, and the set force of an isotonic test."""

    model_config = ConfigDict(title="test")
    measured: Literal["force", "length"] = "force"
    load: Load | None = None


class BaselineTable(_TomlTable):
    """[baseline]: the baseline model."""

    model_config = ConfigDict(title="baseline")
    model: Literal["inelastic", "elastic"] | None = None


class SpecimenTable(_TomlTable):
    """[specimen]: origin of the recording, for the statistics of a fleet."""

    model_config = ConfigDict(title="specimen")
    bench: Label | None = None
    serial: Label | None = None
    type: Label | None = None
    date: Date | None = None


class MuscleDocument(_TomlTable):
    """The whole file."""

    muscle: MuscleTable
    thread: ThreadTable = Field(default_factory=ThreadTable)
    bladder: BladderTable | None = None
    sensors: SensorsTable = Field(default_factory=SensorsTable)
    test: MeasurementTable = Field(default_factory=MeasurementTable)
    baseline: BaselineTable = Field(default_factory=BaselineTable)
    columns: dict[str, str] = Field(default_factory=dict)
    specimen: SpecimenTable = Field(default_factory=SpecimenTable)

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any], file: str) -> MuscleDocument:
        """Return the document of a mapping.

        Raises:
            BadInput: for the first wrong entry.
        """
        try:
            document = cls.model_validate(dict(raw), context={"file": file})
        except ValidationError as error:
            raise _translate_error(error, file) from error
        for name in document.columns:
            if name not in COLUMN_KINDS:
                raise BadInput.from_rule(
                    f"unknown channel `{name}`",
                    where=f"[columns] of {file}",
                    remedy=suggest_word(name, COLUMN_KINDS),
                )
        return document


def read_document(raw: bytes, file: str) -> MuscleDocument:
    """Return the document from a file's bytes.

    Raises:
        BadInput: if it is not TOML, or if an entry is unknown or wrong.
    """
    return MuscleDocument.from_mapping(parse_toml(raw, file), file)


def _translate_error(error: ValidationError, file: str) -> BadInput:
    """Return the first error of pydantic as a message of this package."""
    first = error.errors()[0]
    own_error = first.get("ctx", {}).get("error")
    if isinstance(own_error, BadInput):
        return own_error
    path = [str(part) for part in first["loc"]]
    where = f"[{path[0]}] of {file}" if len(path) > 1 else file
    if first["type"] == "extra_forbidden":
        return _build_unknown_error(path, where)
    if first["type"] == "missing":
        return BadInput.from_rule(f"{file} must have a table [{path[0]}]", remedy="It describes the muscle.")
    if first["type"] == "literal_error":
        raw, choices = str(first["input"]), _CHOICES[path[-1]]
        return BadInput.from_rule(
            f"`{path[-1]}` must be " + " or ".join(f'"{choice}"' for choice in choices),
            f"{raw!r}",
            where,
            suggest_word(raw, choices),
        )
    if path[0] == "columns" and len(path) > 1:
        remedy = f'Write {path[-1]} = "HEADER", and the unit in the header of the recording, as "Load [N]".'
        got = "a table" if isinstance(first["input"], dict) else f"{first['input']!r}"
        return BadInput.from_rule(f"`{path[-1]}` must be a header in quotes", got, where, remedy)
    kind, remedy = (
        ("a table", f"Write [{path[0]}] above its entries.")
        if len(path) == 1
        else ("a text in quotes", "Add the quotes.")
    )
    return BadInput.from_rule(f"`{path[-1]}` must be {kind}", f"{first['input']!r}", where, remedy)


def _build_unknown_error(path: list[str], where: str) -> BadInput:
    if len(path) == 1:
        return BadInput.from_rule(
            f"unknown table [{path[0]}] in {where}", remedy=suggest_word(path[0], MuscleDocument.model_fields)
        )
    valid_names = _TABLE_CLASSES[path[0]].model_fields
    if close := difflib.get_close_matches(path[1], MuscleDocument.model_fields, n=1, cutoff=0.8):
        remedy = f"Did you mean the table [{close[0]}]? Write it on a line of its own."
        return BadInput.from_rule(f"unknown entry `{path[1]}`", where=where, remedy=remedy)
    return BadInput.from_rule(
        f"unknown entry `{path[1]}`", where=where, remedy=suggest_word(path[1], valid_names)
    )


_CHOICES = {"model": ("inelastic", "elastic"), "measured": ("force", "length")}

_TABLE_CLASSES: dict[str, type[_TomlTable]] = {
    "muscle": MuscleTable,
    "thread": ThreadTable,
    "bladder": BladderTable,
    "sensors": SensorsTable,
    "test": MeasurementTable,
    "baseline": BaselineTable,
    "specimen": SpecimenTable,
}
