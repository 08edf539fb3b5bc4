"""Scales of a recording, from which the starting values of shape parameters follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.library.library_parameters import COMPLIANCE_PARAMETER
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.records.recording import Recording

#: Largest interval of the rows, which can be means, over the time step. Shorter times would not show in them.
_MAX_STEP_RATIO = 5

#: 90 % quantile of the standard normal distribution.
_NORMAL_QUANTILE_90 = 1.28


@dataclass(frozen=True)
class RecordingScales:
    """Scales of a recording: its times, stroke, load, pressure and speeds.

    Attributes:
        start_time, duration: first time and duration, s.
        time_step: median time step of the samples, s; longer for means of many samples.
        stroke: range of length, m.
        load: largest P L B / (2 π n²), with pressure P, length L, thread length B and n turns, N.
        pressure: range of pressure, Pa.
        force: largest force, N.
        bore: inner diameter of the bladder, m.
        fitting_bore: bore of a tube whose outer wall touches the braid at rest length, m.
        stated_compliance_sd: stated thread compliance in its standard deviations; 0 if none is stated.
        fitting_radius: radius of the end fittings, m.
        softening_energy: largest energy over which the wall softens in every cycle, per modulus and volume.
        thread_width: total width of all threads side by side, m.
        rest_angle_cosine: cosine of the braid angle at rest length.
        rest_length: rest length, m.
        has_stretch: whether the threads of the baseline stretch.
        is_isometric: whether fewer than 20 % of the steps change the length.
        speed_ratio: ratio of fast to slow strokes.
        speed: geometric mean of the speeds of fast and slow strokes, m/s.
        settings: thresholds of the diagnosis.
    """

    start_time: float
    duration: float
    time_step: float
    stroke: float
    load: float
    pressure: float
    force: float
    bore: float
    fitting_bore: float
    stated_compliance_sd: float
    fitting_radius: float
    softening_energy: float
    thread_width: float
    rest_angle_cosine: float
    rest_length: float
    has_stretch: bool
    is_isometric: bool
    speed_ratio: float
    speed: float
    settings: DiagnosisSettings

    @classmethod
    def from_problem(cls, problem: LibraryProblem) -> RecordingScales:
        recording = problem.case.recording
        usable = recording.usable
        length, pressure = recording.length[usable], recording.pressure[usable]
        time = recording.time[usable] if recording.time is not None else np.arange(usable.sum(), dtype=float)
        thread, turns = problem.case.muscle_toml.braid
        load = float(np.nanmax(np.abs(pressure * length))) * thread / (2 * np.pi * turns**2)
        jumps = np.abs(np.diff(length))
        speed_ratio, speed = _compute_speeds(problem)
        samples = recording if problem.samples is None else problem.samples.problem.case.recording
        return cls(
            start_time=float(time[0]),
            duration=max(float(np.ptp(time)), 1.0),
            time_step=max(_compute_time_step(samples), _compute_time_step(recording) / _MAX_STEP_RATIO),
            stroke=max(float(np.ptp(length)), 1e-4),
            load=max(load, 1.0),
            pressure=max(float(np.ptp(pressure)), 1e3),
            force=max(float(np.nanmax(np.abs(recording.force), initial=0.0)), 10.0),
            fitting_radius=float(problem.start[problem.index("end_taper.radius")]),
            softening_energy=float(problem.high[problem.index("mullins_softening.cyclic_energy")]),
            thread_width=float(problem.start[problem.index("braid_locking.width")]),
            bore=float(problem.start[problem.index("bladder_elasticity.inner_diameter")]),
            fitting_bore=_compute_fitting_bore(problem),
            stated_compliance_sd=_compute_stated_compliance(problem),
            rest_length=problem.case.muscle_toml.rest_length.value,
            rest_angle_cosine=float(
                np.sqrt(max(1 - (problem.case.muscle_toml.rest_length.value / thread) ** 2, 1e-3))
            ),
            has_stretch=problem.law != "inelastic",
            is_isometric=bool(np.mean(jumps > 1e-3 * np.ptp(length)) < 0.2) if length.size > 1 else True,
            speed_ratio=speed_ratio,
            speed=speed,
            settings=problem.settings,
        )


def _compute_time_step(recording: Recording) -> float:
    """Return the median time between usable samples, s, at least 1 ms; 1 s without time."""
    if recording.time is None or recording.usable.sum() < 2:
        return 1.0
    return max(float(np.median(np.diff(recording.time[recording.usable]))), 1e-3)


def _compute_speeds(problem: LibraryProblem) -> tuple[float, float]:
    """Return ratio and geometric mean, m/s, of the 90 % and the 10 % quantiles of speed, by distance.

    The ratio is corrected for the noise of the rate.
    """
    history = problem.dataset.history
    speed = np.sort(np.abs(np.asarray(history.rate(problem.dataset.rows.length)))[: problem.n])
    distance = np.cumsum(speed)
    if not distance[-1] > 0:
        return 1.0, 1e-3
    slow, fast = speed[np.searchsorted(distance, distance[-1] * np.array([0.1, 0.9]))]
    weights = np.median(np.linalg.norm(np.asarray(history.rate_weights)[: problem.n], axis=1))
    noise = _NORMAL_QUANTILE_90 * (problem.case.muscle_toml.sensors.length or 0.0) * float(weights)
    return float((fast - noise) / (slow + noise)), float(np.sqrt(slow * fast))


def _compute_fitting_bore(problem: LibraryProblem) -> float:
    """Return the bore of a tube whose outer wall touches the braid at rest length, m."""
    muscle_toml = problem.case.muscle_toml
    outer_diameter = muscle_toml.compute_braid_diameter(muscle_toml.rest_length.value)
    return float(outer_diameter - 2 * problem.start[problem.index("bladder_elasticity.thickness")])


def _compute_stated_compliance(problem: LibraryProblem) -> float:
    """Return the stated thread compliance in its standard deviations; 0 if none is stated."""
    if COMPLIANCE_PARAMETER not in problem.names:
        return 0.0
    k = problem.index(COMPLIANCE_PARAMETER)
    return float(problem.start[k] / problem.prior_sd[k]) if np.isfinite(problem.prior_sd[k]) else 0.0
