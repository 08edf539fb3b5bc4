"""The parameters of a recording with every mechanism: priors, starting values and limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.prior_limits import compute_prior_limits
from pamjax.infer.problem.priors import collect_mechanism_values, collect_stated_values
from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.model.parameters import find_meaning
from pamjax.model.state import Cylinder
from pamjax.model.wall import rubber_volume
from pamjax.parameter import Meaning
from pamjax.records.case import Case
from pamjax.records.reading.quantity import MeasuredValue

#: Compliance of the threads; zero for an inelastic braid.
COMPLIANCE_PARAMETER = "braid_elasticity.compliance"

#: Longest warm-up of the load cell over the duration of the recording. A slower one is a straight line.
_MAX_WARMUP_DURATIONS = 3

#: Longest relaxation time over the duration of the recording. A slower branch acts as an elastic wall.
_MAX_RELAXATION_DURATIONS = 1

#: Longest presliding distance over the distance of sliding. Threads that never slide act as a spring.
_MAX_PRESLIDING_SHARE = 0.25

#: Largest energy over which the wall softens in every cycle, as a share of that in the recording. Slower
#: softening is like rubber that does not soften.
_MAX_SOFTENING_SHARE = 0.5

#: Lengths in the table of the wall's energy.
_ENERGY_TABLE_SIZE = 65


@dataclass(frozen=True, eq=False)
class LibraryParameters:
    """The p parameters of a recording: of the baseline, of all mechanisms and of length errors.

    Attributes:
        names: (p,) names.
        meanings: (p,) unit, scale, limits and neutral value of each.
        neutral: (p,) values of the baseline with every mechanism switched off, SI.
        start: (p,) starting values of a fit and means of the priors, SI.
        low, high: (p,) limits, SI.
        prior_sd: (p,) standard deviations of the priors, SI; infinite without a prior.
        is_baseline: (p,) whether a parameter belongs to the baseline.
        length_error_names: names of the errors of the set lengths.
    """

    names: tuple[str, ...]
    meanings: tuple[Meaning, ...]
    neutral: np.ndarray
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    prior_sd: np.ndarray
    is_baseline: np.ndarray
    length_error_names: tuple[str, ...]


def collect_library_parameters(
    case: Case, law: str, mechanism_ids: Sequence[str], settings: DiagnosisSettings
) -> LibraryParameters:
    """Return the parameters of a recording with every mechanism.

    Args:
        case: the recording and the stated values of its muscle.
        law: thread law of the baseline.
        mechanism_ids: ids of the mechanisms.
        settings: thresholds of the diagnosis.
    """
    space, _ = build_joint_space([case], law, ())
    priors = _collect_priors(case, law, mechanism_ids, settings)
    length_errors = {
        n: MeasuredValue(0.0, float(space.sd[i])) for i, n in enumerate(space.names) if n not in priors
    }
    priors |= length_errors
    names = tuple(priors)
    meanings = tuple(
        find_meaning(n) if n not in length_errors else _describe_length_error(space, n) for n in names
    )
    start = np.array([m.value for m in priors.values()])
    prior_sd = np.array([m.sd if m.sd > 0 else math.inf for m in priors.values()])
    is_baseline = np.isin(names, space.names)
    neutral = np.array([v if m.neutral is None else m.neutral for v, m in zip(start, meanings, strict=True)])
    low, high = _compute_limits(names, meanings, start, prior_sd, is_baseline, settings)
    _limit_to_recording(case, names, start, low, high, settings)
    return LibraryParameters(
        names,
        meanings,
        neutral,
        start,
        low,
        high,
        prior_sd,
        is_baseline,
        length_error_names=tuple(length_errors),
    )


def _collect_priors(
    case: Case, law: str, mechanism_ids: Sequence[str], settings: DiagnosisSettings
) -> dict[str, MeasuredValue]:
    """Return the priors of the baseline, of the mechanisms, and of the compliance of an inelastic braid."""
    priors = collect_stated_values(case.muscle_toml, law)
    priors |= collect_mechanism_values(case.muscle_toml, mechanism_ids)
    if law == "inelastic":
        priors[COMPLIANCE_PARAMETER] = _estimate_compliance(case)
    bore = priors["bladder_elasticity.inner_diameter"]
    if not bore.sd > 0:
        bore = MeasuredValue(bore.value, settings.fitted_size_sd_share * bore.value)
    return priors | {"bladder_elasticity.inner_diameter": bore}


def _estimate_compliance(case: Case) -> MeasuredValue:
    """Return the stated compliance of the threads, 1/N; without a prior if it is not stated."""
    muscle_toml = case.muscle_toml
    if muscle_toml.stiffness is not None:
        return MeasuredValue(
            1 / muscle_toml.stiffness.value, muscle_toml.stiffness.sd / muscle_toml.stiffness.value**2
        )
    if muscle_toml.modulus is not None and muscle_toml.threads and muscle_toml.thread_area is not None:
        stiffness = muscle_toml.modulus.value * muscle_toml.threads * muscle_toml.thread_area.value
        return MeasuredValue(1 / stiffness, muscle_toml.modulus.sd / muscle_toml.modulus.value / stiffness)
    return MeasuredValue(1e-6, math.inf)


def _describe_length_error(space: ParameterSpace, name: str) -> Meaning:
    sd = float(space.sd[space.names.index(name)])
    about = "true minus recorded length of one setting"
    return Meaning("m", "mm", -8 * sd, 8 * sd, "linear", about, "standard deviation of the ruler")


def _compute_limits(
    names, meanings, start, prior_sd, is_baseline, settings: DiagnosisSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return the limits of all parameters, (p,) each; those of the baseline are near the stated values."""
    low, high = np.array([m.low for m in meanings]), np.array([m.high for m in meanings])
    rows = np.flatnonzero(is_baseline)
    low[rows], high[rows] = compute_prior_limits(
        [names[k] for k in rows],
        (low[rows], high[rows]),
        start[rows],
        prior_sd[rows],
        settings.max_prior_deviation_sd,
        settings.max_stiffness_factor,
    )
    return low, high


def _limit_to_recording(
    case: Case,
    names: Sequence[str],
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    settings: DiagnosisSettings,
) -> None:
    """Change the limits of the parameters for which a recording has a scale, in place."""
    k = names.index("braid_friction.presliding")
    low[k] = max(low[k], settings.min_presliding_noise_ratio * (case.muscle_toml.sensors.length or 0.0))
    sliding_range = _compute_sliding_range(case, high[names.index("braid_friction.give")])
    high[k] = max(min(high[k], _MAX_PRESLIDING_SHARE * sliding_range), 2 * low[k])
    start[k] = np.clip(start[k], low[k], high[k])
    k = names.index("end_taper.cone_height")
    # Both cones together are not longer than the muscle.
    high[k] = min(high[k], 0.5 * float(np.nanmin(case.recording.length)))
    start[k] = np.clip(start[k], low[k], high[k])
    k = names.index("mullins_softening.cyclic_energy")
    path = _compute_wall_path(case, dict(zip(names, start, strict=True)))
    high[k] = max(min(high[k], _MAX_SOFTENING_SHARE * path), 2 * low[k])
    start[k] = np.clip(start[k], low[k], high[k])
    time = case.recording.time
    if time is None:
        return
    # Only a slip within the recording can be detected.
    k = names.index("thread_slip.when")
    low[k], high[k] = time[0], max(time[-1], time[0] + 1)
    start[k] = np.clip(start[k], low[k], high[k])
    for name, max_durations in (
        ("force_drift.warmup_time", _MAX_WARMUP_DURATIONS),
        ("viscoelastic_creep.time_short", _MAX_RELAXATION_DURATIONS),
        ("viscoelastic_creep.time_long", _MAX_RELAXATION_DURATIONS),
    ):
        k = names.index(name)
        high[k] = max(min(high[k], max_durations * float(np.ptp(time))), 2 * low[k])
        start[k] = np.clip(start[k], low[k], high[k])


def _compute_sliding_range(case: Case, largest_give: float) -> float:
    """Return the distance over which threads can slide: by the stroke, or by the pressure, m."""
    recording = case.recording
    length, pressure = recording.length[recording.usable], recording.pressure[recording.usable]
    return float(max(np.ptp(length), largest_give * np.ptp(pressure)))


def _compute_wall_path(case: Case, values: Mapping[str, float]) -> float:
    """Return the accumulated strain energy of the wall in a recording, per modulus and volume."""
    sizes = [jnp.asarray(values[f"mullins_softening.{n}"]) for n in ("inner_diameter", "thickness", "length")]
    rubber = MullinsSoftening(inner_diameter=sizes[0], thickness=sizes[1], length=sizes[2])
    length = case.recording.length[case.recording.usable]
    # A table of fixed size, because each size of a recording would be compiled anew.
    table = np.linspace(length.min(), length.max(), _ENERGY_TABLE_SIZE)
    thread, turns = (jnp.full(table.size, value) for value in case.muscle_toml.braid)
    state = Cylinder()(jnp.asarray(table), thread, turns)
    energies = np.asarray(rubber.strains(state, jnp.asarray(0.0)))[0]
    path = np.abs(np.diff(np.interp(length, table, energies))).sum()
    return float(path / rubber_volume(rubber))
