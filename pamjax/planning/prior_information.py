"""Information before the first planned run: from the priors of muscle.toml and from an existing recording.

The length errors of an existing recording are separate parameters, and they are marginalised.
Neglects: a length that is set again at the same place does not profit from the recording.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.fitting.reweight import reweight_dataset
from pamjax.infer.problem.dataset import build_dataset
from pamjax.infer.problem.parameter_space import FreeParameter, build_space
from pamjax.infer.problem.priors import is_length_error, list_free_parameters
from pamjax.model.parameters import LENGTH_ERROR_PREFIX, find_meaning
from pamjax.planning.information import PriorInformation, build_placeholder_case
from pamjax.planning.rig_capabilities import DEFAULT_CHANNEL_SDS, RigCapabilities
from pamjax.planning.runs import compute_fixed_lengths
from pamjax.records.blocks import assign_length_levels
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import MuscleToml


def build_prior_information(
    muscle_toml: MuscleToml, capabilities: RigCapabilities, law: str | None = None, case: Case | None = None
) -> PriorInformation:
    """Return the information about a muscle from muscle.toml and from an existing recording.

    Args:
        muscle_toml: content of muscle.toml.
        capabilities: capabilities of the rig.
        law: thread law; None uses that of the baseline model.
        case: existing recording, or None.

    Raises:
        BadInput: if the model has no free parameter.
    """
    law = law or muscle_toml.baseline
    free_parameters = list_muscle_parameters(muscle_toml, law, case)
    # The existing recording may have channels, with their zeros and gains, that the rig no longer has.
    channels = {*capabilities.channels, *(case.recording.channels if case else ())}
    capabilities = replace(
        capabilities,
        error_sds={n: sd for n, sd in capabilities.error_sds.items() if _has_channel(n, channels)},
    )
    free_parameters += [
        FreeParameter(n, find_meaning(n), max(0.0, sd * (find_meaning(n).low >= 0)), sd)
        for n, sd in capabilities.error_sds.items()
    ]
    # One error for each set length, and one for all strokes.
    level_count = compute_fixed_lengths(capabilities, muscle_toml.rest_length.value).size + 1
    length_errors = _build_length_errors(capabilities.length_level_sd, level_count)
    prior_information = _build_from_priors(muscle_toml, capabilities, law, [*free_parameters, *length_errors])
    return prior_information if case is None else _update_with_recording(prior_information, case)


def list_muscle_parameters(
    muscle_toml: MuscleToml, law: str | None = None, case: Case | None = None
) -> list[FreeParameter]:
    """Return the free parameters of a muscle, without those of the rig; see `build_prior_information`.

    Raises:
        BadInput: if the model has no free parameter.
    """
    law = law or muscle_toml.baseline
    load = np.zeros(2) if muscle_toml.measures_length else None
    bare_case = case or build_placeholder_case(
        muscle_toml, np.array([0.0, 1e5]), np.full(2, muscle_toml.rest_length.value), load
    )
    build_joint_space([bare_case], law, ())
    return [n for n in list_free_parameters(bare_case, law) if not is_length_error(n.name)]


def _build_from_priors(
    muscle_toml: MuscleToml, capabilities: RigCapabilities, law: str, free_parameters: Sequence[FreeParameter]
) -> PriorInformation:
    """Return the information of the priors alone."""
    space = build_space(free_parameters)
    mean, sd = np.asarray(space.mean), np.asarray(space.sd)
    default_scale = np.where(
        space.log_scale, 0.5 * np.abs(mean), (np.asarray(space.high) - np.asarray(space.low)) / math.sqrt(12)
    )
    scale = np.where(np.isfinite(sd), sd, default_scale)
    matrix = np.diag(np.where(np.isfinite(sd), 1.0, 1e-6))
    return PriorInformation(
        muscle_toml, capabilities, law, space, tuple(free_parameters), mean, scale, matrix
    )


def _has_channel(name: str, channels: set[str]) -> bool:
    """Return whether a zero or gain belongs to an existing channel."""
    return name.partition("_")[0] in {"pressure", "length", "rig", *channels}


def _update_with_recording(prior_information: PriorInformation, case: Case) -> PriorInformation:
    """Return the information after a recording, at the estimate of a fit to it.

    A misfit increases the noise, and autocorrelation reduces the number of samples. A fit does the same for
    a static table; in a time series it whitens the residuals instead, with the noise of neighbouring samples.
    """
    muscle_count = len(prior_information.muscle_indices)
    shared_parameters = [n for n in prior_information.free_parameters if not is_length_error(n.name)]
    sd = case.muscle_toml.sensors.length if case.muscle_toml.sensors.length_per_level else None
    length_level = assign_length_levels(case.recording) if sd else None
    errors = _build_length_errors(sd, int(length_level.max()) + 1) if sd and length_level is not None else []
    fitted_space = build_space([*prior_information.free_parameters[:muscle_count], *errors])
    dataset = build_dataset(case, prior_information.law, fitted_space, {})
    solution = solve_least_squares((dataset,), fitted_space, jnp.zeros(fitted_space.size))
    reweighted_dataset, _ = reweight_dataset(case, dataset, fitted_space, solution)
    solution = solve_least_squares(
        (reweighted_dataset,), fitted_space, fitted_space.move_inside_bounds(solution.u)
    )
    _, noise = reweight_dataset(case, reweighted_dataset, fitted_space, solution)
    fitted_values = np.asarray(fitted_space.to_values(solution.u))
    values = np.concatenate([fitted_values[:muscle_count], prior_information.mean[muscle_count:]])
    # Use the length errors of the recording instead of those of the planned runs.
    recorded_information = _build_from_priors(
        prior_information.muscle_toml,
        prior_information.capabilities,
        prior_information.law,
        [*shared_parameters, *errors],
    )
    if case.recording.measures_length:
        # The information of the fit itself, whose misfit and autocorrelation are in the weights.
        slope, scale = np.asarray(solution.slope), prior_information.scale[:muscle_count]
        measured = np.asarray(solution.information) / np.outer(slope, slope) * np.outer(scale, scale)
        updated_matrix = prior_information.matrix.copy()
        updated_matrix[:muscle_count, :muscle_count] += measured
        capabilities, length_noise = prior_information.capabilities, noise["length"]
        # Without a stated noise, the next runs have the residual of the recording.
        has_residual_noise = not length_noise.is_known and length_noise.sd > capabilities.length_sd
        if has_residual_noise:
            capabilities = replace(capabilities, length_sd=length_noise.sd)
        return replace(
            prior_information,
            capabilities=capabilities,
            mean=values,
            matrix=updated_matrix,
            misfit_ratios={c: channel_noise.rms_over_noise for c, channel_noise in noise.items()},
            has_residual_noise=has_residual_noise,
        )
    label, matrix = np.zeros(case.recording.n, dtype=int), recorded_information.matrix
    for channel, channel_noise in noise.items():
        # Without a stated noise, use the larger of the residual and the default.
        default_sd = prior_information.capabilities.channel_sds[channel] or DEFAULT_CHANNEL_SDS[channel]
        sensor_sd = getattr(case.muscle_toml.sensors, channel) or max(default_sd, channel_noise.sd)
        channel_rig = replace(prior_information.capabilities, **{f"{channel}_sd": sensor_sd}).keep_channel(
            channel
        )
        channel_rig = replace(channel_rig, length_sd=0.0) if sd else channel_rig
        rms_over_noise = max(channel_noise.rms_over_noise, 1.0)
        samples_per_independent = rms_over_noise**2 * channel_noise.autocorrelation_time
        channel_information = replace(recorded_information, capabilities=channel_rig)
        information, *_ = channel_information.compute_information(case, label, 1, values, length_level)
        matrix = matrix + information / samples_per_independent
    updated_matrix = prior_information.matrix.copy()
    updated_matrix[: len(shared_parameters), : len(shared_parameters)] = _marginalise(
        matrix, len(shared_parameters)
    )
    return replace(
        prior_information,
        mean=values,
        matrix=updated_matrix,
        misfit_ratios={c: channel_noise.rms_over_noise for c, channel_noise in noise.items()},
    )


def _marginalise(information: np.ndarray, count: int) -> np.ndarray:
    """Return the information about the first parameters with the others unknown, (count, count)."""
    others = information[count:, count:]
    cross = information[:count, count:]
    return information[:count, :count] - cross @ np.linalg.solve(others, cross.T)


def _build_length_errors(sd: float, count: int) -> list[FreeParameter]:
    """Return the error parameters of `count` set lengths with this sd, m; none for an sd of 0."""
    meaning = replace(find_meaning(LENGTH_ERROR_PREFIX), low=-8 * sd, high=8 * sd)
    return [
        FreeParameter(f"{LENGTH_ERROR_PREFIX}{k + 1}", meaning, 0.0, sd) for k in range(count if sd else 0)
    ]
