"""Schema of a sizing spec: its tables and entries, their units, and the error messages of invalid ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo

from pamjax.errors import BadInput, suggest_word
from pamjax.records.reading.quantity import EntryLocation, read_count, read_quantity
from pamjax.records.toml_text import parse_toml
from pamjax.units import parse_number

Objective = Literal["diameter", "mass", "air", "pressure", "cost", "length"]
OBJECTIVES: tuple[str, ...] = get_args(Objective)
#: Other words for an objective, for messages.
_OBJECTIVE_SYNONYMS = {"weight": "mass", "price": "cost", "volume": "air", "width": "diameter"}

#: Required probability that all requirements hold together, if the spec states none.
_DEFAULT_PROBABILITY = 0.9

#: Title of the entries outside all tables.
_SPEC_TITLE = "the spec"


def _build_validator(read: Callable[[Any, EntryLocation], Any]) -> BeforeValidator:
    def read_at(raw: Any, info: ValidationInfo) -> Any:
        table = (info.config or {}).get("title")
        name = str(info.field_name) if table == _SPEC_TITLE else f"[{table}] {info.field_name}"
        return read(raw, EntryLocation(name, (info.context or {}).get("file", "the spec")))

    return BeforeValidator(read_at)


def _validate_quantity(kind: str) -> BeforeValidator:
    return _build_validator(lambda raw, location: read_quantity(raw, kind, location).value)


def _validate_unit(unit: str) -> BeforeValidator:
    """Return a validator of a positive quantity in a unit; a number without unit is in SI."""

    def read(raw: Any, location: EntryLocation) -> float:
        if isinstance(raw, bool) or not isinstance(raw, (int, float, str)):
            raise BadInput.from_rule(
                "a quantity must be a number with a unit", f"{raw!r}", str(location), f"Use the unit {unit}."
            )
        value = parse_number(raw, unit, str(location)) if isinstance(raw, str) else float(raw)
        if not value > 0:
            raise BadInput.from_rule(
                f"`{location.name}` must be positive", f"{raw}", location.file, "Check its sign."
            )
        return value

    return _build_validator(read)


def _read_share(raw: Any, location: EntryLocation) -> float:
    """Return a fraction that is written as 0.25 or "25 %"."""
    text = str(raw).strip()
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError as error:
        raise BadInput.from_rule(
            "a fraction must be a number", f"{raw!r}", str(location), "Write 0.25 or '25 %'."
        ) from error
    if isinstance(raw, bool) or not 0 <= value < 1:
        raise BadInput.from_rule(
            f"`{location.name}` must be at least 0 and below 1",
            f"{raw}",
            location.file,
            "Write 0.25 or '25 %'.",
        )
    return value


def _read_factor(raw: Any, location: EntryLocation) -> float:
    """Return a safety factor."""
    value = read_quantity(raw, "count", location).value
    if value < 1:
        rule = f"the safety factor `{location.name}` must be at least 1"
        raise BadInput.from_rule(rule, f"{raw}", location.file, "Write 1 for no safety margin.")
    return value


def _validate_range(kind: str) -> BeforeValidator:
    """Return a validator of a lowest and a highest value; a single quantity fixes both."""

    def read(raw: Any, location: EntryLocation) -> tuple[float, float]:
        ends = raw if isinstance(raw, list) else [raw, raw]
        if len(ends) != 2:
            remedy = "Write one quantity, or [lowest, highest]."
            raise BadInput.from_rule(
                f"`{location.name}` must be a quantity or a pair of quantities",
                f"{raw}",
                location.file,
                remedy,
            )
        low, high = (read_quantity(end, kind, location).value for end in ends)
        if low > high:
            raise BadInput.from_rule(
                f"`{location.name}` must have its lowest value first",
                f"{raw}",
                location.file,
                "Swap the values.",
            )
        return low, high

    return _build_validator(read)


def _validate_list(read: Callable[[Any, EntryLocation], Any]) -> BeforeValidator:
    def read_items(raw: Any, location: EntryLocation) -> tuple[Any, ...]:
        items = raw if isinstance(raw, list) else [raw]
        if not items:
            raise BadInput.from_rule(
                f"`{location.name}` must have at least one entry",
                "none",
                location.file,
                "Remove it to permit all.",
            )
        return tuple(read(item, location) for item in items)

    return _build_validator(read_items)


Length = Annotated[float, _validate_quantity("length")]
Pressure = Annotated[float, _validate_quantity("pressure")]
Force = Annotated[float, _validate_quantity("force")]
Volume = Annotated[float, _validate_quantity("volume")]
Number = Annotated[float, _validate_quantity("count")]
Factor = Annotated[float, _build_validator(_read_factor)]
Stiffness = Annotated[float, _validate_unit("N/m")]
Density = Annotated[float, _validate_unit("kg/m^3")]
Share = Annotated[float, _build_validator(_read_share)]
Counts = Annotated[tuple[int, ...], _validate_list(read_count)]
Lengths = Annotated[
    tuple[float, ...], _validate_list(lambda raw, location: read_quantity(raw, "length", location).value)
]
Names = Annotated[tuple[str, ...], _validate_list(lambda raw, location: str(raw))]


class _SpecTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ForceDemand(_SpecTable):
    """[[force]]: required force of all muscles together at one operating point."""

    model_config = ConfigDict(title="force")
    at_least: Force
    contraction: Share | None = None
    shortening: Length | None = None
    pressure: Pressure | None = None


class Stroke(_SpecTable):
    """[stroke]: displacement of a load from the rest length, and its increase with displacement."""

    model_config = ConfigDict(title="stroke")
    length: Length
    load: Force | None = None
    stiffness: Stiffness | None = None


class Supply(_SpecTable):
    """[supply]: the highest available pressure."""

    model_config = ConfigDict(title="supply")
    pressure: Pressure


class SizeLimits(_SpecTable):
    """[envelope]: the available space."""

    model_config = ConfigDict(title="envelope")
    length: Length | None = None
    fittings: Length | None = None
    diameter: Length | None = None
    bundle: Length | None = None


class Safety(_SpecTable):
    """[safety]: safety factors of threads, bladder and rubber."""

    model_config = ConfigDict(title="safety")
    thread: Factor = 3.0
    mesh: Factor = 1.5
    rubber: Factor = 2.0


class Threads(_SpecTable):
    """[threads]: the permitted threads."""

    model_config = ConfigDict(title="threads")
    kinds: Names | None = None
    counts: Counts | None = None
    diameters: Lengths | None = None


class Bladders(_SpecTable):
    """[bladders]: the permitted bladders."""

    model_config = ConfigDict(title="bladders")
    kinds: Names | None = None
    diameters: Lengths | None = None


class OwnThread(_SpecTable):
    """[[thread]]: a kind of thread of the user, or a price for a supplied one."""

    model_config = ConfigDict(title="thread")
    name: str
    modulus: Pressure | None = None
    strength: Pressure | None = None
    density: Density | None = None
    fill: Share | None = None
    diameters: Lengths | None = None
    price: Number | None = None


class OwnBladder(_SpecTable):
    """[[bladder]]: a rubber of the user, or a price for a supplied one."""

    model_config = ConfigDict(title="bladder")
    name: str
    modulus: Pressure | None = None
    density: Density | None = None
    elongation: Number | None = None
    price: Number | None = None


class CoordinateLimits(_SpecTable):
    """[limits]: ranges of the dimensions of the muscle."""

    model_config = ConfigDict(title="limits")
    rest_length: Annotated[tuple[float, float], _validate_range("length")] | None = None
    thread_length: Annotated[tuple[float, float], _validate_range("length")] | None = None
    turns: Annotated[tuple[float, float], _validate_range("count")] | None = None
    braid_angle: Annotated[tuple[float, float], _validate_range("angle")] | None = None
    diameter: Annotated[tuple[float, float], _validate_range("length")] | None = None
    wall: Annotated[tuple[float, float], _validate_range("length")] | None = None
    slenderness: Number = 3.0


class Tolerance(_SpecTable):
    """[tolerance]: errors of manufacture, set length and pressure, one standard deviation each."""

    model_config = ConfigDict(title="tolerance")
    rest_length: Length | None = None
    thread_length: Length | None = None
    turns: Number | None = None
    wall: Length | None = None
    position: Length | None = None
    pressure: Share | None = None


class Calibration(_SpecTable):
    """[calibration]: a measured muscle, and the materials of the catalogue that it represents."""

    model_config = ConfigDict(title="calibration")
    muscle: str | None = None
    posterior: str | None = None
    thread: str | None = None
    bladder: str | None = None
    discrepancy: Share | None = None


class SpecEntries(_SpecTable):
    """All entries of a spec."""

    model_config = ConfigDict(title=_SPEC_TITLE)
    name: str = ""
    minimise: Objective = "diameter"
    against: Objective | None = None
    probability: Share = _DEFAULT_PROBABILITY
    free_contraction: Share | None = None
    air: Volume | None = None
    parallel: Counts = (1,)
    supply: Supply
    force: tuple[ForceDemand, ...] = ()
    stroke: Stroke | None = None
    envelope: SizeLimits = Field(default_factory=SizeLimits)
    safety: Safety = Field(default_factory=Safety)
    threads: Threads = Field(default_factory=Threads)
    bladders: Bladders = Field(default_factory=Bladders)
    thread: tuple[OwnThread, ...] = ()
    bladder: tuple[OwnBladder, ...] = ()
    limits: CoordinateLimits = Field(default_factory=CoordinateLimits)
    tolerance: Tolerance = Field(default_factory=Tolerance)
    calibration: Calibration | None = None


def read_entries(raw: Mapping[str, Any] | bytes, file: str) -> SpecEntries:
    """Return the validated entries of a spec.

    Raises:
        BadInput: if it is no valid TOML, or an entry is invalid; the message reports the first error.
    """
    if isinstance(raw, bytes):
        raw = parse_toml(raw, file)
    try:
        return SpecEntries.model_validate(dict(raw), context={"file": file})
    except ValidationError as error:
        raise _translate_error(error, file) from error


def _translate_error(error: ValidationError, file: str) -> BadInput:
    """Return the first error of pydantic as an error of pamjax."""
    # A misspelt entry is also reported as missing; the misspelling comes first.
    first = sorted(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")[0]
    own_error = first.get("ctx", {}).get("error")
    if isinstance(own_error, BadInput):
        return own_error
    path = [str(part) for part in first["loc"] if not isinstance(part, int)]
    where = f"[{path[0]}] of {file}" if len(path) > 1 else file
    if first["type"] == "extra_forbidden":
        known_fields = _find_table(path[0]).model_fields if len(path) > 1 else SpecEntries.model_fields
        return BadInput.from_rule(
            f"unknown entry `{path[-1]}`", where=where, remedy=suggest_word(path[-1], known_fields)
        )
    if first["type"] == "missing":
        missing = f"`{path[-1]}`" if len(path) > 1 else f"a table [{path[0]}]"
        return BadInput.from_rule(
            f"a spec must state {missing}", "none", where, f"Add it: {_EXAMPLE_ENTRIES.get(path[-1], '')}"
        )
    if first["type"] == "literal_error":
        return BadInput.from_rule(
            f"`{path[-1]}` must be one of {', '.join(OBJECTIVES)}",
            f"{first['input']!r}",
            where,
            suggest_word(_OBJECTIVE_SYNONYMS.get(str(first["input"]), str(first["input"])), OBJECTIVES),
        )
    if first["type"] == "tuple_type" and path[-1] in ("force", "thread", "bladder"):
        rule = f"each `{path[-1]}` must be a table of its own"
        return BadInput.from_rule(rule, f"[{path[-1]}]", file, f"Write [[{path[-1]}]].")
    remedy = first["msg"].replace("Input should be", "It should be") + "."
    return BadInput.from_rule(f"`{path[-1]}` has the wrong type", f"{first['input']!r}", where, remedy)


_EXAMPLE_ENTRIES = {
    "supply": '[supply] pressure = "6 bar".',
    "pressure": 'pressure = "6 bar".',
    "at_least": 'at_least = "500 N".',
    "length": 'length = "50 mm".',
}


def _find_table(name: str) -> type[BaseModel]:
    tables = {
        "force": ForceDemand,
        "thread": OwnThread,
        "bladder": OwnBladder,
        "stroke": Stroke,
        "supply": Supply,
    }
    kinds = tables | {
        "envelope": SizeLimits,
        "safety": Safety,
        "threads": Threads,
        "bladders": Bladders,
        "limits": CoordinateLimits,
        "tolerance": Tolerance,
        "calibration": Calibration,
    }
    return kinds.get(name, SpecEntries)
