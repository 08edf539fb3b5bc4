"""Schema of FLEET.toml: its entries, and the error messages for wrong ones."""

from __future__ import annotations

import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from pamjax.errors import BadInput, suggest_word
from pamjax.records.reading.specimen import Specimen, read_date, read_label
from pamjax.records.reading.toml_errors import format_input, format_rule
from pamjax.records.toml_text import parse_toml

Stage = Literal["check", "fit", "diagnose", "validate", "sample"]
#: Stages in the order in which a case runs through them. Each starts after those before it are done, and
#: `sample` is last: it takes the longest, and no other stage uses it.
STAGES: tuple[Stage, ...] = ("check", "fit", "diagnose", "validate", "sample")
#: Stages of a fleet that states none.
DEFAULT_STAGES: tuple[Stage, ...] = ("check", "fit", "diagnose")

Label = Annotated[str, BeforeValidator(read_label)]
Date = Annotated[datetime.date, BeforeValidator(read_date)]


def _list_patterns(raw: Any) -> Any:
    return [raw] if isinstance(raw, str) else raw


Patterns = Annotated[list[str], BeforeValidator(_list_patterns)]


class _FleetTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class GroupTable(_FleetTable):
    """[[groups]]: what several cases have in common.

    Attributes:
        cases: patterns of case folders, relative to the folder of the fleet.
        bench: rig that recorded them.
        serial: serial number of the specimen.
        type: type of the muscle; cases of one type are compared with each other.
        date: day of the recording.
    """

    cases: Patterns
    bench: Label | None = None
    serial: Label | None = None
    type: Label | None = None
    date: Date | None = None

    @property
    def specimen(self) -> Specimen:
        return Specimen(bench=self.bench, serial=self.serial, type=self.type, date=self.date)


class FitTable(_FleetTable):
    """[fit]: options of `pamjax fit` for every case."""

    law: str | None = None
    mechanisms: list[str] = Field(default_factory=list)
    loss: Literal["square", "soft"] = "square"
    starts: Annotated[int, Field(ge=1)] = 4
    folds: Annotated[int, Field(ge=2)] = 5


class SampleTable(_FleetTable):
    """[sample]: options of `pamjax sample` for every case; law and mechanisms are those of [fit]."""

    sampler: Literal["emcee", "nuts"] = "emcee"
    ess: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 1000.0
    rhat: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 1.01
    max_draws: Annotated[int, Field(ge=100)] = 20_000


class ValidateTable(_FleetTable):
    """[validate]: the model that is tested on every case.

    Attributes:
        model: path of a model.json or fit.json, relative to FLEET.toml.
        case: name of the case, if the file has several.
    """

    model: str
    case: str | None = None


class FleetDocument(_FleetTable):
    """The whole file.

    Attributes:
        name: name of the fleet.
        folder: folder of the cases, relative to the file.
        cases: patterns of case folders, relative to `folder`; "**" means every folder below.
        stages: commands to run for each case.
        seed: random seed of fit, sample and diagnose.
        figures, report: write the figures and report.html of each case.
        groups, fit, sample: tables of the file.
        validate_: the table [validate]; pydantic reserves the name without underscore.
    """

    name: str = ""
    folder: str = "."
    cases: Patterns = ["**"]
    stages: Annotated[list[Stage], Field(min_length=1)] = list(DEFAULT_STAGES)
    seed: Annotated[int, Field(ge=0)] = 0
    figures: bool = True
    report: bool = True
    groups: list[GroupTable] = Field(default_factory=list)
    fit: FitTable = Field(default_factory=FitTable)
    sample: SampleTable = Field(default_factory=SampleTable)
    validate_: ValidateTable | None = Field(default=None, alias="validate")


_TABLES: dict[str, type[_FleetTable]] = {
    "groups": GroupTable,
    "fit": FitTable,
    "sample": SampleTable,
    "validate": ValidateTable,
}


def read_fleet_document(raw: bytes, file: str) -> FleetDocument:
    """Return the validated entries of a FLEET.toml.

    Raises:
        BadInput: if it is no TOML, or an entry is unknown or wrong; the message reports the first error.
    """
    tables = parse_toml(raw, file)
    try:
        return FleetDocument.model_validate(tables)
    except ValidationError as error:
        raise _translate_error(error, file) from error


def _translate_error(error: ValidationError, file: str) -> BadInput:
    """Return the first error of pydantic as a message of this package."""
    # A misspelt entry may also be reported as missing; the misspelling comes first.
    first = sorted(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")[0]
    path = [part for part in first["loc"] if isinstance(part, str)]
    where = f"[{path[0]}] of {file}" if len(path) > 1 else file
    name = path[-1] if path else file
    own_error = first.get("ctx", {}).get("error")
    if isinstance(own_error, BadInput):
        return BadInput.from_rule(f"`{name}` {own_error}".rstrip("."), format_input(first), where)
    if first["type"] == "extra_forbidden":
        table = _TABLES[path[0]] if len(path) > 1 else FleetDocument
        known = [entry.alias or field for field, entry in table.model_fields.items()]
        return BadInput.from_rule(f"unknown entry `{name}`", where=where, remedy=suggest_word(name, known))
    return BadInput.from_rule(format_rule(first, name), format_input(first), where)
