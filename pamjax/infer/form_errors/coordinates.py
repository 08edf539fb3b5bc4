"""The variables of a recording on which form errors and unknown physics may depend, scaled to order one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import eval_legendre

from pamjax.records.recording import Recording

#: Share of the median speed below which a row counts as a hold rather than as motion.
_HOLD_SPEED_SHARE = 0.5

#: Smallest speed over the median speed whose logarithm is taken.
_MIN_SPEED_RATIO = 1e-2

#: Share of the largest effect from which a mechanism acts in a row.
_MIN_ACTING_SHARE = 0.03


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Scaled variables of each row, (n,); `time` is None without a time column."""

    pressure: np.ndarray
    length: np.ndarray
    force: np.ndarray
    direction: np.ndarray
    speed: np.ndarray
    time: np.ndarray | None

    @classmethod
    def from_recording(cls, recording: Recording, is_compared: np.ndarray, rate: np.ndarray) -> Coordinates:
        """Return the coordinates of a recording.

        Args:
            recording: its rows.
            is_compared: (n,) whether a row has a sample that is compared with the model.
            rate: (n,) rate of change of the length, m/s.
        """
        rate = np.where(np.isfinite(rate), rate, 0.0)
        moving = np.abs(rate[rate != 0])
        typical = float(np.median(moving)) if moving.size else 1.0
        speed = np.log10(np.abs(rate) / typical + _MIN_SPEED_RATIO)
        time = recording.time
        return cls(
            pressure=_scale(recording.pressure, is_compared),
            length=_scale(recording.length, is_compared),
            force=_scale(np.nan_to_num(recording.force), is_compared),
            direction=np.tanh(rate / (_HOLD_SPEED_SHARE * typical)),
            speed=speed - speed[is_compared].mean(),
            time=None if time is None else (time - time[0]) / max(float(np.ptp(time)), 1e-9),
        )

    def rescale(self, effect: np.ndarray) -> Coordinates:
        """Return the coordinates with pressure and length scaled to the rows in which an effect (n,) acts."""
        size = np.abs(effect)
        acts = size > _MIN_ACTING_SHARE * size.max(initial=0.0)
        if not acts.any():
            return self
        return replace(self, pressure=_scale(self.pressure, acts), length=_scale(self.length, acts))

    def evaluate_power(self, variable: str, degree: int) -> np.ndarray:
        """Return one factor of a term, (n,); a course in time is zero where no time is recorded."""
        if variable == "time":
            return np.zeros(self.pressure.size) if self.time is None else np.cos(np.pi * degree * self.time)
        values = getattr(self, variable)
        return (
            eval_legendre(degree, values)
            if variable in ("pressure", "length", "force")
            else np.power(values, degree)
        )

    def evaluate_term(self, factors: list[tuple[str, int]]) -> np.ndarray:
        """Return the product of some factors, (n,)."""
        return np.prod(np.stack([self.evaluate_power(*factor) for factor in factors]), axis=0)


def _scale(values: np.ndarray, is_compared: np.ndarray) -> np.ndarray:
    low, high = float(np.min(values[is_compared])), float(np.max(values[is_compared]))
    return np.clip(2 * (values - low) / max(high - low, 1e-12) - 1, -1.0, 1.0)
