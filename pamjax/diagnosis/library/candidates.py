"""Candidates: each mechanism with its amplitudes and a few starting values of its shape parameters.

The derivative of the prediction with respect to an amplitude is the candidate's score direction. It depends
on the shape parameters, for example a time or a distance. A few starting values cover the range of the
recording. The refit then estimates the shape parameters too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit

from pamjax.diagnosis.library.library_parameters import COMPLIANCE_PARAMETER
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.library.recording_scales import RecordingScales
from pamjax.model.registry import MECHANISMS


@dataclass(frozen=True)
class Candidate:
    """A mechanism with one set of starting values of its shape parameters.

    Attributes:
        id: id of the mechanism.
        amplitudes: names of the parameters that are zero without the mechanism.
        shape: starting values of the shape parameters by name, SI.
        stated_chi2: χ² in favour of the mechanism from the stated values of the muscle alone.
    """

    id: str
    amplitudes: tuple[str, ...]
    shape: dict[str, float] = field(default_factory=dict)
    stated_chi2: float = 0.0

    @property
    def free_parameters(self) -> tuple[str, ...]:
        """Return the names of all parameters that a refit of the candidate estimates."""
        return self.amplitudes + tuple(self.shape)


@dataclass(frozen=True)
class TimeCourse:
    """A factor on an effect over time, for effects whose shape parameters change only this factor.

    Attributes:
        factor: function of times, s, and shape parameters; returns the factor, (n,).
        reference_shape: shape parameters at which the factor is large at all times.
    """

    factor: Callable[[np.ndarray, dict[str, float]], np.ndarray]
    reference_shape: dict[str, float]


def _compute_slip_factor(time: np.ndarray, shape: dict[str, float]) -> np.ndarray:
    return expit((time - shape["thread_slip.when"]) / shape["thread_slip.during"])


#: Time courses by amplitude. They are approximate if the model already has a mechanism with memory.
TIME_COURSES = {
    "thread_slip.step": TimeCourse(_compute_slip_factor, {"thread_slip.when": 0.0, "thread_slip.during": 1e5})
}


def build_candidates(problem: LibraryProblem) -> list[Candidate]:
    """Return the candidates that the recording can test, in the order of the mechanisms."""
    scales = RecordingScales.from_problem(problem)
    out: list[Candidate] = []
    for kind in MECHANISMS:
        builder = _CANDIDATE_BUILDERS.get(kind.id)
        out += builder(scales) if builder else [_build_single_candidate(kind)]
    known_names = set(problem.names)
    return [
        candidate
        for candidate in out
        if known_names.issuperset(candidate.free_parameters) and _is_testable(candidate, problem)
    ]


def _is_testable(candidate: Candidate, problem: LibraryProblem) -> bool:
    """Return whether the recording can test the candidate."""
    recording = problem.case.recording
    # A constant set force is a weight, or none. There is then no load cell whose zero can drift.
    is_weight = recording.measures_length and np.nanmax(recording.force) == np.nanmin(recording.force)
    if candidate.id == "force_drift" and is_weight:
        return False
    return recording.has_time or candidate.id not in MECHANISMS_NEEDING_TIME


#: Mechanisms that a static table, in which the order of rows has no meaning, cannot test.
MECHANISMS_NEEDING_TIME = {kind.id for kind in MECHANISMS if kind.needs_time}


def _build_single_candidate(kind) -> Candidate:
    """Return the candidate of a mechanism with one amplitude and no shape parameters."""
    from pamjax.parameter import list_field_meanings

    amplitudes = [f for f, m in list_field_meanings(kind).items() if m.neutral is not None]
    return Candidate(kind.id, (f"{kind.id}.{amplitudes[0]}",))


def _build_braid_elasticity(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate(
            "braid_elasticity",
            (COMPLIANCE_PARAMETER,),
            stated_chi2=min(scales.stated_compliance_sd**2, scales.settings.max_stated_chi2),
        )
    ]


def _build_thread_crimp(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate("thread_crimp", ("thread_crimp.crimp",), {"thread_crimp.load": share * scales.load})
        for share in (0.08, 0.25, 0.7)
    ]


def _build_bladder_elasticity(scales: RecordingScales) -> list[Candidate]:
    name = "bladder_elasticity."
    # A stated bore wider than the braid is not possible: start from one that fits.
    fits = scales.fitting_bore if 0.3 * scales.bore < scales.fitting_bore < scales.bore else scales.bore
    return [
        Candidate(
            "bladder_elasticity", (f"{name}modulus",), {f"{name}mooney": share, f"{name}inner_diameter": bore}
        )
        for share in (0.05, 0.6)
        for bore in (fits, 1.1 * fits)
    ] + [
        Candidate(
            "bladder_elasticity",
            (f"{name}modulus",),
            {f"{name}stiffening": 0.05, f"{name}inner_diameter": bore},
        )
        for bore in (fits, 1.1 * fits)
    ]


def _build_braid_friction(scales: RecordingScales) -> list[Candidate]:
    amplitudes = ("braid_friction.coefficient", "braid_friction.constant")
    usual = {"braid_friction.spread": 0.5, "braid_friction.exponent": 0.95, "braid_friction.reach": 0.5}
    out = [
        Candidate(
            "braid_friction",
            amplitudes,
            {"braid_friction.presliding": share * scales.stroke, "braid_friction.angle": angle, **usual},
        )
        for share in (0.004, 0.015, 0.06)
        for angle in (0.1, 0.9)
    ]
    if scales.speed_ratio >= scales.settings.min_speed_ratio_for_power:
        # At one speed the data do not determine how the strength depends on it.
        out += [
            Candidate(
                "braid_friction",
                amplitudes,
                {
                    "braid_friction.presliding": 0.015 * scales.stroke,
                    "braid_friction.angle": angle,
                    "braid_friction.weakening": 0.3,
                    "braid_friction.weakening_speed": float(np.clip(scales.speed, 1e-5, 0.3)),
                    **usual,
                },
            )
            for angle in (0.1, 0.9)
        ]
    return out + [
        Candidate(
            "braid_friction", amplitudes, {"braid_friction.presliding": distance, **moves, **usual, **side}
        )
        for distance, moves in _list_pressure_moves(scales)
        for side in ({}, {"braid_friction.asymmetry": 0.7}, {"braid_friction.asymmetry": -0.7})
    ]


def _list_pressure_moves(scales: RecordingScales) -> list[tuple[float, dict[str, float]]]:
    """Return presliding distances, m, each with parameters that describe sliding at a change of pressure.

    Pressure stretches the threads by a few per mille. Friction on the bladder follows this stretch in part,
    or not at all.
    """
    give = min(2e-3 * scales.rest_length / scales.pressure, 1.5e-8)
    if scales.is_isometric:
        return [(share * give * scales.pressure, {"braid_friction.give": give}) for share in (0.05, 0.3)]
    moves = {"braid_friction.stretch": 0.1} if scales.has_stretch else {"braid_friction.give": give}
    return [(share * scales.stroke, {"braid_friction.angle": 0.1, **moves}) for share in (0.004, 0.015)]


def _build_viscoelastic_creep(scales: RecordingScales) -> list[Candidate]:
    name = "viscoelastic_creep."
    pairs = [
        (t, 20 * t) for t in (3 * scales.time_step, 12 * scales.time_step, 50 * scales.time_step) if t < 50
    ]
    return [
        Candidate(
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
    ] + [
        # Relaxation with the logarithm of time, over three decades.
        Candidate(
            "viscoelastic_creep",
            (f"{name}{amplitude}",),
            {
                f"{name}spectrum": 0.8,
                f"{name}time_short": float(np.clip(3 * scales.time_step, 0.1, 50.0)),
                f"{name}time_long": float(np.clip(3e3 * scales.time_step, 12.0, 9e3)),
            },
        )
        for amplitude in ("modulus", "force")
    ]


def _build_mullins_softening(scales: RecordingScales) -> list[Candidate]:
    name = "mullins_softening."
    first_stretch = [
        Candidate("mullins_softening", (f"{name}modulus",), {f"{name}width": width}) for width in (0.08, 0.3)
    ]
    if scales.is_isometric:
        # At a fixed length the wall accumulates no energy.
        return first_stretch
    return first_stretch + [
        Candidate(
            "mullins_softening",
            (f"{name}cyclic_modulus",),
            {f"{name}cyclic_energy": share * scales.softening_energy},
        )
        for share in (0.1, 0.3, 0.8)
    ]


def _build_thread_slip(scales: RecordingScales) -> list[Candidate]:
    shapes = [
        *((share, {}) for share in (0.1, 0.35, 1.2)),
        *((share, {"thread_slip.bedding_exponent": 2.5}) for share in (0.6, 1.5)),
    ]
    bedding = [
        Candidate(
            "thread_slip", ("thread_slip.bedding",), {"thread_slip.load": share * scales.load, **refinement}
        )
        for share, refinement in shapes
    ]
    moments = (
        scales.start_time
        + scales.duration
        * (np.arange(scales.settings.slip_time_count) + 0.5)
        / scales.settings.slip_time_count
    )
    steps = [
        Candidate(
            "thread_slip",
            ("thread_slip.step",),
            {"thread_slip.when": float(when), "thread_slip.during": scales.duration * share},
        )
        for when in moments
        for share in (0.01, 0.1)
    ]
    return bedding + steps


def _build_viscous_damping(scales: RecordingScales) -> list[Candidate]:
    amplitudes = ("viscous_damping.coefficient", "viscous_damping.pressed")
    # At one speed the data do not determine the power: it would be fitted to noise of the rate.
    powers = (
        [{"viscous_damping.power": power} for power in (0.5, 0.95)]
        if scales.speed_ratio >= scales.settings.min_speed_ratio_for_power
        else [{}]
    )
    sides = ({}, {"viscous_damping.asymmetry": 0.5}, {"viscous_damping.asymmetry": -0.5})
    return [Candidate("viscous_damping", amplitudes, power | side) for power in powers for side in sides]


def _build_pressure_drop(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate("pressure_drop", ("pressure_drop.impedance",)),
        Candidate("pressure_drop", ("pressure_drop.turbulence",)),
        Candidate("pressure_drop", ("pressure_drop.impedance", "pressure_drop.turbulence")),
        Candidate("pressure_drop", ("pressure_drop.turbulence",), {"pressure_drop.compressibility": 0.9}),
    ]


def _build_contact_pressure(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate(
            "contact_pressure",
            ("contact_pressure.threshold",),
            {"contact_pressure.fill": share * scales.rest_angle_cosine},
        )
        for share in (0.2, 0.8)
    ]


def _build_rig_compliance(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate("rig_compliance", ("rig_compliance.compliance",)),
        Candidate(
            "rig_compliance",
            ("rig_compliance.compliance", "rig_compliance.seat"),
            {"rig_compliance.seat_force": 0.3 * scales.force},
        ),
    ]


def _build_end_taper(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate("end_taper", (amplitude,), {"end_taper.radius": share * scales.fitting_radius})
        for amplitude in ("end_taper.share", "end_taper.cone_height")
        for share in (0.94, 1.0)
    ]


def _build_braid_locking(scales: RecordingScales) -> list[Candidate]:
    # A steeper contact begins earlier, and so does one in which not all threads touch at once.
    shapes = [
        *((share, {}) for share in (0.9, 1.1, 1.4, 1.9)),
        *((share, {"braid_locking.exponent": 2.0}) for share in (1.2, 1.7)),
        *((share, {"braid_locking.rounding": 0.05}) for share in (1.2, 1.6)),
        *((share, {"braid_locking.stretch": 0.9}) for share in (1.1, 1.5) if scales.has_stretch),
    ]
    return [
        Candidate(
            "braid_locking",
            ("braid_locking.stiffness",),
            {"braid_locking.width": share * scales.thread_width, **refinement},
        )
        for share, refinement in shapes
    ]


def _build_force_drift(scales: RecordingScales) -> list[Candidate]:
    return [
        Candidate("force_drift", ("force_drift.rate",)),
        Candidate("force_drift", ("force_drift.rate", "force_drift.bend")),
    ] + [
        Candidate(
            "force_drift",
            ("force_drift.rate", "force_drift.warmup"),
            {"force_drift.warmup_time": max(share * scales.duration, 2.0)},
        )
        for share in (0.05, 0.2, 0.6)
    ]


def _build_diameter_offset(scales: RecordingScales) -> list[Candidate]:
    return [Candidate("diameter_offset", ("diameter_offset.offset",), {"diameter_offset.thinning": 0.3})]


def _build_channel_lag(scales: RecordingScales) -> list[Candidate]:
    # A pure delay and a filter have the same derivative at zero: the refit distinguishes them.
    return [Candidate("channel_lag", ("channel_lag.lag",), {"channel_lag.smoothing": 0.3})]


_CANDIDATE_BUILDERS = {
    "channel_lag": _build_channel_lag,
    "diameter_offset": _build_diameter_offset,
    "braid_elasticity": _build_braid_elasticity,
    "thread_crimp": _build_thread_crimp,
    "bladder_elasticity": _build_bladder_elasticity,
    "braid_friction": _build_braid_friction,
    "viscoelastic_creep": _build_viscoelastic_creep,
    "mullins_softening": _build_mullins_softening,
    "thread_slip": _build_thread_slip,
    "force_drift": _build_force_drift,
    "viscous_damping": _build_viscous_damping,
    "pressure_drop": _build_pressure_drop,
    "contact_pressure": _build_contact_pressure,
    "rig_compliance": _build_rig_compliance,
    "end_taper": _build_end_taper,
    "braid_locking": _build_braid_locking,
}
