"""Distributions of the forms of effects of the braid: locking, ends, crimp, stretch and slip of the threads.

They are part of the list in `library.py`, which explains the abbreviations.
"""

from __future__ import annotations

import numpy as np

from pamjax.benchmark.other_forms import braid_forms
from pamjax.benchmark.other_forms.drawn_form import DrawnForm
from pamjax.benchmark.other_forms.muscle import Effect
from pamjax.benchmark.other_forms.scales import BenchScales, draw_log_uniform


def draw_locking_extension(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return locking below a contraction U(0.1, 0.35) of the largest, with exponent U(1, 3)."""
    start, exponent = s.max_contraction * rng.uniform(0.1, 0.35), rng.uniform(1.0, 3.0)
    return DrawnForm(
        "braid_locking", "extension", "stiffness", 1e9,
        lambda a: Effect(energy=braid_forms.lock_extension(s.braid, a, start, exponent)),
        {"start": start, "exponent": exponent},
    )  # fmt: skip


def draw_locking_angle(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return locking from the angle at a contraction U(0.1, 0.35) of the largest, with exponent U(1, 3)."""
    length = s.braid.rest_length * (1 - s.max_contraction * rng.uniform(0.1, 0.35))
    start, exponent = float(np.arcsin(length / s.braid.thread)), rng.uniform(1.0, 3.0)
    return DrawnForm(
        "braid_locking", "angle", "stiffness", 1e9,
        lambda a: Effect(energy=braid_forms.lock_angle(a, start, exponent)),
        {"start": start, "exponent": exponent},
    )  # fmt: skip


def draw_cone(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return conical ends, without shape parameter."""
    return _build_taper("cone", s, braid_forms.taper_as_cone)


def draw_clamp(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return clamped ends, without shape parameter."""
    return _build_taper("clamp", s, braid_forms.taper_as_clamp)


def draw_parabola(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return parabolic ends, without shape parameter."""
    return _build_taper("parabola", s, braid_forms.taper_as_parabola)


def _build_taper(form: str, s: BenchScales, taper) -> DrawnForm:
    return DrawnForm(
        "end_taper", form, "height", 0.25 * s.braid.rest_length, lambda a: taper(a, s.fitting_radius),
        {"radius": s.fitting_radius},
    )  # fmt: skip


def draw_crimp_corner(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return crimp with a corner at a load LU(0.08, 0.7) of the largest."""
    return _build_crimp("corner", s, rng, braid_forms.uncrimp_with_corner)


def draw_crimp_recruitment(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return crimp with recruitment at a load LU(0.08, 0.7) of the largest."""
    return _build_crimp("recruitment", s, rng, braid_forms.uncrimp_by_recruitment)


def _build_crimp(form: str, s: BenchScales, rng: np.random.Generator, uncrimp) -> DrawnForm:
    corner = s.max_load * draw_log_uniform(rng, 0.08, 0.7)
    return DrawnForm(
        "thread_crimp", form, "crimp", 0.03, lambda a: Effect(strain=lambda load: uncrimp(load, a, corner)),
        {"load": corner},
    )  # fmt: skip


def draw_power_stretch(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a stretch by a power of the load, with exponent U(0.5, 0.75)."""
    exponent = rng.uniform(0.5, 0.75)
    return DrawnForm(
        "braid_elasticity", "power", "strain", 0.05,
        lambda a: Effect(strain=lambda load: braid_forms.stretch_by_power(load, a, s.max_load, exponent)),
        {"load": s.max_load, "exponent": exponent},
    )  # fmt: skip


def draw_two_slips(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return two slips between 10 and 90 % of the time, with share of the first U(0.3, 0.7)."""
    first, second = sorted(s.draw_moment(rng) for _ in range(2))
    share = rng.uniform(0.3, 0.7)

    def build(amplitude: float) -> Effect:
        return Effect(
            extension=lambda path: braid_forms.slip_twice(path.time, amplitude, share, (first, second))
        )

    shape = {"first": first, "second": second, "share": share}
    return DrawnForm("thread_slip", "two steps", "strain", 0.03, build, shape)


def draw_power_bedding(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return bedding by a power of the load, with exponent U(1.5, 3)."""
    exponent = rng.uniform(1.5, 3.0)
    return DrawnForm(
        "thread_slip", "power bedding", "strain", 0.03,
        lambda a: Effect(extension=lambda path: braid_forms.bed_in_by_power(path.load, a, exponent)),
        {"exponent": exponent},
    )  # fmt: skip
