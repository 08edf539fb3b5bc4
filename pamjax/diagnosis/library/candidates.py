"""In which forms a mechanism may show: its amplitude, and a few fixed shapes to begin from.

The derivative of the prediction by an amplitude is the mechanism's signature. Where a mechanism has a
shape as well, a time or a distance, the signature depends on it, and a few shapes spread over what the
recording can show stand for all of them; the refit then moves the shape too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit

from pamjax.diagnosis.library.library_problem import COMPLIANCE, Problem
from pamjax.model.registry import MECHANISMS

#: Times at which a slip is looked for, over the length of a recording.
MOMENTS = 24

#: Standard deviations within which the middle eight tenths of a normal variable lie.
TENTH = 1.28

#: From this ratio of the fast to the slow strokes of a recording, a power of speed shows in it.
SPEEDS = 1.5

#: Most that the lab's own statement counts for, in χ²: what a tie of two names is worth.
MOST_EXPECTED = 12.0


@dataclass(frozen=True)
class Form:
    """One form of a mechanism.

    Attributes:
        id: of the mechanism.
        amplitudes: names of the numbers that are zero without it.
        shape: names of the numbers that give it its shape, with the values to begin from, SI.
        expected: χ² by which what the lab states of its muscle asks for it, whatever the recording says.
    """

    id: str
    amplitudes: tuple[str, ...]
    shape: dict[str, float] = field(default_factory=dict)
    expected: float = 0.0

    @property
    def moves(self) -> tuple[str, ...]:
        """Names of all numbers that a refit moves."""
        return self.amplitudes + tuple(self.shape)


@dataclass(frozen=True)
class Course:
    """How an effect goes with time, where that is all that its shape does to it.

    Attributes:
        at: from times, s, and a shape to a factor of the effect, (n,).
        everywhere: a shape in which the factor is nowhere small.
    """

    at: Callable[[np.ndarray, dict[str, float]], np.ndarray]
    everywhere: dict[str, float]


def _slipped(time: np.ndarray, shape: dict[str, float]) -> np.ndarray:
    return expit((time - shape["thread_slip.when"]) / shape["thread_slip.during"])


#: By amplitude. Where a memory is in the model already it is approximate, and good enough to choose by.
COURSES = {"thread_slip.step": Course(_slipped, {"thread_slip.when": 0.0, "thread_slip.during": 1e5})}


def forms(found: Problem) -> list[Form]:
    """The forms that a recording can show, mechanism by mechanism."""
    scales = _Scales.of(found)
    out: list[Form] = []
    for kind in MECHANISMS:
        make = _MAKERS.get(kind.id)
        out += make(scales) if make else [_single(kind)]
    known = set(found.names)
    return [form for form in out if known.issuperset(form.moves) and _seen(form, found)]


def _seen(form: Form, found: Problem) -> bool:
    """Whether a recording could show it at all."""
    timed = form.id in NEEDS_TIME
    return found.case.recording.has_time or not timed


#: Mechanisms that a static map, whose order means nothing, cannot show.
NEEDS_TIME = {
    "braid_friction", "viscous_damping", "viscoelastic_creep", "mullins_softening", "thread_slip",
    "pressure_drop", "force_drift", "channel_lag",
}  # fmt: skip


def _single(kind) -> Form:
    """A mechanism whose only amplitude has no shape that matters."""
    from pamjax.parameter import field_meanings

    amplitudes = [f for f, m in field_meanings(kind).items() if m.neutral is not None]
    return Form(kind.id, (f"{kind.id}.{amplitudes[0]}",))


@dataclass(frozen=True)
class _Scales:
    """What a recording spans: lengths of time, of stroke, of load."""

    begin: float
    duration: float
    step: float
    stroke: float
    load: float
    pressure: float
    force: float
    bore: float
    inside: float
    compliance: float
    fitting: float
    spacing: float
    width: float
    rest: float
    isometric: bool
    speeds: float

    @classmethod
    def of(cls, found: Problem) -> _Scales:
        recording = found.case.recording
        good = recording.usable
        length, pressure = recording.length[good], recording.pressure[good]
        time = recording.time[good] if recording.time is not None else np.arange(good.sum(), dtype=float)
        thread, turns = found.case.entry.braid
        load = float(np.nanmax(np.abs(pressure * length))) * thread / (2 * np.pi * turns**2)
        jumps = np.abs(np.diff(length))
        return cls(
            begin=float(time[0]),
            duration=max(float(np.ptp(time)), 1.0),
            step=max(float(np.median(np.diff(time))) if time.size > 1 else 1.0, 1e-3),
            stroke=max(float(np.ptp(length)), 1e-4),
            load=max(load, 1.0),
            pressure=max(float(np.ptp(pressure)), 1e3),
            force=max(float(np.nanmax(np.abs(recording.force), initial=0.0)), 10.0),
            fitting=float(found.start[found.place("end_taper.radius")]),
            spacing=float(found.start[found.place("braid_locking.width")]),
            bore=float(found.start[found.place("bladder_elasticity.inner_diameter")]),
            inside=_inside(found),
            compliance=_stated_compliance(found),
            rest=found.case.entry.rest_length.value,
            width=float(np.sqrt(max(1 - (found.case.entry.rest_length.value / thread) ** 2, 1e-3))),
            isometric=bool(np.mean(jumps > 1e-3 * np.ptp(length)) < 0.2) if length.size > 1 else True,
            speeds=_speeds(found),
        )


def _speeds(found: Problem) -> float:
    """Speed of the fastest tenth of the way over that of the slowest, beyond noise of the rate."""
    history = found.member.history
    speed = np.sort(np.abs(np.asarray(history.rate(found.member.rows.length)))[: found.n])
    way = np.cumsum(speed)
    if not way[-1] > 0:
        return 1.0
    slow, fast = speed[np.searchsorted(way, way[-1] * np.array([0.1, 0.9]))]
    weights = np.median(np.linalg.norm(np.asarray(history.slope)[: found.n], axis=1))
    noise = TENTH * (found.case.entry.sensors.length or 0.0) * float(weights)
    return float((fast - noise) / (slow + noise))


def _inside(found: Problem) -> float:
    """Bore of a tube whose outside lies against the braid at rest, m."""
    entry = found.case.entry
    thread, turns = entry.braid
    wide = np.sqrt(max(thread**2 - entry.rest_length.value**2, 0.0)) / (np.pi * turns)
    return float(wide - 2 * found.start[found.place("bladder_elasticity.thickness")])


def _stated_compliance(found: Problem) -> float:
    """How many standard deviations the lab says its threads are from rigid; 0 where it says nothing."""
    if COMPLIANCE not in found.names:
        return 0.0
    k = found.place(COMPLIANCE)
    return float(found.start[k] / found.sd[k]) if np.isfinite(found.sd[k]) else 0.0


def _stretch(s: _Scales) -> list[Form]:
    return [Form("braid_elasticity", (COMPLIANCE,), expected=min(s.compliance**2, MOST_EXPECTED))]


def _crimp(s: _Scales) -> list[Form]:
    return [
        Form("thread_crimp", ("thread_crimp.crimp",), {"thread_crimp.load": share * s.load})
        for share in (0.08, 0.25, 0.7)
    ]


def _bladder(s: _Scales) -> list[Form]:
    name = "bladder_elasticity."
    # Where the stated tube is wider than the braid, its threads lie in the wall: begin with one that fits.
    fits = s.inside if 0.3 * s.bore < s.inside < s.bore else s.bore
    return [
        Form(
            "bladder_elasticity", (f"{name}modulus",), {f"{name}mooney": share, f"{name}inner_diameter": bore}
        )
        for share in (0.05, 0.6)
        for bore in (fits, 1.1 * fits)
    ]


def _friction(s: _Scales) -> list[Form]:
    amplitudes = ("braid_friction.coefficient", "braid_friction.constant")
    usual = {"braid_friction.spread": 0.5, "braid_friction.exponent": 0.95, "braid_friction.reach": 0.5}
    out = [
        Form(
            "braid_friction",
            amplitudes,
            {"braid_friction.presliding": share * s.stroke, "braid_friction.angle": angle, **usual},
        )
        for share in (0.004, 0.015, 0.06)
        for angle in (0.1, 0.9)
    ]
    if s.isometric:
        # What moves in the braid when only the pressure changes: some per mille of the length.
        out += [
            Form(
                "braid_friction",
                amplitudes,
                {
                    "braid_friction.presliding": share * give * s.pressure,
                    "braid_friction.give": give,
                    **usual,
                },
            )
            for share in (0.05, 0.3)
            for give in (min(2e-3 * s.rest / s.pressure, 1.5e-8),)
        ]
    return out


def _creep(s: _Scales) -> list[Form]:
    name = "viscoelastic_creep."
    pairs = [(t, 20 * t) for t in (3 * s.step, 12 * s.step, 50 * s.step) if t < 50]
    return [
        Form(
            "viscoelastic_creep",
            (f"{name}{amplitude}",),
            {
                f"{name}share": share,
                f"{name}time_short": float(np.clip(short, 0.1, 50.0)),
                f"{name}time_long": float(np.clip(long, 12.0, 9e3)),
            },
        )
        for short, long in pairs
        for share in (0.1, 0.5, 0.9)
        for amplitude in ("modulus", "force")
    ]


def _mullins(s: _Scales) -> list[Form]:
    return [
        Form("mullins_softening", ("mullins_softening.modulus",), {"mullins_softening.width": width})
        for width in (0.08, 0.3)
    ]


def _slip(s: _Scales) -> list[Form]:
    bedding = [
        Form("thread_slip", ("thread_slip.bedding",), {"thread_slip.load": share * s.load})
        for share in (0.1, 0.35, 1.2)
    ]
    moments = s.begin + s.duration * (np.arange(MOMENTS) + 0.5) / MOMENTS
    steps = [
        Form(
            "thread_slip",
            ("thread_slip.step",),
            {"thread_slip.when": float(when), "thread_slip.during": s.duration * share},
        )
        for when in moments
        for share in (0.01, 0.1)
    ]
    return bedding + steps


def _viscous(s: _Scales) -> list[Form]:
    amplitudes = ("viscous_damping.coefficient", "viscous_damping.pressed")
    if s.speeds < SPEEDS:
        # At one speed a power shows in nothing but the noise of the rate, to which it would be fitted.
        return [Form("viscous_damping", amplitudes)]
    return [Form("viscous_damping", amplitudes, {"viscous_damping.power": power}) for power in (0.5, 0.95)]


def _contact(s: _Scales) -> list[Form]:
    return [
        Form("contact_pressure", ("contact_pressure.threshold",), {"contact_pressure.fill": share * s.width})
        for share in (0.2, 0.8)
    ]


def _rig(s: _Scales) -> list[Form]:
    return [
        Form("rig_compliance", ("rig_compliance.compliance",)),
        Form(
            "rig_compliance",
            ("rig_compliance.compliance", "rig_compliance.seat"),
            {"rig_compliance.seat_force": 0.3 * s.force},
        ),
    ]


def _taper(s: _Scales) -> list[Form]:
    return [
        Form("end_taper", ("end_taper.share",), {"end_taper.radius": share * s.fitting})
        for share in (0.94, 1.0)
    ]


def _locking(s: _Scales) -> list[Form]:
    return [
        Form("braid_locking", ("braid_locking.stiffness",), {"braid_locking.width": share * s.spacing})
        for share in (0.9, 1.1, 1.4, 1.9)
    ]


def _drift(s: _Scales) -> list[Form]:
    return [
        Form("force_drift", ("force_drift.rate",)),
        Form("force_drift", ("force_drift.rate", "force_drift.bend")),
    ]


_MAKERS = {
    "braid_elasticity": _stretch,
    "thread_crimp": _crimp,
    "bladder_elasticity": _bladder,
    "braid_friction": _friction,
    "viscoelastic_creep": _creep,
    "mullins_softening": _mullins,
    "thread_slip": _slip,
    "force_drift": _drift,
    "viscous_damping": _viscous,
    "contact_pressure": _contact,
    "rig_compliance": _rig,
    "end_taper": _taper,
    "braid_locking": _locking,
}
