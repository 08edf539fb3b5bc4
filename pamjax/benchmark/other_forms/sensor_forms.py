"""Other forms of the drift of a load cell, and the usual forms of offsets, gains and delay."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pamjax.benchmark.other_forms.muscle import BenchPlan, Effect, MusclePath, split_runs


def compute_warm_up(time: np.ndarray, time_constant: float) -> np.ndarray:
    """Return 1 − e^(−t/τ): a load cell that warms up after it is switched on.

    t is counted from the first sample, τ in s. Zero at t = 0, one for t → ∞.
    Source: first-order heat balance of the cell.
    """
    return -np.expm1(-(time - time[0]) / time_constant)


def compute_square_root(time: np.ndarray) -> np.ndarray:
    """Return sqrt(t/T), T the duration: heat that diffuses into a thick body.

    Zero at t = 0, one at the end. Source: heat conduction into a half space.
    """
    return np.sqrt((time - time[0]) / (time[-1] - time[0]))


def compute_slow_sine(time: np.ndarray, period: float, phase: float) -> np.ndarray:
    """Return sin(2πt/p + φ) − sin φ: a room whose temperature goes up and down with period p, s.

    Zero at t = 0. Source: periodic heating; no measurement.
    """
    return np.sin(2 * np.pi * (time - time[0]) / period + phase) - np.sin(phase)


def draw_wander(time: np.ndarray, width_share: float, rng: np.random.Generator) -> np.ndarray:
    """Return a smooth random walk, zero at t = 0, with rms one.

    A random walk is averaged with a Gaussian window of sd `width_share` times the duration.
    Source: flicker noise of amplifiers, as a random walk.
    """
    walk = gaussian_filter1d(
        np.cumsum(rng.standard_normal(time.size)), width_share * time.size, mode="nearest"
    )
    walk = walk - walk[0]
    return walk / np.sqrt(np.mean(walk**2))


def add_force(course: np.ndarray) -> Effect:
    """Return an error that is added to the recorded force, (n,) N."""
    return Effect(outputs=lambda path, force, diameter: (force + course, diameter))


def offset_force(offset: float) -> Effect:
    """Return an offset of force, recorded minus true, N."""
    return Effect(outputs=lambda path, force, diameter: (force + offset, diameter))


def scale_force(gain: float) -> Effect:
    """Return a relative error of force, recorded over true minus one."""
    return Effect(outputs=lambda path, force, diameter: ((1 + gain) * force, diameter))


def offset_diameter(offset: float) -> Effect:
    """Return an offset of diameter, recorded minus true, m."""
    return Effect(outputs=lambda path, force, diameter: (force, diameter + offset))


def offset_pressure(offset: float) -> Effect:
    """Return an offset of pressure, recorded minus true, Pa."""
    return Effect(inputs=lambda plan: (plan.pressure + offset, plan.length))


def scale_pressure(gain: float) -> Effect:
    """Return a relative error of pressure, recorded over true minus one."""
    return Effect(inputs=lambda plan: ((1 + gain) * plan.pressure, plan.length))


def offset_length(offset: float) -> Effect:
    """Return an offset of length, recorded minus true, m."""
    return Effect(inputs=lambda plan: (plan.pressure, plan.length + offset))


def delay_force(lag: float) -> Effect:
    """Return a delay of the force, F_recorded(t) = F(t − lag), linear between samples, lag in s."""

    def delay(path: MusclePath, force: np.ndarray, diameter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out = force.copy()
        for run in split_runs(path.starts):
            out[run] = np.interp(path.time[run] - lag, path.time[run], force[run])
        return out, diameter

    return Effect(outputs=delay)


def offset_rows(effect_rows: np.ndarray, channel: str, offset: float) -> Effect:
    """Return an offset of one channel, SI, in the rows of a mask, (n,)."""
    shift = np.where(effect_rows, offset, 0.0)
    if channel == "force":
        return add_force(shift)

    def shift_inputs(plan: BenchPlan) -> tuple[np.ndarray, np.ndarray]:
        new_plan = dataclasses.replace(plan, **{channel: getattr(plan, channel) + shift})
        return new_plan.pressure, new_plan.length

    return Effect(inputs=shift_inputs)
