"""Eight families of effects outside the library, each with its equation and its distribution.

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
}
