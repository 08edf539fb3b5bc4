"""Recordings: measured channels in SI, one row per sample, NaN where not measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import refuse
from pamjax.units import compute_si_factor, format_quantity

if TYPE_CHECKING:
    import pandas as pd


#: A time step this many times the usual one, and the one before it, is a pause in which the rig was moved.
MIN_PAUSE_STEPS = 4.0

#: A step at a cycle's first row is a jump if it is this share of the channel's range ...
MIN_JUMP_SHARE = 0.02
#: ... and this many times both steps beside it: a ramp moves by as much before or after, a jump does not.
MIN_JUMP_TO_NEIGHBOUR = 5.0


@dataclass(frozen=True)
class Outlier:
    """An outlying cell that is treated as not measured.

    Attributes:
        row: line of the CSV file.
        column: "pressure", "length", "force" or "diameter".
        value: value of the cell, SI.
        unit: unit in messages.
        reason: reason, one clause.
    """

    row: int
    column: str
    value: float
    unit: str
    reason: str

    def __str__(self) -> str:
        return (
            f"{self.column} {format_quantity(self.value, self.unit, 6)} in row {self.row} was set"
            f" aside: {self.reason}"
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """Measured channels, one row per sample; NaN where not measured.

    Attributes:
        time: (n,) s, strictly increasing; None for a static map, whose rows have no order.
        pressure: (n,) gauge pressure at the muscle's inlet, Pa.
        length: (n,) distance between the fittings, m.
        force: (n,) tension, N, positive when the muscle pulls.
        diameter: (n,) outer mean diameter, m.
        cycle: (n,) number of the stroke, step or test; 0 before the first; 1 everywhere if not given.
        row: (n,) line of the CSV file, whose header is line 1.
        outliers: the outlying cells that were ignored.
    """

    time: np.ndarray | None
    pressure: np.ndarray
    length: np.ndarray
    force: np.ndarray
    diameter: np.ndarray
    cycle: np.ndarray
    row: np.ndarray
    outliers: tuple[Outlier, ...] = field(default=())

    @classmethod
    def from_arrays(
        cls,
        *,
        pressure: Sequence[float] | np.ndarray,
        length: Sequence[float] | np.ndarray | float,
        force: Sequence[float] | np.ndarray | None = None,
        diameter: Sequence[float] | np.ndarray | None = None,
        time: Sequence[float] | np.ndarray | None = None,
        cycle: Sequence[int] | np.ndarray | None = None,
        row: Sequence[int] | np.ndarray | None = None,
        outliers: tuple[Outlier, ...] = (),
    ) -> Recording:
        """Build a recording from SI arrays; one number as `length` holds for every row.

        Raises:
            BadInput: if the columns are not equally long.

        >>> Recording.from_arrays(pressure=[1e5, 2e5], length=0.2, force=[310.0, 640.0]).channels
        ('force',)
        """
        n = len(pressure)
        columns = {
            "pressure": pressure,
            "length": np.full(n, length) if np.ndim(length) == 0 else length,
            "force": np.full(n, np.nan) if force is None else force,
            "diameter": np.full(n, np.nan) if diameter is None else diameter,
            "cycle": np.ones(n) if cycle is None else cycle,
            "row": np.arange(n) + 2 if row is None else row,
        }
        if time is not None:
            columns["time"] = time
        for name, values in columns.items():
            if np.shape(values) != (n,):
                got = f"{np.shape(values)} beside ({n},)"
                raise refuse(f"`{name}` must be as long as `pressure`", got)
        arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
        return cls(
            time=arrays.get("time"),
            pressure=arrays["pressure"],
            length=arrays["length"],
            force=arrays["force"],
            diameter=arrays["diameter"],
            cycle=arrays["cycle"].astype(int),
            row=arrays["row"].astype(int),
            outliers=outliers,
        )

    def __len__(self) -> int:
        return len(self.pressure)

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self)

    @property
    def has_time(self) -> bool:
        """Whether the rows are a time series."""
        return self.time is not None

    @property
    def channels(self) -> tuple[str, ...]:
        """Those of force and diameter that were measured in at least one row."""
        return tuple(name for name in ("force", "diameter") if np.isfinite(getattr(self, name)).any())

    @property
    def usable(self) -> np.ndarray:
        """(n,) bool: rows with measured pressure and length, which a model needs."""
        return np.isfinite(self.pressure) & np.isfinite(self.length)

    @property
    def starts(self) -> np.ndarray:
        """(n,) bool: first rows of continuous parts; every row of a static map."""
        if self.time is None:
            return np.ones(self.n, dtype=bool)
        new_cycle = np.r_[False, np.diff(self.cycle) != 0]
        moved = _find_jumps(self.pressure) | _find_jumps(self.length)
        begins = _find_pauses(self.time) | (new_cycle & moved)
        begins[:1] = True
        return begins

    @property
    def length_and_pressure(self) -> np.ndarray:
        """(2, n) length, m, and pressure, Pa, which reverse at the ends of strokes; 0 where not measured."""
        return np.nan_to_num(np.stack([self.length, self.pressure]))

    def select(self, mask: np.ndarray) -> Recording:
        """Return the rows of a mask or of row indices; they keep their line numbers."""
        columns = {
            name: getattr(self, name)[mask] for name in (*DISPLAY_UNIT, "cycle", "row") if name != "time"
        }
        time = None if self.time is None else self.time[mask]
        kept = set(columns["row"].tolist())
        return Recording(time=time, **columns, outliers=tuple(a for a in self.outliers if a.row in kept))

    def blank_cells(self, cells: dict[str, np.ndarray], outliers: tuple[Outlier, ...]) -> Recording:
        """Return a copy in which the masked cells of each named column are not measured."""
        blanked = {name: np.where(mask, np.nan, getattr(self, name)) for name, mask in cells.items()}
        return replace(self, **blanked, outliers=self.outliers + outliers)

    def to_frame(self) -> pd.DataFrame:
        """Return the recording as a table with headers "name [unit]", as in recording.csv."""
        import pandas as pd

        table = {
            f"{name} [{unit}]": getattr(self, name) / compute_si_factor(unit)
            for name, unit in DISPLAY_UNIT.items()
            if name in ("pressure", "length", *self.channels) or (name == "time" and self.has_time)
        }
        return pd.DataFrame({**table, "cycle": self.cycle})


def _find_pauses(time: np.ndarray) -> np.ndarray:
    """Return the rows, (n,) bool, before which time decreases or has a long step."""
    step = np.diff(time)
    if not len(step):
        return np.zeros(len(time), dtype=bool)
    usual = np.median(step[step > 0]) if (step > 0).any() else np.inf
    before = np.r_[usual, step[:-1]]
    # Some logs space their samples out over a hold: only a step unlike the one before it is a pause.
    return np.r_[False, (step <= 0) | (step > MIN_PAUSE_STEPS * np.maximum(usual, before))]


def _find_jumps(channel: np.ndarray) -> np.ndarray:
    """Return the rows, (n,) bool, before which a channel has a single large step."""
    measured = np.flatnonzero(np.isfinite(channel))
    jumps = np.zeros(len(channel), dtype=bool)
    if len(measured) < 2:
        return jumps
    step = np.abs(np.diff(channel[measured]))
    beside = np.maximum(np.r_[0.0, step[:-1]], np.r_[step[1:], 0.0])
    far = step > MIN_JUMP_SHARE * np.ptp(channel[measured])
    jumps[measured[1:]] = far & (step > MIN_JUMP_TO_NEIGHBOUR * beside)
    return jumps
