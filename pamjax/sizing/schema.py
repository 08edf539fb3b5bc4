"""The words a sizing spec may use: its tables and entries, with any unit, and what a misspelt one is told."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo

from pamjax.errors import BadInput, refuse, suggest_word
from pamjax.records.files import decode_text
from pamjax.records.reading.quantity import EntryLocation, read_count, read_quantity
from pamjax.units import parse_number

Objective = Literal["diameter", "mass", "air", "pressure", "cost", "length"]
OBJECTIVES: tuple[str, ...] = get_args(Objective)

#: Title of what stands in no table.
SPEC_TITLE = "the spec"


def _build_validator(read: Callable[[Any, EntryLocation], Any]) -> BeforeValidator:
    def read_at(raw: Any, info: ValidationInfo) -> Any:
        table = (info.config or {}).get("title")
        name = str(info.field_name) if table == SPEC_TITLE else f"[{table}] {info.field_name}"
        return read(raw, EntryLocation(name, (info.context or {}).get("file", "the spec")))

    return BeforeValidator(read_at)


def _validate_quantity(kind: str) -> BeforeValidator:
    return _build_validator(lambda raw, spot: read_quantity(raw, kind, spot).value)


def _validate_unit(unit: str) -> BeforeValidator:
    """A positive number in a unit that is none of the lab's usual kinds; a bare one is in SI."""

    def read(raw: Any, spot: EntryLocation) -> float:
        if isinstance(raw, bool) or not isinstance(raw, (int, float, str)):
            raise refuse("a quantity is a number and a unit", f"{raw!r}", str(spot), f"Its unit is {unit}.")
        value = parse_number(raw, unit, str(spot)) if isinstance(raw, str) else float(raw)
        if not value > 0:
            raise refuse(f"`{spot.name}` must be positive", f"{raw}", spot.file, "Check its sign.")
        return value

    return _build_validator(read)


def _read_share(raw: Any, spot: EntryLocation) -> float:
    """A share, as 0.25 or "25 %"."""
    text = str(raw).strip()
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError as error:
        raise refuse("a share is a number", f"{raw!r}", str(spot), "Write 0.25 or '25 %'.") from error
    if isinstance(raw, bool) or not 0 <= value < 1:
        raise refuse(f"`{spot.name}` must lie between 0 and 1", f"{raw}", spot.file, "Write 0.25 or '25 %'.")
    return value


def _read_factor(raw: Any, spot: EntryLocation) -> float:
    """A safety factor."""
    value = read_quantity(raw, "count", spot).value
    if value < 1:
        rule = f"`{spot.name}` is how many times stronger than its load, at least 1"
        raise refuse(rule, f"{raw}", spot.file, "Write 1 for no safety.")
    return value


def _validate_range(kind: str) -> BeforeValidator:
    """Lowest and highest; one quantity fixes both."""

    def read(raw: Any, spot: EntryLocation) -> tuple[float, float]:
        ends = raw if isinstance(raw, list) else [raw, raw]
        if len(ends) != 2:
            remedy = "Write one quantity, or [lowest, highest]."
            raise refuse(f"`{spot.name}` is a quantity or a pair of them", f"{raw}", spot.file, remedy)
        low, high = (read_quantity(end, kind, spot).value for end in ends)
        if low > high:
            raise refuse(f"`{spot.name}` has its lowest value first", f"{raw}", spot.file, "Turn them over.")
        return low, high

    return _build_validator(read)


def _validate_list(read: Callable[[Any, EntryLocation], Any]) -> BeforeValidator:
    def read_items(raw: Any, spot: EntryLocation) -> tuple[Any, ...]:
        items = raw if isinstance(raw, list) else [raw]
        if not items:
            raise refuse(
                f"`{spot.name}` needs at least one entry", "none", spot.file, "Leave it out for all."
            )
        return tuple(read(item, spot) for item in items)

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
    tuple[float, ...], _validate_list(lambda said, spot: read_quantity(said, "length", spot).value)
]
Names = Annotated[tuple[str, ...], _validate_list(lambda said, spot: str(said))]


class _SpecTable(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ForceDemand(_SpecTable):
    """[[force]]: what all muscles together must pull at one place of the stroke."""

    model_config = ConfigDict(title="force")
    at_least: Force
    contraction: Share | None = None
    shortening: Length | None = None
    pressure: Pressure | None = None


class Stroke(_SpecTable):
    """[stroke]: how far a load must be moved from rest, and how the load grows on the way."""

    model_config = ConfigDict(title="stroke")
    length: Length
    load: Force | None = None
    stiffness: Stiffness | None = None


class Supply(_SpecTable):
    """[supply]: the highest pressure there is."""

    model_config = ConfigDict(title="supply")
    pressure: Pressure


class SizeLimits(_SpecTable):
    """[envelope]: the room there is."""

    model_config = ConfigDict(title="envelope")
    length: Length | None = None
    fittings: Length | None = None
    diameter: Length | None = None
    bundle: Length | None = None


class Safety(_SpecTable):
    """[safety]: how many times stronger than its load."""

    model_config = ConfigDict(title="safety")
    thread: Factor = 3.0
    mesh: Factor = 1.5
    rubber: Factor = 2.0


class Threads(_SpecTable):
    """[threads]: the catalogue of threads."""

    model_config = ConfigDict(title="threads")
    kinds: Names | None = None
    counts: Counts | None = None
    diameters: Lengths | None = None


class Bladders(_SpecTable):
    """[bladders]: the catalogue of bladders."""

    model_config = ConfigDict(title="bladders")
    kinds: Names | None = None
    diameters: Lengths | None = None


class OwnThread(_SpecTable):
    """[[thread]]: a kind of thread that is not shipped, or a price for one that is."""

    model_config = ConfigDict(title="thread")
    name: str
    modulus: Pressure | None = None
    strength: Pressure | None = None
    density: Density | None = None
    fill: Share | None = None
    diameters: Lengths | None = None
    price: Number | None = None


class OwnBladder(_SpecTable):
    """[[bladder]]: a rubber that is not shipped, or a price for one that is."""

    model_config = ConfigDict(title="bladder")
    name: str
    modulus: Pressure | None = None
    density: Density | None = None
    elongation: Number | None = None
    price: Number | None = None


class CoordinateLimits(_SpecTable):
    """[limits]: what the muscle itself may be."""

    model_config = ConfigDict(title="limits")
    rest_length: Annotated[tuple[float, float], _validate_range("length")] | None = None
    thread_length: Annotated[tuple[float, float], _validate_range("length")] | None = None
    turns: Annotated[tuple[float, float], _validate_range("count")] | None = None
    braid_angle: Annotated[tuple[float, float], _validate_range("angle")] | None = None
    diameter: Annotated[tuple[float, float], _validate_range("length")] | None = None
    wall: Annotated[tuple[float, float], _validate_range("length")] | None = None
    slenderness: Number = 3.0


class Tolerance(_SpecTable):
    """[tolerance]: how exactly it is built, one standard deviation."""

    model_config = ConfigDict(title="tolerance")
    rest_length: Length | None = None
    thread_length: Length | None = None
    turns: Number | None = None
    wall: Length | None = None


class Calibration(_SpecTable):
    """[calibration]: a muscle that was measured, and what of this one it speaks for."""

    model_config = ConfigDict(title="calibration")
    muscle: str | None = None
    posterior: str | None = None
    thread: str | None = None
    bladder: str | None = None
    discrepancy: Share | None = None


class SpecEntries(_SpecTable):
    """The whole file."""

    model_config = ConfigDict(title=SPEC_TITLE)
    name: str = ""
    minimise: Objective = "diameter"
    against: Objective | None = None
    probability: Share | None = None
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
    """The words of a spec, or the first thing wrong with it as one sentence.

    Raises:
        BadInput: if it is no TOML, or says what a spec cannot say.
    """
    if isinstance(raw, bytes):
        try:
            raw = tomllib.loads(decode_text(raw, file).replace("\r\n", "\n"))
        except tomllib.TOMLDecodeError as error:
            got = str(error)[:1].lower() + str(error)[1:].rstrip(".")
            remedy = "A text stands in double quotes, a table in [brackets]."
            raise refuse(f"{file} must be TOML", got, remedy=remedy) from error
    try:
        return SpecEntries.model_validate(dict(raw), context={"file": file})
    except ValidationError as error:
        raise _translate_error(error, file) from error


def _translate_error(error: ValidationError, file: str) -> BadInput:
    """The first complaint of pydantic in our wording."""
    # A misspelt entry also shows as one that is missing: the misspelling is what to mend.
    first = sorted(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")[0]
    own_error = first.get("ctx", {}).get("error")
    if isinstance(own_error, BadInput):
        return own_error
    path = [str(part) for part in first["loc"] if not isinstance(part, int)]
    where = f"[{path[0]}] of {file}" if len(path) > 1 else file
    if first["type"] == "extra_forbidden":
        known_fields = _find_table(path[0]).model_fields if len(path) > 1 else SpecEntries.model_fields
        return refuse(f"`{path[-1]}` is no entry", where=where, remedy=suggest_word(path[-1], known_fields))
    if first["type"] == "missing":
        missing = f"`{path[-1]}`" if len(path) > 1 else f"a table [{path[0]}]"
        return refuse(
            f"a spec must state {missing}", "none", where, f"Add it: {_EXAMPLE_ENTRIES.get(path[-1], '')}"
        )
    if first["type"] == "literal_error":
        return refuse(
            f"`{path[-1]}` is one of {', '.join(OBJECTIVES)}",
            f"{first['input']!r}",
            where,
            suggest_word(str(first["input"]), OBJECTIVES),
        )
    if first["type"] == "tuple_type" and path[-1] in ("force", "thread", "bladder"):
        rule = f"each `{path[-1]}` is a table of its own"
        return refuse(rule, f"[{path[-1]}]", file, f"Write [[{path[-1]}]].")
    remedy = first["msg"].replace("Input should be", "It should be") + "."
    return refuse(f"`{path[-1]}` is of another kind", f"{first['input']!r}", where, remedy)


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
