"""A quantity as a lab writes it: "235 mm", a bare count, or a value with its standard deviation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pamjax.errors import nearest, refuse
from pamjax.units import example, parse


@dataclass(frozen=True)
class Measured:
    """A number and how well it is known, both SI; `sd` 0 is taken as known.

    >>> Measured(0.2512, 0.0008).sd
    0.0008
    """

    value: float
    sd: float = 0.0


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a sensor, SI, for each "sample" or for each "setting"."""

    sd: float
    per: str = "sample"


@dataclass(frozen=True)
class Spot:
    """Where an entry stands: its table and name, and the file."""

    name: str
    file: str

    def __str__(self) -> str:
        return f"{self.name} of {self.file}"


def read_quantity(said: Any, kind: str, spot: Spot) -> Measured:
    """A positive quantity from a string, a bare number, or a table of `value` and `sd`.

    Raises:
        BadInput: naming the place, if it is none.

    >>> read_quantity({"value": "251.2 mm", "sd": "0.8 mm"}, "length", Spot("x", "y.toml"))
    Measured(value=0.2512, sd=0.0008)
    """
    where = str(spot)
    if isinstance(said, Mapping):
        only_keys(said, ("value", "sd"), where)
        if "value" not in said:
            raise refuse("a quantity must have a `value`", _keys(said), where, "Write value = and sd =.")
        value = _number(said["value"], kind, where)
        sd = _number(said.get("sd", 0.0), kind, where) if said.get("sd") else 0.0
    else:
        value, sd = _number(said, kind, where), 0.0
    if not value > 0:
        raise refuse(
            f"`{spot.name}` must be positive", _text(said, "value"), spot.file, "Check its sign and unit."
        )
    if sd < 0:
        raise refuse("`sd` must not be negative", _text(said, "sd"), where, "It is one standard deviation.")
    return Measured(value, sd)


def read_noise(said: Any, kind: str, spot: Spot, settings: bool) -> Noise:
    """A sensor's noise from a string, or from a table of `sd` and, where settings are, `per`."""
    per, where = "sample", str(spot)
    if isinstance(said, Mapping):
        only_keys(said, ("sd", "per") if settings else ("sd",), where)
        per = said.get("per", per)
        if per not in ("sample", "setting"):
            raise refuse(
                '`per` must be "sample" or "setting"',
                f"{per!r}",
                where,
                nearest(str(per), ["sample", "setting"]),
            )
        if "sd" not in said:
            raise refuse(
                "a sensor's noise must have an `sd`", _keys(said), where, "It is one standard deviation."
            )
    sd = _number(said["sd"] if isinstance(said, Mapping) else said, kind, where)
    if not sd > 0:
        remedy = "It is one standard deviation; leave it out to have it estimated."
        raise refuse(f"`{spot.name}` must be positive", _text(said, "sd"), spot.file, remedy)
    return Noise(sd, per)


def read_count(said: Any, spot: Spot) -> int:
    """A positive whole number."""
    if (
        isinstance(said, bool)
        or not isinstance(said, (int, float))
        or not 0 < said < math.inf
        or said != int(said)
    ):
        rule = f"`{spot.name}` must be a positive whole number"
        raise refuse(rule, f"{said!r}", spot.file, "Write it without quotes and unit.")
    return int(said)


def only_keys(said: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Refuse the first key that is none of the known ones, naming the nearest."""
    for key in said:
        if key not in known:
            raise refuse(f"`{key}` is no entry here", where=where, remedy=nearest(key, known))


def _number(said: Any, kind: str, where: str) -> float:
    if isinstance(said, bool) or not isinstance(said, (int, float, str)):
        remedy = f'Write a string such as "3 {example(kind).split(",")[0].split(" ")[0]}".'
        raise refuse("a quantity is a number and a unit", f"{said!r}", where, remedy)
    value = parse(said, kind, where)
    if not math.isfinite(value):
        raise refuse("a quantity must be finite", f"{said!r}", where, "Leave out what is not known.")
    return value


def _keys(said: Mapping[str, Any]) -> str:
    return ", ".join(f"`{key}`" for key in said) or "nothing"


def _text(said: Any, key: str) -> str:
    return f"{said[key] if isinstance(said, Mapping) else said}"
