"""Families of effects outside the library, each with its equation and its distribution.

The diagnosis has templates of the first eight, and none of the last three.

U is a uniform and LU a log-uniform distribution; T is the duration of the recording.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pamjax.benchmark.other_forms import sensor_forms
from pamjax.benchmark.other_forms.drawn_form import DrawnForm, FormDrawer
from pamjax.benchmark.other_forms.muscle import Effect, MusclePath, Readings
from pamjax.benchmark.other_forms.scales import BenchScales, draw_log_uniform


def press_on_stop(contraction: np.ndarray, start: float) -> np.ndarray:
    """Return ⟨x − x0⟩, the travel past a stop in the way at the contraction x0; the force is K times it.

    Zero before the stop. The load cell carries the stop as well, so that it reads more.
    """
    return np.maximum(contraction - start, 0.0)


def clip_force(force: np.ndarray, level: float) -> np.ndarray:
    """Return min(F, Fmax), the reading of a load cell that clips at a level, N."""
    return np.minimum(force, level)


def repeat_reading(values: np.ndarray, first: int, count: int) -> np.ndarray:
    """Return the channel with the reading of row `first` repeated in the next `count` rows."""
    out = values.copy()
    out[first : first + count + 1] = values[first]
    return out


def _break_threads(path: MusclePath, compliance: float, share: float, moment: float) -> np.ndarray:
    """Return the extension C T s/(1 − s) after a moment, when a share s of the threads carries no load.

    The others carry the load T, N; C is the compliance of all threads, 1/N. Zero before.
    """
    return np.where(path.time >= moment, compliance * path.load * share / (1 - share), 0.0)


def _draw_stop(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a stop from a contraction U(0.4, 0.75) of the largest."""
    start = s.max_contraction * rng.uniform(0.4, 0.75)

    def build(amplitude: float) -> Effect:
        return Effect(
            force=lambda path: amplitude * press_on_stop(1 - path.length / s.braid.rest_length, start)
        )

    return DrawnForm("stop", "linear", "stiffness", 1e9, build, {"start": start})


def _draw_clipping(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return clipping; the amplitude is the share of the highest force that is cut off, at most 0.7."""

    def build(amplitude: float) -> Effect:
        level = (1 - amplitude) * s.max_force
        return Effect(readings=lambda r: dataclasses.replace(r, force=clip_force(r.force, level)))

    return DrawnForm("clipping", "hard", "share", 0.7, build)


def _draw_zero_step(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a step of the zero of force, pressure or length, with equal chances.

    Its moment is between 10 and 90 % of the time.
    """
    channel, moment = str(rng.choice(["force", "pressure", "length"])), s.draw_moment(rng)
    limit = {"force": s.max_force, "pressure": 0.5 * s.max_pressure, "length": 0.05 * s.braid.rest_length}
    after = s.plan.time >= moment
    return DrawnForm(
        "zero_step", channel, "step", limit[channel], lambda a: sensor_forms.offset_rows(after, channel, a),
        {"moment": moment}, is_signed=True,
    )  # fmt: skip


def _draw_stuck(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a repeated reading of force or length (force at fixed lengths) from U(0.1, 0.7) T.

    The amplitude is the share of the time that the reading repeats, at most 0.25.
    """
    channel = "force" if s.is_isometric else str(rng.choice(["force", "length"]))
    count = s.plan.time.size
    first = int(count * rng.uniform(0.1, 0.7))

    def build(amplitude: float) -> Effect:
        def repeat(readings: Readings) -> Readings:
            values = repeat_reading(getattr(readings, channel), first, round(amplitude * count))
            return dataclasses.replace(readings, **{channel: values})

        return Effect(readings=repeat)

    return DrawnForm("stuck", channel, "share", 0.25, build, {"first_row": float(first)})


def _draw_ripple(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a ripple with wavelength LU(0.01, 0.05) of the rest length and phase U(0, 2π).

    It is proportional to force, or constant.
    """
    wavelength, phase = s.braid.rest_length * draw_log_uniform(rng, 0.01, 0.05), rng.uniform(0, 2 * np.pi)
    is_proportional = bool(rng.random() < 0.5)

    def build(amplitude: float) -> Effect:
        def compute_force(path: MusclePath) -> np.ndarray:
            wave = amplitude * np.sin(2 * np.pi * path.length / wavelength + phase)
            return wave * path.force / s.max_force if is_proportional else wave

        return Effect(force=compute_force)

    form = "proportional" if is_proportional else "constant"
    limit = 0.0 if s.is_isometric else s.max_force
    shape = {"wavelength": wavelength, "phase": phase}
    return DrawnForm("ripple", form, "force", limit, build, shape)


def _draw_interference(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return interference with period LU(4, 200) time steps and phase U(0, 2π)."""
    period, phase = s.step * draw_log_uniform(rng, 4.0, 200.0), rng.uniform(0, 2 * np.pi)
    wave = np.sin(2 * np.pi * s.plan.time / period + phase)
    return DrawnForm(
        "interference", "sine", "force", s.max_force, lambda a: sensor_forms.add_force(a * wave),
        {"period": period, "phase": phase},
    )  # fmt: skip


def _draw_single_block(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return an error of length (a slipped clamp) or force in one isobar or length.

    The block and the channel have equal chances.
    """
    block = int(rng.choice(np.unique(s.block[s.block >= 0])))
    channel = str(rng.choice(["length", "force"]))
    limit = {"force": s.max_force, "length": 0.05 * s.braid.rest_length}
    return DrawnForm(
        "single_block", channel, "offset", limit[channel],
        lambda a: sensor_forms.offset_rows(s.block == block, channel, a), {"block": float(block)},
        is_signed=True,
    )  # fmt: skip


def _draw_thread_break(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a break of threads between 10 and 90 % of the time.

    Force and stiffness lose the same share, at most 0.5.
    """
    moment = s.draw_moment(rng)

    def build(amplitude: float) -> Effect:
        def lose(path: MusclePath, force: np.ndarray, diameter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.where(path.time >= moment, 1 - amplitude, 1.0) * force, diameter

        return Effect(
            outputs=lose,
            extension=lambda path: _break_threads(path, s.braid.compliance, amplitude, moment),
        )

    return DrawnForm("thread_break", "step", "share", 0.5, build, {"moment": moment})


def compute_fold(contraction: np.ndarray, centre: float, width: float) -> np.ndarray:
    """Return exp(−((x − x0)/w)²/2), the force of a fold in the bladder over that at its centre."""
    return np.exp(-0.5 * ((contraction - centre) / width) ** 2)


def compute_ringing(time: np.ndarray, start_times: np.ndarray, period: float, decay: float) -> np.ndarray:
    """Return exp(−s/τ) sin(2πs/T) with the time s since the last start; zero before the first one."""
    if not start_times.size:
        return np.zeros_like(time)
    last = np.searchsorted(start_times, time, side="right") - 1
    since = time - start_times[np.maximum(last, 0)]
    return np.where(last >= 0, np.exp(-since / decay) * np.sin(2 * np.pi * since / period), 0.0)


def find_reversals(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the times at which a channel changes its direction, s."""
    rates = np.diff(values)
    moving = np.flatnonzero(rates)
    turns = moving[1:][np.diff(np.sign(rates[moving])) != 0]
    return time[turns]


def _draw_fold(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a fold at U(0.3, 0.8) of the largest contraction, with a width LU(0.03, 0.12) of it."""
    centre = s.max_contraction * rng.uniform(0.3, 0.8)
    width = s.max_contraction * draw_log_uniform(rng, 0.03, 0.12)

    def build(amplitude: float) -> Effect:
        return Effect(
            force=lambda path: amplitude * compute_fold(1 - path.length / s.braid.rest_length, centre, width)
        )

    limit = 0.0 if s.is_isometric else s.max_force
    shape = {"centre": centre, "width": width}
    return DrawnForm("fold", "bump", "force", limit, build, shape, is_signed=True)


def _draw_ringing(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return an oscillation of the rig after each reversal, of period LU(4, 20) steps.

    It decays within U(1, 3) periods. At a fixed length the pressure reverses.
    """
    period = s.step * draw_log_uniform(rng, 4.0, 20.0)
    decay = period * rng.uniform(1.0, 3.0)
    driven = s.plan.pressure if s.is_isometric else s.plan.length
    course = compute_ringing(s.plan.time, find_reversals(s.plan.time, driven), period, decay)
    shape = {"period": period, "decay": decay}
    return DrawnForm(
        "ringing", "decaying", "force", s.max_force, lambda a: sensor_forms.add_force(a * course), shape
    )


def _draw_gain_cycle(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a force gain that follows a sine of period U(0.3, 1.2) T, as with the temperature of a room."""
    period, phase = s.duration * rng.uniform(0.3, 1.2), rng.uniform(0, 2 * np.pi)
    wave = np.sin(2 * np.pi * s.plan.time / period + phase)

    def build(amplitude: float) -> Effect:
        return Effect(outputs=lambda path, force, diameter: ((1 + amplitude * wave) * force, diameter))

    return DrawnForm("gain_cycle", "sine", "share", 0.5, build, {"period": period, "phase": phase})


#: Families outside the library.
OUTSIDE_FAMILIES: dict[str, FormDrawer] = {
    "stop": _draw_stop,
    "clipping": _draw_clipping,
    "zero_step": _draw_zero_step,
    "stuck": _draw_stuck,
    "ripple": _draw_ripple,
    "interference": _draw_interference,
    "single_block": _draw_single_block,
    "thread_break": _draw_thread_break,
    "fold": _draw_fold,
    "ringing": _draw_ringing,
    "gain_cycle": _draw_gain_cycle,
}
