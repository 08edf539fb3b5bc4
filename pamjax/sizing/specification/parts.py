"""Parts that are sold: rubber tubes, yarns by their count, braided sleeves and hose barbs.

The tables are in `data/materials/`; each row names its source. Most sizes are typical ones of a usual series.

    yarn of count T (kg/m):   solid area A = T / density,   outer diameter d = sqrt(4 A / (π fill))
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from pamjax.records.shipped_tables import convert_to_si, read_shipped
from pamjax.sizing.specification.materials import ThreadKind
from pamjax.units import format_quantity

#: Largest barb / inner diameter of its tube: the tube is stretched over the barb.
_MAX_BARB_RATIO = 1.3


@dataclass(frozen=True)
class Tube:
    """A rubber tube, SI.

    Attributes:
        rubber: name of the rubber.
        inner_diameter, wall: nominal, m.
        wall_tolerance: half width, m.
        size: size as ordered.
        source: keys of the sources in the table.
    """

    rubber: str
    inner_diameter: float
    wall: float
    wall_tolerance: float
    size: str
    source: str

    @property
    def outer_diameter(self) -> float:
        return self.inner_diameter + 2 * self.wall

    @property
    def metric_size(self) -> str:
        """Return bore and wall in mm, with the trade size in brackets if it is in inches."""
        bore, wall = (format_quantity(value, "mm", 3) for value in (self.inner_diameter, self.wall))
        return f"bore {bore}, wall {wall}" + (f" ({self.size})" if self.size.endswith(" in") else "")


@dataclass(frozen=True)
class Sleeve:
    """An expandable braided sleeve, SI: thread, size as ordered, range of diameter and angle."""

    thread: str
    size: str
    low: float
    high: float
    angle_at_low: float
    angle_at_high: float


@cache
def list_tubes() -> tuple[Tube, ...]:
    """Return the tubes of all rubbers."""
    return tuple(
        Tube(
            row["rubber"],
            float(row["inner diameter"]),
            float(row["wall"]),
            float(row["wall tolerance"]),
            str(row["size"]),
            str(row["source"]),
        )
        for row in _read_rows("materials/tubes")
    )


@cache
def list_yarn_counts(thread: str) -> tuple[float, ...]:
    """Return the counts of the yarns of a thread, kg/m; empty if it has none, such as a wire.

    >>> [round(1e7 * count) for count in list_yarn_counts("pet")]
    [280, 550, 1100, 1670, 2200]
    """
    return tuple(float(row["count"]) for row in _read_rows("materials/yarns") if row["thread"] == thread)


@cache
def list_sleeves() -> tuple[Sleeve, ...]:
    """Return the braided sleeves."""
    return tuple(
        Sleeve(
            row["thread"],
            str(row["size"]),
            float(row["diameter low"]),
            float(row["diameter high"]),
            float(row["angle at low"]),
            float(row["angle at high"]),
        )
        for row in _read_rows("materials/sleeves")
    )


def compute_yarn_diameter(kind: ThreadKind, count: float) -> float:
    """Return the outer diameter, m, of a yarn of a count, kg/m."""
    return math.sqrt(4 * count / (kind.density * kind.fill * math.pi))


def find_yarn_count(kind: ThreadKind, diameter: float) -> float | None:
    """Return the count, kg/m, of the yarn of a diameter, m; None if no yarn of the table has it."""
    for count in list_yarn_counts(kind.name):
        if math.isclose(compute_yarn_diameter(kind, count), diameter, rel_tol=1e-6):
            return count
    return None


def find_sleeve(thread: str, low: float, high: float) -> Sleeve | None:
    """Return the smallest sleeve of a thread whose range includes two diameters, m, or None."""
    fitting = [
        sleeve
        for sleeve in list_sleeves()
        if sleeve.thread == thread and sleeve.low <= low and high <= sleeve.high
    ]
    return min(fitting, key=lambda sleeve: sleeve.high, default=None)


def find_barb(inner_diameter: float) -> str | None:
    """Return the size of the hose barb for a tube in mm, or None if it needs a turned one.

    A trade size in inches follows in brackets.

    The barb is at least as wide as the bore, because a narrower one does not seal.
    """
    sizes = {str(row["size"]): float(row["inner diameter"]) for row in _read_rows("materials/fittings")}
    wide = {
        size: diameter
        for size, diameter in sizes.items()
        if 0.98 <= diameter / inner_diameter <= _MAX_BARB_RATIO
    }
    size = min(wide, key=lambda size: wide[size], default=None)
    return f"{1e3 * wide[size]:.3g} mm ({size})" if size and size.endswith(" in") else size


@cache
def _read_rows(table: str) -> tuple[dict[str, Any], ...]:
    records = convert_to_si(read_shipped(table)).to_dict("records")
    return tuple({str(k): v for k, v in row.items()} for row in records)
