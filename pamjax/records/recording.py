"""Recordings: measured channels in SI, one row per sample, NaN where not measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.errors import BadInput
from pamjax.units import compute_si_factor, format_quantity

if TYPE_CHECKING:
    import pandas as pd


#: Largest number of a cycle; integers of all platforms hold it.
MAX_CYCLE = 1_000_000_000

#: Minimum duration of a pause for moving the rig, in multiples of the median and of the previous time step.
_MIN_PAUSE_STEPS = 4.0

#: Minimum jump at the first row of a cycle, as a share of the channel's range ...
_MIN_JUMP_SHARE = 0.02
#: ... and as a multiple of both neighbouring steps: the steps of a ramp are similar, those at a jump are not.
_MIN_JUMP_TO_NEIGHBOUR = 5.0


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
            f"outlier {self.column} {format_quantity(self.value, self.unit, 6)} in row {self.row}:"
            f" ignored, because {self.reason}"
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
        measures_length: whether the force was set and the length was measured (isotonic test).
    """

    time: np.ndarray | None
    pressure: np.ndarray
    length: np.ndarray
    force: np.ndarray
    diameter: np.ndarray
    cycle: np.ndarray
    row: np.ndarray
    outliers: tuple[Outlier, ...] = field(default=())
    measures_length: bool = False

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
        measures_length: bool = False,
    ) -> Recording:
        """Return a recording from SI arrays; a single `length` applies to every row.

        Raises:
            BadInput: if the columns differ in length.

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
                got = f"shapes {np.shape(values)} and ({n},)"
                remedy = "Pass one value for each row."
                raise BadInput.from_rule(f"`{name}` must have as many rows as `pressure`", got, remedy=remedy)
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
            measures_length=measures_length,
        )

    def __len__(self) -> int:
        return len(self.pressure)

    @property
    def n(self) -> int:
        """Return the number of rows."""
        return len(self)

    @property
    def has_time(self) -> bool:
        """Return whether the rows are a time series."""
        return self.time is not None

    @property
    def channels(self) -> tuple[str, ...]:
        """Return those of force and diameter that were measured in at least one row.

        In an isotonic test, the force was set, and the length takes its place.
        """
        return tuple(name for name in self.model_channels if np.isfinite(getattr(self, name)).any())

    @property
    def model_channels(self) -> tuple[str, str]:
        """Return the channels that a model predicts: force, or length in an isotonic test, and diameter."""
        return ("length" if self.measures_length else "force", "diameter")

    @property
    def usable(self) -> np.ndarray:
        """Return the mask, (n,) bool, of rows with measured pressure and length, which a model needs."""
        return np.isfinite(self.pressure) & np.isfinite(self.length)

    @cached_property
    def is_run_start(self) -> np.ndarray:
        """Return the mask, (n,) bool, of first rows of continuous parts; every row of a static map."""
        if self.time is None:
            return np.ones(self.n, dtype=bool)
        new_cycle = np.r_[False, np.diff(self.cycle) != 0]
        jumps = _find_jumps(self.pressure) | _find_jumps(self.length)
        is_run_start = _find_pauses(self.time) | (new_cycle & jumps)
        is_run_start[:1] = True
        return is_run_start

    @property
    def length_and_pressure(self) -> np.ndarray:
        """Return length, m, and pressure, Pa, (2, n), which reverse at stroke ends; 0 where not measured."""
        return np.nan_to_num(np.stack([self.length, self.pressure]))

    def mark_run_starts(self, is_run_start: np.ndarray) -> Recording:
        """Return a copy whose continuous parts are known, where its rows do not show them.

        Args:
            is_run_start: (n,) whether a continuous part begins at a row.
        """
        marked = replace(self)
        # A cached property reads its value from here.
        vars(marked)["is_run_start"] = is_run_start
        return marked

    def select(self, mask: np.ndarray) -> Recording:
        """Return the rows of a mask or of row indices; they keep their line numbers."""
        columns = {
            name: getattr(self, name)[mask] for name in (*DISPLAY_UNIT, "cycle", "row") if name != "time"
        }
        time = None if self.time is None else self.time[mask]
        kept_rows = set(columns["row"].tolist())
        outliers = tuple(o for o in self.outliers if o.row in kept_rows)
        return Recording(time=time, **columns, outliers=outliers, measures_length=self.measures_length)

    def blank_cells(self, cells: dict[str, np.ndarray], outliers: tuple[Outlier, ...]) -> Recording:
        """Return a copy in which the masked cells of each named column are not measured."""
        new_columns = {name: np.where(mask, np.nan, getattr(self, name)) for name, mask in cells.items()}
        return replace(self, **new_columns, outliers=self.outliers + outliers)

    def to_frame(self) -> pd.DataFrame:
        """Return the recording as a table with headers "name [unit]", as in recording.csv."""
        import pandas as pd

        table = {
            f"{name} [{unit}]": getattr(self, name) / compute_si_factor(unit)
            for name, unit in DISPLAY_UNIT.items()
            if name in ("pressure", "length", *(("force",) if self.measures_length else ()), *self.channels)
            or (name == "time" and self.has_time)
        }
        return pd.DataFrame({**table, "cycle": self.cycle})


def _find_pauses(time: np.ndarray) -> np.ndarray:
    """Return the rows, (n,) bool, before which time decreases or has a long step."""
    step = np.diff(time)
    if not len(step):
        return np.zeros(len(time), dtype=bool)
    median_step = np.median(step[step > 0]) if (step > 0).any() else np.inf
    previous_step = np.r_[median_step, step[:-1]]
    # Some logs increase the time step during a hold. A pause is much longer than the previous step, too.
    return np.r_[False, (step <= 0) | (step > _MIN_PAUSE_STEPS * np.maximum(median_step, previous_step))]


def _find_jumps(channel: np.ndarray) -> np.ndarray:
    """Return the rows, (n,) bool, before which a channel has a single large step."""
    measured = np.flatnonzero(np.isfinite(channel))
    jumps = np.zeros(len(channel), dtype=bool)
    if len(measured) < 2:
        return jumps
    step = np.abs(np.diff(channel[measured]))
    neighbour_step = np.maximum(np.r_[0.0, step[:-1]], np.r_[step[1:], 0.0])
    is_large = step > _MIN_JUMP_SHARE * np.ptp(channel[measured])
    jumps[measured[1:]] = is_large & (step > _MIN_JUMP_TO_NEIGHBOUR * neighbour_step)
    return jumps
