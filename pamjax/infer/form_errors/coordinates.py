"""The variables of a recording on which form errors and unknown physics may depend, scaled to order one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.records.recording import Recording

#: Share of the median speed below which a row counts as a hold rather than as motion.
_HOLD_SPEED_SHARE = 0.5

#: Smallest speed over the median speed whose logarithm is taken.
_MIN_SPEED_RATIO = 1e-2

#: Share of the largest effect from which a mechanism acts in a row.
_MIN_ACTING_SHARE = 0.03

#: Lowest and highest value of a variable.
Limits = tuple[float, float]


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
        limits, time = CoordinateScales.from_recording(recording, is_compared, rate), recording.time
        coordinates = limits.scale_rows(
            recording.pressure, recording.length, np.nan_to_num(recording.force), rate
        )
        if time is None:
            return coordinates
        return replace(coordinates, time=(time - time[0]) / max(float(np.ptp(time)), 1e-9))

    def rescale(self, effect: np.ndarray) -> Coordinates:
        """Return the coordinates with pressure and length scaled to the rows in which an effect (n,) acts."""
        acts = find_acting_rows(effect)
        if not acts.any():
            return self
        return replace(
            self,
            pressure=_scale(self.pressure, _find_limits(self.pressure[acts])),
            length=_scale(self.length, _find_limits(self.length[acts])),
        )

    def evaluate_power(self, variable: str, degree: int) -> np.ndarray:
        """Return one factor of a term, (n,); a course in time is zero where no time is recorded."""
        from scipy.special import eval_legendre

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


@dataclass(frozen=True)
class CoordinateScales:
    """Constants that scale the variables of any rows as those of the recording of a fit.

    Attributes:
        pressure, length, force: limits, Pa, m and N; a value outside them counts as the limit.
        typical_speed: median speed of the rows that move, m/s.
        mean_speed: mean decimal logarithm of the speed over its median.
        speed: limits of the scaled speed.
    """

    pressure: Limits
    length: Limits
    force: Limits
    typical_speed: float
    mean_speed: float
    speed: Limits = (-np.inf, np.inf)

    @classmethod
    def from_recording(
        cls, recording: Recording, is_compared: np.ndarray, rate: np.ndarray
    ) -> CoordinateScales:
        """Return the constants of a recording; arguments as of `Coordinates.from_recording`."""
        moving = np.abs(rate[np.isfinite(rate) & (rate != 0)])
        typical = float(np.median(moving)) if moving.size else 1.0
        speed = _compute_log_speed(rate, typical)
        mean = float(speed[is_compared].mean())
        return cls(
            pressure=_find_limits(recording.pressure[is_compared]),
            length=_find_limits(recording.length[is_compared]),
            force=_find_limits(np.nan_to_num(recording.force)[is_compared]),
            typical_speed=typical,
            mean_speed=mean,
            speed=_find_limits(speed - mean),
        )

    def scale_rows(
        self, pressure: np.ndarray, length: np.ndarray, force: np.ndarray, rate: np.ndarray
    ) -> Coordinates:
        """Return the coordinates of rows of any recording, without time.

        Args:
            pressure, length, force: (n,) Pa, m and N.
            rate: (n,) rate of change of the length, m/s.
        """
        speed = _compute_log_speed(rate, self.typical_speed) - self.mean_speed
        return Coordinates(
            pressure=_scale(pressure, self.pressure),
            length=_scale(length, self.length),
            force=_scale(force, self.force),
            direction=np.tanh(_replace_unknown(rate) / (_HOLD_SPEED_SHARE * self.typical_speed)),
            speed=np.clip(speed, *self.speed),
            time=None,
        )

    def restrict(self, pressure: np.ndarray, length: np.ndarray, effect: np.ndarray) -> CoordinateScales:
        """Return the limits with those of pressure and length where an effect acts; see `rescale`.

        Args:
            pressure, length: (n,) Pa and m.
            effect: (n,) effect in the same rows.
        """
        acts = find_acting_rows(effect) & np.isfinite(pressure) & np.isfinite(length)
        if not acts.any():
            return self
        # Limits of the values themselves: those of scaled values differ by rounding, which counts if they
        # are equal.
        return replace(
            self,
            pressure=_find_limits(np.clip(pressure[acts], *self.pressure)),
            length=_find_limits(np.clip(length[acts], *self.length)),
        )


def find_acting_rows(effect: np.ndarray) -> np.ndarray:
    """Return whether an effect acts in a row, (n,)."""
    size = np.abs(effect)
    return size > _MIN_ACTING_SHARE * size.max(initial=0.0)


def _replace_unknown(rate: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(rate), rate, 0.0)


def _compute_log_speed(rate: np.ndarray, typical_speed: float) -> np.ndarray:
    return np.log10(np.abs(_replace_unknown(rate)) / typical_speed + _MIN_SPEED_RATIO)


def _find_limits(values: np.ndarray) -> Limits:
    return float(np.min(values)), float(np.max(values))


def _scale(values: np.ndarray, limits: Limits) -> np.ndarray:
    """Return values scaled to −1 to 1; −1 for a missing value, and everywhere for equal limits."""
    low, high = limits
    clipped = np.clip(np.where(np.isfinite(values), values, low), low, high)
    return 2 * (clipped - low) / max(high - low, 1e-12) - 1
