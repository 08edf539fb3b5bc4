"""Size of an effect: its rms after a refit of the baseline, over effective noise.

With y the readings with an effect, y0 those without, f the baseline at the recorded inputs u and u0:

    d = (y − f(u)) − (y0 − f(u0)),      effect = d − [f(u; β) − f(u)],   β = argmin |(d − Δf)/σ|² + |Δβ/sd|²

    σ² = σ_sensor² + (∂f/∂P σ_P)² + (∂f/∂L σ_L)²

The size is the larger rms of force and diameter, without the largest 1 % of the squares. β are thread length,
turns and, for an elastic baseline, stiffness, with their stated sd as prior.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pamjax.benchmark.other_forms.drawn_form import DrawnForm
from pamjax.benchmark.other_forms.muscle import (
    BenchPlan,
    Effect,
    Readings,
    TrueBraid,
    apply_to_readings,
    simulate_effects,
)
from pamjax.records.reading.muscle_toml import Sensors

#: Iterations of a refit, and of an amplitude.
_REFIT_ROUNDS, _SCALING_ROUNDS = 3, 25

#: Relative error of a size at which its search ends, and largest one that is accepted.
_EFFECT_SIZE_TOLERANCE, _MAX_SIZE_ERROR = 0.03, 0.1

#: Relative step of derivatives of the baseline.
_BASELINE_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class BaselineFit:
    """The baseline of a recording, and the noise against which an effect is measured.

    Attributes:
        braid: the true braid.
        plan: the plan of the bench.
        sensors: true noise of the sensors, SI.
        prior_sd: sd of thread length (m), turns, and stiffness (N; 0 for an inelastic baseline).
        diameter_rows: (n,) whether the diameter is measured.
    """

    braid: TrueBraid
    plan: BenchPlan
    sensors: Sensors
    prior_sd: tuple[float, float, float]
    diameter_rows: np.ndarray

    def simulate(self, effects: Sequence[Effect]) -> Readings:
        """Return the readings with some effects, without noise."""
        return apply_to_readings(simulate_effects(self.braid, self.plan, effects), effects)

    def predict(self, pressure: np.ndarray, length: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return force and diameter, (2, n), of the baseline with changed parameters, in prior sd."""
        thread = self.braid.thread + change[0] * self.prior_sd[0]
        turns = self.braid.turns + change[1] * self.prior_sd[1]
        compliance = self.braid.compliance
        if len(change) > 2:
            compliance = compliance / max(1 + change[2] * self.prior_sd[2] * compliance, 0.1)
        stretched_thread = thread / (1 - compliance * pressure * length * thread / (2 * np.pi * turns**2))
        force = pressure * (3 * length**2 - stretched_thread**2) / (4 * np.pi * turns**2)
        diameter = np.sqrt(np.maximum(stretched_thread**2 - length**2, 0.0)) / (np.pi * turns)
        return np.stack([np.maximum(force, 0.0), diameter])

    @property
    def parameter_count(self) -> int:
        """Return the number of free parameters of the baseline."""
        return 3 if self.braid.compliance > 0 and self.prior_sd[2] > 0 else 2

    def compute_noise(self, pressure: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Return the effective noise of every sample, (2, n), SI."""
        zero, sensors = np.zeros(self.parameter_count), self.sensors
        steps = _BASELINE_STEP * np.max(pressure), _BASELINE_STEP * self.braid.rest_length
        by_pressure = self.predict(pressure + steps[0], length, zero) - self.predict(
            pressure - steps[0], length, zero
        )
        by_length = self.predict(pressure, length + steps[1], zero) - self.predict(
            pressure, length - steps[1], zero
        )
        own = np.array([[sensors.force or 0.0], [sensors.diameter or 0.0]])
        return np.sqrt(
            own**2
            + (by_pressure / (2 * steps[0]) * (sensors.pressure or 0.0)) ** 2
            + (by_length / (2 * steps[1]) * (sensors.length or 0.0)) ** 2
        )

    def compute_effect(self, readings: Readings, without: Readings) -> np.ndarray:
        """Return the effect that a refit of the baseline leaves, (2, n), over noise; NaN where not used."""
        zero = np.zeros(self.parameter_count)
        own = self.predict(readings.pressure, readings.length, zero)
        difference = (
            np.stack([readings.force, readings.diameter])
            - own
            - np.stack([without.force, without.diameter])
            + self.predict(without.pressure, without.length, zero)
        )
        is_used = np.stack(
            [
                (readings.force > 0) | (without.force > 0),
                self.diameter_rows & (readings.pressure > 3 * (self.sensors.pressure or 0.0)),
            ]
        )
        noise = self.compute_noise(readings.pressure, readings.length)
        standard = np.where(is_used, difference / noise, 0.0)
        shift = self._refit(readings, own, standard, is_used / noise)
        return np.where(is_used, standard - shift, np.nan)

    def _refit(
        self, readings: Readings, own: np.ndarray, standard: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """Return the change of the baseline that fits an effect best, (2, n), over noise."""
        change, shift = np.zeros(self.parameter_count), np.zeros_like(standard)

        def predict(change: np.ndarray) -> np.ndarray:
            return weight * (self.predict(readings.pressure, readings.length, change) - own)

        for _ in range(_REFIT_ROUNDS):
            columns = [
                (predict(change + step) - predict(change - step)).ravel() / 0.02
                for step in 0.01 * np.eye(change.size)
            ]
            jacobian = np.concatenate([np.stack(columns, axis=1), np.eye(change.size)])
            residual = np.concatenate([(standard - shift).ravel(), -change])
            change = change + np.linalg.lstsq(jacobian, residual, rcond=None)[0]
            shift = predict(change)
        return shift


def compute_size(effect: np.ndarray) -> float:
    """Return the larger rms of force and diameter of an effect over noise, (2, n), NaN where not used.

    The largest 1 % of the squares is removed, because a few samples next to slack rows are no effect.
    """
    sizes = []
    for channel in effect:
        squares = np.sort(channel[np.isfinite(channel)] ** 2)
        kept_squares = squares[: squares.size - squares.size // 100]
        sizes.append(float(np.sqrt(np.mean(kept_squares))) if kept_squares.size else 0.0)
    return max(sizes)


def scale_to_size(
    form: DrawnForm, sign: float, target: float, measure: Callable[[Effect], float]
) -> float | None:
    """Return the amplitude at which an effect has its target size; None if it reaches the size nowhere.

    Args:
        form: the form without its size.
        sign: sign of the amplitude, ±1.
        target: target size.
        measure: function that returns the size of an effect.
    """
    low, high, amplitude = 0.0, form.limit, 1e-3 * form.limit
    best, least = None, _MAX_SIZE_ERROR
    for _ in range(_SCALING_ROUNDS if form.limit > 0 else 0):
        size = measure(form.build(sign * amplitude))
        error = abs(math.log(max(size, 1e-12) / target)) if math.isfinite(size) else math.inf
        if error < least:
            best, least = sign * amplitude, error
        if error < _EFFECT_SIZE_TOLERANCE:
            break
        is_small = math.isfinite(size) and size < target
        low, high = (amplitude, high) if is_small else (low, amplitude)
        if high - low < 1e-6 * high:
            break
        step = amplitude * float(np.clip(target / max(size, 1e-12), 1e-3, 1e3))
        if is_small and step >= high == form.limit and amplitude < high:
            amplitude = high
        else:
            amplitude = step if low < step < high else 0.5 * (low + high)
    return best
