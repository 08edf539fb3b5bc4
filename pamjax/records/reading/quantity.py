"""Quantities in TOML files: "235 mm", a number without a unit, or a value with its standard deviation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pamjax.errors import BadInput, suggest_word
from pamjax.units import parse_quantity, suggest_units

#: Largest count, such as the number of threads.
_MAX_COUNT = 1_000_000


@dataclass(frozen=True)
class MeasuredValue:
    """A value and its standard deviation, both SI; with `sd` 0 the value is exact.

    >>> MeasuredValue(0.2512, 0.0008).sd
    0.0008
    """

    value: float
    sd: float = 0.0


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviation of a sensor, SI, for each "sample" or for each "setting"."""

    sd: float
    per: str = "sample"


@dataclass(frozen=True)
class EntryLocation:
    """Location of an entry: its table and name, and the file."""

    name: str
    file: str

    def __str__(self) -> str:
        return f"{self.name} of {self.file}"


def read_quantity(raw: Any, kind: str, location: EntryLocation) -> MeasuredValue:
    """Return a positive quantity from a text, a number, or a table of `value` and `sd`.

    Raises:
        BadInput: with the location, if it is not a positive quantity.

    >>> read_quantity({"value": "251.2 mm", "sd": "0.8 mm"}, "length", EntryLocation("x", "y.toml"))
    MeasuredValue(value=0.2512, sd=0.0008)
    """
    where = str(location)
    if isinstance(raw, Mapping):
        _check_keys(raw, ("value", "sd"), where)
        if "value" not in raw:
            raise BadInput.from_rule(
                "a quantity must have a `value`", _format_keys(raw), where, "Write {value = ..., sd = ...}."
            )
        value = _parse_number(raw["value"], kind, where)
        sd = _parse_number(raw.get("sd", 0.0), kind, where) if raw.get("sd") else 0.0
    else:
        value, sd = _parse_number(raw, kind, where), 0.0
    if not value > 0:
        raise BadInput.from_rule(
            f"`{location.name}` must be positive",
            _format_raw(raw, "value"),
            location.file,
            "Check its sign and unit.",
        )
    if sd < 0:
        raise BadInput.from_rule(
            "`sd` must not be negative", _format_raw(raw, "sd"), where, "Write one standard deviation."
        )
    return MeasuredValue(value, sd)


def read_load(raw: Any, location: EntryLocation) -> float:
    """Return a set force, N, that is not negative, from a text such as "20 N".

    Raises:
        BadInput: with the location, if it is not such a force.
    """
    load = _parse_number(raw, "force", str(location))
    if load < 0:
        remedy = "A weight that stretches the muscle is positive. Write 0 N for a free muscle."
        raise BadInput.from_rule(f"`{location.name}` must not be negative", f"{raw}", location.file, remedy)
    return load


def read_sensor_noise(raw: Any, kind: str, location: EntryLocation, allow_per_setting: bool) -> SensorNoise:
    """Return a sensor's noise from a text, or from a table of `sd` and, if allowed, `per`."""
    per, where = "sample", str(location)
    if isinstance(raw, Mapping):
        _check_keys(raw, ("sd", "per") if allow_per_setting else ("sd",), where)
        per = raw.get("per", per)
        if per not in ("sample", "setting"):
            raise BadInput.from_rule(
                '`per` must be "sample" or "setting"',
                f"{per!r}",
                where,
                suggest_word(str(per), ["sample", "setting"]),
            )
        if "sd" not in raw:
            raise BadInput.from_rule(
                "a sensor's noise must have an `sd`",
                _format_keys(raw),
                where,
                "Write one standard deviation.",
            )
    sd = _parse_number(raw["sd"] if isinstance(raw, Mapping) else raw, kind, where)
    if not sd > 0:
        remedy = "Write one standard deviation, or remove the entry: pamjax then estimates it."
        raise BadInput.from_rule(
            f"`{location.name}` must be positive", _format_raw(raw, "sd"), location.file, remedy
        )
    return SensorNoise(sd, per)


def read_count(raw: Any, location: EntryLocation) -> int:
    """Return a positive whole number."""
    if (
        isinstance(raw, bool)
        or not isinstance(raw, (int, float))
        or not 0 < raw < math.inf
        or raw != int(raw)
    ):
        rule = f"`{location.name}` must be a positive whole number"
        raise BadInput.from_rule(
            rule, f"{raw!r}", location.file, "Write it without quotes and without a unit."
        )
    if raw > _MAX_COUNT:
        rule = f"`{location.name}` must be at most {_MAX_COUNT}"
        raise BadInput.from_rule(rule, f"{raw!r}", location.file, "Check its digits.")
    return int(raw)


def _check_keys(raw: Mapping[str, Any], valid_keys: tuple[str, ...], where: str) -> None:
    """Refuse the first unknown key."""
    for key in raw:
        if key not in valid_keys:
            raise BadInput.from_rule(
                f"unknown entry `{key}`", where=where, remedy=suggest_word(key, valid_keys)
            )


def _parse_number(raw: Any, kind: str, where: str) -> float:
    if isinstance(raw, bool) or not isinstance(raw, (int, float, str)):
        remedy = f'Write a text such as "3 {suggest_units(kind).split(",")[0].split(" ")[0]}".'
        raise BadInput.from_rule("a quantity must be a number with a unit", f"{raw!r}", where, remedy)
    return parse_quantity(raw, kind, where)


def _format_keys(raw: Mapping[str, Any]) -> str:
    return ", ".join(f"`{key}`" for key in raw) or "nothing"


def _format_raw(raw: Any, key: str) -> str:
    return f"{raw[key] if isinstance(raw, Mapping) else raw}"
