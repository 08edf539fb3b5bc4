"""Materials of a muscle: threads and bladders, from the supplied tables with their ranges, or from a spec."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from pamjax.errors import BadInput, suggest_word
from pamjax.records.shipped_tables import convert_to_si, read_shipped

#: Assumed diameters of commercial threads, m; each material uses those within its own range.
_STOCK_DIAMETERS = (0.05e-3, 0.1e-3, 0.15e-3, 0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3, 0.7e-3, 1.0e-3)


@dataclass(frozen=True)
class PropertyRange:
    """A property, SI: its typical value, and the lowest and highest value of its sources."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ThreadKind:
    """A kind of thread, SI.

    Attributes:
        name, about: name and description.
        modulus, strength: Pa, of the solid cross-section.
        density: kg/m³.
        fill: solid fraction of the round cross-section.
        diameters: available diameters, m.
        price: per kilogram, in any currency; None if unknown.
        source: keys of the sources in the table, or "stated" for a value of the spec.
    """

    name: str
    about: str
    modulus: PropertyRange
    strength: PropertyRange
    density: float
    fill: float
    diameters: tuple[float, ...]
    price: float | None = None
    source: str = "stated"

    def area(self, diameter: float) -> float:
        """Return the solid cross-section of one thread, m²."""
        return self.fill * math.pi * diameter**2 / 4


@dataclass(frozen=True)
class BladderKind:
    """A kind of rubber, SI.

    Attributes:
        name, about: name and description.
        modulus: shear modulus at small strain, Pa.
        mooney: fraction of the second invariant in the Mooney-Rivlin energy.
        density: kg/m³.
        elongation: elongation at break, 1.
        walls: thinnest and thickest available wall, m.
        price: per kilogram, in any currency; None if unknown.
        source: keys of the sources in the table, or "stated" for a value of the spec.
    """

    name: str
    about: str
    modulus: PropertyRange
    mooney: float
    density: float
    elongation: float
    walls: tuple[float, float]
    price: float | None = None
    source: str = "stated"


@cache
def list_threads() -> dict[str, ThreadKind]:
    """Return the supplied kinds of thread by name.

    >>> print(f"{list_threads()['nylon'].modulus.value / 1e9:.1f} GPa")
    4.6 GPa
    """
    return {row["name"]: _read_thread(row) for row in _read_rows("materials/threads")}


@cache
def list_bladders() -> dict[str, BladderKind]:
    """Return the supplied kinds of rubber by name."""
    return {row["name"]: _read_bladder(row) for row in _read_rows("materials/bladders")}


def find_material(name: str, kinds: dict[str, Any], noun: str, where: str) -> Any:
    """Return the material with a name, from those of the spec and the supplied ones.

    Raises:
        BadInput: if the name is unknown.
    """
    if name not in kinds:
        raise BadInput.from_rule(f"unknown {noun} {name!r}", where=where, remedy=suggest_word(name, kinds))
    return kinds[name]


def _read_rows(table: str) -> list[dict[str, Any]]:
    return [
        {str(k): v for k, v in row.items()} for row in convert_to_si(read_shipped(table)).to_dict("records")
    ]


def _read_property(row: dict[str, Any], name: str) -> PropertyRange:
    return PropertyRange(float(row[name]), float(row[f"{name} low"]), float(row[f"{name} high"]))


def _read_thread(row: dict[str, Any]) -> ThreadKind:
    low, high = float(row["diameter low"]), float(row["diameter high"])
    return ThreadKind(
        name=row["name"],
        about=row["about"],
        modulus=_read_property(row, "modulus"),
        strength=_read_property(row, "strength"),
        density=float(row["density"]),
        fill=float(row["fill"]),
        diameters=tuple(d for d in _STOCK_DIAMETERS if low * (1 - 1e-9) <= d <= high * (1 + 1e-9)),
        source=row["source"],
    )


def _read_bladder(row: dict[str, Any]) -> BladderKind:
    return BladderKind(
        name=row["name"],
        about=row["about"],
        modulus=_read_property(row, "shear modulus"),
        mooney=float(row["mooney"]),
        density=float(row["density"]),
        elongation=float(row["elongation"]),
        walls=(float(row["wall low"]), float(row["wall high"])),
        source=row["source"],
    )
