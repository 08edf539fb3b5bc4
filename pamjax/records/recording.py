"""A recording: what was measured, one row a sample, in SI, with blanks told from zeros."""

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
    """One outlying cell that was set aside: it stands as "not measured" in the recording.

    Attributes:
        row: line of the CSV file.
        column: "pressure", "length", "force" or "diameter".
        value: what the cell said, SI.
        unit: unit in which a person reads it.
        reason: what is wrong with it, one clause.
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
    """What was measured, row by row; NaN is "not measured".

    Attributes:
        time: (n,) s, strictly increasing, or None where the rows are a static map without order.
        pressure: (n,) gauge pressure at the muscle's inlet, Pa.
        length: (n,) distance between the fittings, m.
        force: (n,) tension, N, positive pulls.
        diameter: (n,) outer mean diameter, m.
        cycle: (n,) stroke, step or test; 0 while the rig settles; 1 everywhere where it was not given.
        row: (n,) line of the CSV file, its header being line 1.
        outliers: the outlying cells that were set aside.
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
        """How many rows there are."""
        return len(self)

    @property
    def has_time(self) -> bool:
        """Whether the order of the rows means anything."""
        return self.time is not None

    @property
    def channels(self) -> tuple[str, ...]:
        """Which of force and diameter were measured in at least one row."""
        return tuple(name for name in ("force", "diameter") if np.isfinite(getattr(self, name)).any())

    @property
    def usable(self) -> np.ndarray:
        """(n,) bool: rows whose pressure and length are both known, so that a model can be asked there."""
        return np.isfinite(self.pressure) & np.isfinite(self.length)

    @property
    def starts(self) -> np.ndarray:
        """(n,) bool: rows at which a continuous history begins; every row of a static map."""
        if self.time is None:
            return np.ones(self.n, dtype=bool)
        new_cycle = np.r_[False, np.diff(self.cycle) != 0]
        moved = _find_jumps(self.pressure) | _find_jumps(self.length)
        begins = _find_pauses(self.time) | (new_cycle & moved)
        begins[:1] = True
        return begins

    @property
    def length_and_pressure(self) -> np.ndarray:
        """(2, n) length, m, and pressure, Pa: what turns back at corners of strokes; 0 where not measured."""
        return np.nan_to_num(np.stack([self.length, self.pressure]))

    def select(self, mask: np.ndarray) -> Recording:
        """The rows of a mask (or of row indices), with the line numbers they came from."""
        columns = {
            name: getattr(self, name)[mask] for name in (*DISPLAY_UNIT, "cycle", "row") if name != "time"
        }
        time = None if self.time is None else self.time[mask]
        kept = set(columns["row"].tolist())
        return Recording(time=time, **columns, outliers=tuple(a for a in self.outliers if a.row in kept))

    def blank_cells(self, cells: dict[str, np.ndarray], outliers: tuple[Outlier, ...]) -> Recording:
        """A copy in which the masked cells of each named column count as not measured."""
        blanked = {name: np.where(mask, np.nan, getattr(self, name)) for name, mask in cells.items()}
        return replace(self, **blanked, outliers=self.outliers + outliers)

    def to_frame(self) -> pd.DataFrame:
        """The recording as a table with "name [unit]" headers, as it would stand in recording.csv."""
        import pandas as pd

        table = {
            f"{name} [{unit}]": getattr(self, name) / compute_si_factor(unit)
            for name, unit in DISPLAY_UNIT.items()
            if name in ("pressure", "length", *self.channels) or (name == "time" and self.has_time)
        }
        return pd.DataFrame({**table, "cycle": self.cycle})


def _find_pauses(time: np.ndarray) -> np.ndarray:
    """(n,) bool: rows before which time ran back, or stood still for much longer than usual."""
    step = np.diff(time)
    if not len(step):
        return np.zeros(len(time), dtype=bool)
    usual = np.median(step[step > 0]) if (step > 0).any() else np.inf
    before = np.r_[usual, step[:-1]]
    # Some logs space their samples out over a hold: only a step unlike the one before it is a pause.
    return np.r_[False, (step <= 0) | (step > MIN_PAUSE_STEPS * np.maximum(usual, before))]


def _find_jumps(channel: np.ndarray) -> np.ndarray:
    """(n,) bool: rows before which a channel jumps alone, so that what lay between was not recorded."""
    measured = np.flatnonzero(np.isfinite(channel))
    jumps = np.zeros(len(channel), dtype=bool)
    if len(measured) < 2:
        return jumps
    step = np.abs(np.diff(channel[measured]))
    beside = np.maximum(np.r_[0.0, step[:-1]], np.r_[step[1:], 0.0])
    far = step > MIN_JUMP_SHARE * np.ptp(channel[measured])
    jumps[measured[1:]] = far & (step > MIN_JUMP_TO_NEIGHBOUR * beside)
    return jumps
