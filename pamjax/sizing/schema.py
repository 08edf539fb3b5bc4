"""The words a sizing spec may use: its tables and entries, with any unit, and what a misspelt one is told."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo

from pamjax.errors import BadInput, nearest, refuse
from pamjax.records.files import decode
from pamjax.records.reading.quantity import Spot, read_count, read_quantity
from pamjax.units import number_in

Objective = Literal["diameter", "mass", "air", "pressure", "cost", "length"]
OBJECTIVES: tuple[str, ...] = get_args(Objective)

#: Title of what stands in no table.
WHOLE = "the spec"


def _checked(read: Callable[[Any, Spot], Any]) -> BeforeValidator:
    def spotted(said: Any, info: ValidationInfo) -> Any:
        table = (info.config or {}).get("title")
        name = str(info.field_name) if table == WHOLE else f"[{table}] {info.field_name}"
        return read(said, Spot(name, (info.context or {}).get("file", "the spec")))

    return BeforeValidator(spotted)


def _quantity(kind: str) -> BeforeValidator:
    return _checked(lambda said, spot: read_quantity(said, kind, spot).value)


def _in(unit: str) -> BeforeValidator:
    """A positive number in a unit that is none of the lab's usual kinds; a bare one is in SI."""

    def read(said: Any, spot: Spot) -> float:
        if isinstance(said, bool) or not isinstance(said, (int, float, str)):
            raise refuse("a quantity is a number and a unit", f"{said!r}", str(spot), f"Its unit is {unit}.")
        value = number_in(said, unit, str(spot)) if isinstance(said, str) else float(said)
        if not value > 0:
            raise refuse(f"`{spot.name}` must be positive", f"{said}", spot.file, "Check its sign.")
        return value

    return _checked(read)


def _share(said: Any, spot: Spot) -> float:
    """A share, as 0.25 or "25 %"."""
    text = str(said).strip()
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError as error:
        raise refuse("a share is a number", f"{said!r}", str(spot), "Write 0.25 or '25 %'.") from error
    if isinstance(said, bool) or not 0 <= value < 1:
        raise refuse(f"`{spot.name}` must lie between 0 and 1", f"{said}", spot.file, "Write 0.25 or '25 %'.")
    return value


def _factor(said: Any, spot: Spot) -> float:
    """A safety factor."""
    value = read_quantity(said, "count", spot).value
    if value < 1:
        rule = f"`{spot.name}` is how many times stronger than its load, at least 1"
        raise refuse(rule, f"{said}", spot.file, "Write 1 for no safety.")
    return value


def _range(kind: str) -> BeforeValidator:
    """Lowest and highest; one quantity fixes both."""

    def read(said: Any, spot: Spot) -> tuple[float, float]:
        ends = said if isinstance(said, list) else [said, said]
        if len(ends) != 2:
            remedy = "Write one quantity, or [lowest, highest]."
            raise refuse(f"`{spot.name}` is a quantity or a pair of them", f"{said}", spot.file, remedy)
        low, high = (read_quantity(end, kind, spot).value for end in ends)
        if low > high:
            raise refuse(f"`{spot.name}` has its lowest value first", f"{said}", spot.file, "Turn them over.")
        return low, high

    return _checked(read)


def _list(read: Callable[[Any, Spot], Any]) -> BeforeValidator:
    def each(said: Any, spot: Spot) -> tuple[Any, ...]:
        every = said if isinstance(said, list) else [said]
        if not every:
            raise refuse(
                f"`{spot.name}` needs at least one entry", "none", spot.file, "Leave it out for all."
            )
        return tuple(read(one, spot) for one in every)

    return _checked(each)


Length = Annotated[float, _quantity("length")]
Pressure = Annotated[float, _quantity("pressure")]
Force = Annotated[float, _quantity("force")]
Volume = Annotated[float, _quantity("volume")]
Number = Annotated[float, _quantity("count")]
Factor = Annotated[float, _checked(_factor)]
Stiffness = Annotated[float, _in("N/m")]
Density = Annotated[float, _in("kg/m^3")]
Share = Annotated[float, _checked(_share)]
Counts = Annotated[tuple[int, ...], _list(read_count)]
Lengths = Annotated[tuple[float, ...], _list(lambda said, spot: read_quantity(said, "length", spot).value)]
Names = Annotated[tuple[str, ...], _list(lambda said, spot: str(said))]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Pull(_Table):
    """[[force]]: what all muscles together must pull at one place of the stroke."""

    model_config = ConfigDict(title="force")
    at_least: Force
    contraction: Share | None = None
    shortening: Length | None = None
    pressure: Pressure | None = None


class Stroke(_Table):
    """[stroke]: how far a load must be moved from rest, and how the load grows on the way."""

    model_config = ConfigDict(title="stroke")
    length: Length
    load: Force | None = None
    stiffness: Stiffness | None = None


class Supply(_Table):
    """[supply]: the highest pressure there is."""

    model_config = ConfigDict(title="supply")
    pressure: Pressure


class Envelope(_Table):
    """[envelope]: the room there is."""

    model_config = ConfigDict(title="envelope")
    length: Length | None = None
    fittings: Length | None = None
    diameter: Length | None = None
    bundle: Length | None = None


class Safety(_Table):
    """[safety]: how many times stronger than its load."""

    model_config = ConfigDict(title="safety")
    thread: Factor = 3.0
    mesh: Factor = 1.5
    rubber: Factor = 2.0


class Threads(_Table):
    """[threads]: the catalogue of threads."""

    model_config = ConfigDict(title="threads")
    kinds: Names | None = None
    counts: Counts | None = None
    diameters: Lengths | None = None


class Bladders(_Table):
    """[bladders]: the catalogue of bladders."""

    model_config = ConfigDict(title="bladders")
    kinds: Names | None = None
    diameters: Lengths | None = None


class OwnThread(_Table):
    """[[thread]]: a kind of thread that is not shipped, or a price for one that is."""

    model_config = ConfigDict(title="thread")
    name: str
    modulus: Pressure | None = None
    strength: Pressure | None = None
    density: Density | None = None
    fill: Share | None = None
    diameters: Lengths | None = None
    price: Number | None = None


class OwnBladder(_Table):
    """[[bladder]]: a rubber that is not shipped, or a price for one that is."""

    model_config = ConfigDict(title="bladder")
    name: str
    modulus: Pressure | None = None
    density: Density | None = None
    elongation: Number | None = None
    price: Number | None = None


class Limits(_Table):
    """[limits]: what the muscle itself may be."""

    model_config = ConfigDict(title="limits")
    rest_length: Annotated[tuple[float, float], _range("length")] | None = None
    thread_length: Annotated[tuple[float, float], _range("length")] | None = None
    turns: Annotated[tuple[float, float], _range("count")] | None = None
    braid_angle: Annotated[tuple[float, float], _range("angle")] | None = None
    diameter: Annotated[tuple[float, float], _range("length")] | None = None
    wall: Annotated[tuple[float, float], _range("length")] | None = None
    slenderness: Number = 3.0


class Tolerance(_Table):
    """[tolerance]: how exactly it is built, one standard deviation."""

    model_config = ConfigDict(title="tolerance")
    rest_length: Length | None = None
    thread_length: Length | None = None
    turns: Number | None = None
    wall: Length | None = None


class Calibration(_Table):
    """[calibration]: a muscle that was measured, and what of this one it speaks for."""

    model_config = ConfigDict(title="calibration")
    muscle: str | None = None
    posterior: str | None = None
    thread: str | None = None
    bladder: str | None = None
    discrepancy: Share | None = None


class Words(_Table):
    """The whole file."""

    model_config = ConfigDict(title=WHOLE)
    name: str = ""
    minimise: Objective = "diameter"
    against: Objective | None = None
    probability: Share | None = None
    free_contraction: Share | None = None
    air: Volume | None = None
    parallel: Counts = (1,)
    supply: Supply
    force: tuple[Pull, ...] = ()
    stroke: Stroke | None = None
    envelope: Envelope = Field(default_factory=Envelope)
    safety: Safety = Field(default_factory=Safety)
    threads: Threads = Field(default_factory=Threads)
    bladders: Bladders = Field(default_factory=Bladders)
    thread: tuple[OwnThread, ...] = ()
    bladder: tuple[OwnBladder, ...] = ()
    limits: Limits = Field(default_factory=Limits)
    tolerance: Tolerance = Field(default_factory=Tolerance)
    calibration: Calibration | None = None


def read_words(said: Mapping[str, Any] | bytes, file: str) -> Words:
    """The words of a spec, or the first thing wrong with it as one sentence.

    Raises:
        BadInput: if it is no TOML, or says what a spec cannot say.
    """
    if isinstance(said, bytes):
        try:
            said = tomllib.loads(decode(said, file).replace("\r\n", "\n"))
        except tomllib.TOMLDecodeError as error:
            got = str(error)[:1].lower() + str(error)[1:].rstrip(".")
            remedy = "A text stands in double quotes, a table in [brackets]."
            raise refuse(f"{file} must be TOML", got, remedy=remedy) from error
    try:
        return Words.model_validate(dict(said), context={"file": file})
    except ValidationError as error:
        raise _told(error, file) from error


def _told(error: ValidationError, file: str) -> BadInput:
    """The first complaint of pydantic in our wording."""
    # A misspelt entry also shows as one that is missing: the misspelling is what to mend.
    first = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")[0]
    own = first.get("ctx", {}).get("error")
    if isinstance(own, BadInput):
        return own
    path = [str(part) for part in first["loc"] if not isinstance(part, int)]
    where = f"[{path[0]}] of {file}" if len(path) > 1 else file
    if first["type"] == "extra_forbidden":
        known = _table(path[0]).model_fields if len(path) > 1 else Words.model_fields
        return refuse(f"`{path[-1]}` is no entry", where=where, remedy=nearest(path[-1], known))
    if first["type"] == "missing":
        what = f"`{path[-1]}`" if len(path) > 1 else f"a table [{path[0]}]"
        return refuse(f"a spec must state {what}", "none", where, f"Add it: {_EXAMPLE.get(path[-1], '')}")
    if first["type"] == "literal_error":
        return refuse(
            f"`{path[-1]}` is one of {', '.join(OBJECTIVES)}",
            f"{first['input']!r}",
            where,
            nearest(str(first["input"]), OBJECTIVES),
        )
    if first["type"] == "tuple_type" and path[-1] in ("force", "thread", "bladder"):
        rule = f"each `{path[-1]}` is a table of its own"
        return refuse(rule, f"[{path[-1]}]", file, f"Write [[{path[-1]}]].")
    remedy = first["msg"].replace("Input should be", "It should be") + "."
    return refuse(f"`{path[-1]}` is of another kind", f"{first['input']!r}", where, remedy)


_EXAMPLE = {
    "supply": '[supply] pressure = "6 bar".',
    "pressure": 'pressure = "6 bar".',
    "at_least": 'at_least = "500 N".',
    "length": 'length = "50 mm".',
}


def _table(name: str) -> type[BaseModel]:
    tables = {"force": Pull, "thread": OwnThread, "bladder": OwnBladder, "stroke": Stroke, "supply": Supply}
    kinds = tables | {
        "envelope": Envelope, "safety": Safety, "threads": Threads, "bladders": Bladders, "limits": Limits,
        "tolerance": Tolerance, "calibration": Calibration,
    }  # fmt: skip
    return kinds.get(name, Words)
