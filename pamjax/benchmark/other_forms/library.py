"""Distributions of the forms of every mechanism. They are stated here and follow no diagnosis.

Each function draws the shape of one form and returns it without a size. U is a uniform and LU a log-uniform
distribution. Shapes are relative to the recording: duration T, stroke, highest pressure, force and load.
A form that the bench cannot show, for example damping at fixed lengths, never reaches its size and is
replaced by another mechanism.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pamjax.benchmark.other_forms import braid_drawers, friction_forms, rig_forms, rubber_forms, sensor_forms
from pamjax.benchmark.other_forms.drawn_form import DrawnForm, FormDrawer
from pamjax.benchmark.other_forms.muscle import Effect, MusclePath, compute_rate
from pamjax.benchmark.other_forms.scales import BenchScales, compute_volume, draw_log_uniform

#: Largest pressure drop per unit of flow, Pa s/m³: that of the fit.
_MAX_IMPEDANCE = 1e11


def _draw_drift_warm_up(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a drift that warms up with time constant LU(0.05, 0.5) T."""
    constant = s.duration * draw_log_uniform(rng, 0.05, 0.5)
    course = sensor_forms.compute_warm_up(s.plan.time, constant)
    return _build_drift("warm-up", course, {"time_constant": constant})


def _draw_drift_square_root(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a drift with the square root of time, without shape parameter."""
    return _build_drift("square root", sensor_forms.compute_square_root(s.plan.time), {})


def _draw_drift_sine(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a slow sine with period LU(0.7, 4) T and phase U(0, 2π)."""
    shape = {"period": s.duration * draw_log_uniform(rng, 0.7, 4.0), "phase": rng.uniform(0, 2 * np.pi)}
    return _build_drift("slow sine", sensor_forms.compute_slow_sine(s.plan.time, **shape), shape)


def _draw_drift_wander(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return a wandering drift with window LU(0.03, 0.15) T."""
    share = draw_log_uniform(rng, 0.03, 0.15)
    return _build_drift("wander", sensor_forms.draw_wander(s.plan.time, share, rng), {"window": share})


def _build_drift(form: str, course: np.ndarray, shape: dict[str, float]) -> DrawnForm:
    return DrawnForm(
        "force_drift", form, "drift", 1e3, lambda a: sensor_forms.add_force(a * course), shape, is_signed=True
    )


def _draw_stribeck(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return friction that weakens with speed, proportional to pressure.

    Share at high speed U(0.3, 0.8), speed LU(0.3, 3) of the stroke's.
    """
    share, slow = rng.uniform(0.3, 0.8), max(s.speed, 1e-6) * draw_log_uniform(rng, 0.3, 3.0)
    slide, shape = _draw_sliding(rng, s)

    def compute_force(path: MusclePath) -> np.ndarray:
        speed = compute_rate(path.time, path.starts, path.length)
        strength = path.pressure / s.max_pressure * path.length / s.braid.rest_length
        return strength * slide(path) * friction_forms.weaken_with_speed(speed, slow, share)

    return _build_friction("stribeck", compute_force, shape | {"share": share, "speed": slow})


def _draw_one_sided(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return friction in one direction, ±1, proportional to pressure."""
    direction = int(rng.choice([-1, 1]))
    slide, shape = _draw_sliding(rng, s)

    def compute_force(path: MusclePath) -> np.ndarray:
        return path.pressure / s.max_pressure * friction_forms.keep_one_direction(slide(path), direction)

    return _build_friction("one-sided", compute_force, shape | {"direction": float(direction)})


def _draw_pressure_power(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return friction with exponent of pressure U(1.25, 2)."""
    exponent = rng.uniform(1.25, 2.0)
    slide, shape = _draw_sliding(rng, s)

    def compute_force(path: MusclePath) -> np.ndarray:
        return friction_forms.raise_to_power(path.pressure, s.max_pressure, exponent) * slide(path)

    return _build_friction("pressure power", compute_force, shape | {"exponent": exponent})


def _draw_sliding(rng: np.random.Generator, s: BenchScales):
    """Return a function that computes the sliding, and its shape.

    Presliding distance LU(0.004, 0.06) of the travel; pressure moves the braid by LU(5e-4, 5e-3) L0.
    """
    give = draw_log_uniform(rng, 5e-4, 5e-3) * s.braid.rest_length / s.max_pressure
    travel = s.stroke if not s.is_isometric else give * s.max_pressure
    distance = travel * draw_log_uniform(rng, 0.004, 0.06)

    def slide(path: MusclePath) -> np.ndarray:
        return friction_forms.slide_dahl(path.length - give * path.pressure, distance)

    return slide, {"presliding": distance, "give": give}


def _build_friction(form: str, compute_force, shape: dict[str, float]) -> DrawnForm:
    return DrawnForm(
        "braid_friction", form, "force", 500.0,
        lambda a: Effect(force=lambda path: a * compute_force(path)), shape,
    )  # fmt: skip


def _draw_eyring(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return damping that thins at a speed LU(0.03, 1) of the stroke's."""
    slow = max(s.speed, 1e-9) * draw_log_uniform(rng, 0.03, 1.0)
    return _build_damping(
        "eyring", s, lambda velocity: friction_forms.damp_by_eyring(velocity, slow), {"speed": slow}
    )


def _draw_directional(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return damping with share U(0, 0.5) in the weaker direction, ±1."""
    share, direction = rng.uniform(0.0, 0.5), int(rng.choice([-1, 1]))
    reference = max(s.speed, 1e-9)

    def damp(velocity: np.ndarray) -> np.ndarray:
        return friction_forms.damp_by_direction(velocity, reference, share, direction)

    return _build_damping("directional", s, damp, {"share": share, "direction": float(direction)})


def _build_damping(form: str, s: BenchScales, damp, shape: dict[str, float]) -> DrawnForm:
    def build(amplitude: float) -> Effect:
        return Effect(force=lambda path: amplitude * damp(compute_rate(path.time, path.starts, path.length)))

    limit = 0.0 if s.is_isometric else 500.0
    return DrawnForm("viscous_damping", form, "force", limit, build, shape)


def _draw_fractional(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return relaxation of fractional order U(0.2, 0.6)."""
    order = rng.uniform(0.2, 0.6)
    return _build_relaxation(
        "fractional", s, lambda t, x: rubber_forms.relax_by_power_law(t, x, order), {"order": order}
    )


def _draw_kohlrausch(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return relaxation with exponent U(0.3, 0.6) and time LU(0.003, 0.1) T."""
    exponent, constant = rng.uniform(0.3, 0.6), s.duration * draw_log_uniform(rng, 0.003, 0.1)
    return _build_relaxation(
        "stretched exponential", s,
        lambda t, x: rubber_forms.relax_by_stretched_exponential(t, x, constant, exponent),
        {"exponent": exponent, "time_constant": constant},
    )  # fmt: skip


def _build_relaxation(form: str, s: BenchScales, relax, shape: dict[str, float]) -> DrawnForm:
    def build(amplitude: float) -> Effect:
        return Effect(memory=lambda path: rubber_forms.build_relaxation(s.wall, amplitude, path, relax))

    return DrawnForm("viscoelastic_creep", form, "modulus", 5e6, build, shape)


def _draw_yeoh(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the rubber of Yeoh with c2 U(−0.1, 0.2) and c3 = U(0.5, 2) c2²."""
    second = rng.uniform(-0.1, 0.2)
    third = second**2 * rng.uniform(0.5, 2.0)
    return _build_rubber(
        "yeoh",
        lambda a: rubber_forms.build_yeoh(s.wall, a, second, third),
        {"second": second, "third": third},
    )


def _draw_ogden(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the rubber of Ogden with exponent U(3, 6)."""
    exponent = rng.uniform(3.0, 6.0)
    return _build_rubber(
        "ogden", lambda a: rubber_forms.build_ogden(s.wall, a, exponent), {"exponent": exponent}
    )


def _draw_gent(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the rubber of Gent with limit of I1 − 3: U(1.5, 4) times the largest of the recording."""
    thread = np.full_like(s.plan.length, s.braid.thread)
    largest = float(s.wall.compute_first_invariant(s.plan.length, thread).max())
    limit = max(largest, 0.1) * rng.uniform(1.5, 4.0)
    return _build_rubber("gent", lambda a: rubber_forms.build_gent(s.wall, a, limit), {"limit": limit})


def _build_rubber(form: str, build, shape: dict[str, float]) -> DrawnForm:
    return DrawnForm("bladder_elasticity", form, "modulus", 5e6, lambda a: Effect(energy=build(a)), shape)


def _draw_exponential_softening(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return exponential softening with width LU(0.05, 0.4)."""
    width = draw_log_uniform(rng, 0.05, 0.4)
    return _build_softening(
        "exponential", s, lambda e: rubber_forms.soften_exponentially(e, width), {"width": width}
    )


def _draw_travel_softening(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return softening over a share LU(0.1, 0.5) of the travel."""
    share = draw_log_uniform(rng, 0.1, 0.5)
    return _build_softening("travel", s, lambda e: rubber_forms.soften_by_travel(e, share), {"share": share})


def _build_softening(form: str, s: BenchScales, soften, shape: dict[str, float]) -> DrawnForm:
    def build(amplitude: float) -> Effect:
        return Effect(memory=lambda path: rubber_forms.build_softening(s.wall, amplitude, path, soften))

    return DrawnForm("mullins_softening", form, "modulus", 2e6, build, shape)


def _draw_exponential_contact(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return exponential contact loss, without shape parameter."""
    return _build_contact("exponential", rig_forms.lose_exponentially)


def _draw_hyperbolic_contact(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return hyperbolic contact loss, without shape parameter."""
    return _build_contact("hyperbolic", rig_forms.lose_hyperbolically)


def _build_contact(form: str, lose) -> DrawnForm:
    return DrawnForm(
        "contact_pressure", form, "threshold", 2e5,
        lambda a: Effect(pressure_loss=lambda path: lose(path.pressure, a)),
    )  # fmt: skip


def _draw_turbulent_drop(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the pressure drop of a turbulent flow, without shape parameter."""

    def build(amplitude: float) -> Effect:
        return Effect(
            pressure_loss=lambda path: rig_forms.drop_by_turbulence(_compute_flow(s, path), s.flow, amplitude)
        )

    return DrawnForm("pressure_drop", "turbulent", "drop", _limit_drop(s), build, {"flow": s.flow})


def _draw_orifice_drop(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the pressure drop of an orifice, without shape parameter."""

    def build(amplitude: float) -> Effect:
        return Effect(
            pressure_loss=lambda path: rig_forms.drop_by_orifice(
                _compute_flow(s, path), path.pressure, s.flow, amplitude
            )
        )

    return DrawnForm("pressure_drop", "orifice", "drop", _limit_drop(s), build, {"flow": s.flow})


def _limit_drop(s: BenchScales) -> float:
    """Return the largest pressure drop, Pa: without flow there is none."""
    return min(1e5, _MAX_IMPEDANCE * s.flow)


def _compute_flow(s: BenchScales, path: MusclePath) -> np.ndarray:
    return compute_rate(path.time, path.starts, compute_volume(s.braid, path.length, path.thread))


def _draw_hertz_rig(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the deflection of a rig with exponent U(0.5, 0.75)."""
    exponent = rng.uniform(0.5, 0.75)
    return DrawnForm(
        "rig_compliance", "hertz", "deflection", 0.03 * s.braid.rest_length,
        lambda a: Effect(
            deflection=lambda force: rig_forms.deflect_by_hertz(force, a, s.max_force, exponent)
        ),
        {"exponent": exponent, "force": s.max_force},
    )  # fmt: skip


def _draw_seat_rig(rng: np.random.Generator, s: BenchScales) -> DrawnForm:
    """Return the deflection of a seat with half of it at a force LU(0.05, 0.5) of the largest."""
    half = s.max_force * draw_log_uniform(rng, 0.05, 0.5)
    return DrawnForm(
        "rig_compliance", "stiffening seat", "deflection", 0.03 * s.braid.rest_length,
        lambda a: Effect(deflection=lambda force: rig_forms.deflect_by_seat(force, a, half)), {"force": half},
    )  # fmt: skip


def _build_usual(id: str, amplitude: str, limit: float, build: Callable[[float], Effect]) -> FormDrawer:
    """Return the drawer of a usual form: an offset, a gain or a delay, with the amplitude of the fit."""
    return lambda rng, s: DrawnForm(id, "usual", amplitude, limit, build, is_signed=True)


#: Forms of each mechanism. One is drawn with equal chances.
OTHER_FORMS: dict[str, tuple[FormDrawer, ...]] = {
    "force_drift": (_draw_drift_warm_up, _draw_drift_square_root, _draw_drift_sine, _draw_drift_wander),
    "braid_friction": (_draw_stribeck, _draw_one_sided, _draw_pressure_power),
    "viscous_damping": (_draw_eyring, _draw_directional),
    "viscoelastic_creep": (_draw_fractional, _draw_kohlrausch),
    "bladder_elasticity": (_draw_yeoh, _draw_ogden, _draw_gent),
    "mullins_softening": (_draw_exponential_softening, _draw_travel_softening),
    "braid_locking": (braid_drawers.draw_locking_extension, braid_drawers.draw_locking_angle),
    "end_taper": (braid_drawers.draw_cone, braid_drawers.draw_clamp, braid_drawers.draw_parabola),
    "thread_crimp": (braid_drawers.draw_crimp_corner, braid_drawers.draw_crimp_recruitment),
    "braid_elasticity": (braid_drawers.draw_power_stretch,),
    "thread_slip": (braid_drawers.draw_two_slips, braid_drawers.draw_power_bedding),
    "contact_pressure": (_draw_exponential_contact, _draw_hyperbolic_contact),
    "pressure_drop": (_draw_turbulent_drop, _draw_orifice_drop),
    "rig_compliance": (_draw_hertz_rig, _draw_seat_rig),
    "force_offset": (_build_usual("force_offset", "offset", 1e3, sensor_forms.offset_force),),
    "force_gain": (_build_usual("force_gain", "gain", 0.3, sensor_forms.scale_force),),
    "pressure_offset": (_build_usual("pressure_offset", "offset", 1e5, sensor_forms.offset_pressure),),
    "pressure_gain": (_build_usual("pressure_gain", "gain", 0.3, sensor_forms.scale_pressure),),
    "length_offset": (_build_usual("length_offset", "offset", 0.02, sensor_forms.offset_length),),
    "diameter_offset": (_build_usual("diameter_offset", "offset", 0.005, sensor_forms.offset_diameter),),
    "channel_lag": (_build_usual("channel_lag", "lag", 5.0, sensor_forms.delay_force),),
}
