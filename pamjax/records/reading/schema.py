"""The words muscle.toml may use: its tables and entries, and what a misspelt one is told."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo

from pamjax.errors import BadInput, nearest, refuse
from pamjax.records.files import decode
from pamjax.records.reading.header import KINDS
from pamjax.records.reading.quantity import Measured, Noise, Spot, read_count, read_noise, read_quantity


def _spot(info: ValidationInfo) -> Spot:
    table = (info.config or {}).get("title")
    return Spot(f"[{table}] {info.field_name}", (info.context or {}).get("file", "muscle.toml"))


def _checked(read: Callable[[Any, Spot], Any]) -> BeforeValidator:
    """A reader of ours as a pydantic validator; what it raises keeps its one sentence."""
    return BeforeValidator(lambda said, info: read(said, _spot(info)))


def _quantity(kind: str) -> BeforeValidator:
    return _checked(lambda said, spot: read_quantity(said, kind, spot))


def _noise(kind: str, settings: bool = False) -> BeforeValidator:
    return _checked(lambda said, spot: read_noise(said, kind, spot, settings))


def _angle(said: Any, spot: Spot) -> Measured:
    angle = read_quantity(said, "angle", spot)
    if not angle.value < math.pi / 2:
        got = f"{math.degrees(angle.value):.4g} deg"
        remedy = "It is measured from the circumference."
        raise refuse(f"`{spot.name}` must lie between 0 and 90 deg", got, spot.file, remedy)
    return angle


Length = Annotated[Measured, _quantity("length")]
Area = Annotated[Measured, _quantity("area")]
Pressure = Annotated[Measured, _quantity("pressure")]
Force = Annotated[Measured, _quantity("force")]
Angle = Annotated[Measured, _checked(_angle)]
Number = Annotated[Measured, _quantity("count")]
Count = Annotated[int, _checked(read_count)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class Muscle(_Table):
    """[muscle]: the muscle at rest, and its braid in one of two forms."""

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


class Thread(_Table):
    """[thread]: how stiff it is, each or all together."""

    model_config = ConfigDict(title="thread")
    modulus: Pressure | None = None
    stiffness: Force | None = None


class Bladder(_Table):
    """[bladder]: the rubber tube, for the mechanism `bladder_elasticity`."""

    model_config = ConfigDict(title="bladder")
    inner_diameter: Length | None = None
    thickness: Length | None = None
    modulus: Pressure | None = None


class Sensors(_Table):
    """[sensors]: noise of one sample."""

    model_config = ConfigDict(title="sensors")
    force: Annotated[Noise, _noise("force")] | None = None
    diameter: Annotated[Noise, _noise("length")] | None = None
    pressure: Annotated[Noise, _noise("pressure")] | None = None
    length: Annotated[Noise, _noise("length", settings=True)] | None = None


class Baseline(_Table):
    """[baseline]: what the lab believes so far."""

    model_config = ConfigDict(title="baseline")
    model: Literal["inelastic", "elastic"] | None = None


class Document(_Table):
    """The whole file."""

    muscle: Muscle
    thread: Thread = Field(default_factory=Thread)
    bladder: Bladder | None = None
    sensors: Sensors = Field(default_factory=Sensors)
    baseline: Baseline = Field(default_factory=Baseline)
    columns: dict[str, str] = Field(default_factory=dict)

    @classmethod
    def of(cls, said: Mapping[str, Any], file: str) -> Document:
        """The document in a mapping, or the first thing wrong with it as one sentence."""
        try:
            document = cls.model_validate(dict(said), context={"file": file})
        except ValidationError as error:
            raise _told(error, file) from error
        for name in document.columns:
            if name not in KINDS:
                raise refuse(
                    f"`{name}` is no column of a recording",
                    where=f"[columns] of {file}",
                    remedy=nearest(name, KINDS),
                )
        return document


def read_document(raw: bytes, file: str) -> Document:
    """The document in a file's bytes.

    Raises:
        BadInput: if it is no TOML, or says what muscle.toml cannot say.
    """
    try:
        said = tomllib.loads(decode(raw, file).replace("\r\n", "\n"))
    except tomllib.TOMLDecodeError as error:
        got = str(error)[:1].lower() + str(error)[1:].rstrip(".")
        raise refuse(
            f"{file} must be TOML", got, remedy="A text stands in double quotes, a table in [brackets]."
        ) from error
    return Document.of(said, file)


def _told(error: ValidationError, file: str) -> BadInput:
    """The first complaint of pydantic in our wording; the reader mends one thing at a time."""
    first = error.errors()[0]
    own = first.get("ctx", {}).get("error")
    if isinstance(own, BadInput):
        return own
    path = [str(part) for part in first["loc"]]
    where = f"[{path[0]}] of {file}" if len(path) > 1 else file
    if first["type"] == "extra_forbidden":
        return _unknown(path, where)
    if first["type"] == "missing":
        return refuse(f"{file} must have a table [{path[0]}]", remedy="It says what the muscle is.")
    if first["type"] == "literal_error":
        said = str(first["input"])
        return refuse(
            '`model` must be "inelastic" or "elastic"',
            f"{said!r}",
            where,
            nearest(said, ["inelastic", "elastic"]),
        )
    kind = "a table" if len(path) == 1 else "a text in quotes"
    return refuse(f"`{path[-1]}` must be {kind}", f"{first['input']!r}", where)


def _unknown(path: list[str], where: str) -> BadInput:
    if len(path) == 1:
        return refuse(f"[{path[0]}] is no table of {where}", remedy=nearest(path[0], Document.model_fields))
    known = _TABLES[path[0]].model_fields
    return refuse(f"`{path[1]}` is no entry", where=where, remedy=nearest(path[1], known))


_TABLES: dict[str, type[_Table]] = {
    "muscle": Muscle,
    "thread": Thread,
    "bladder": Bladder,
    "sensors": Sensors,
    "baseline": Baseline,
}
