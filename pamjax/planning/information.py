"""Fisher information of the parameters of a muscle from planned runs.

The information of a run is

    I = Σ Jᵀ J

over its samples, with the exact derivatives J of force and diameter with respect to every parameter, divided
by the effective noise of a sample. The effective noise includes the noise of pressure and length, propagated
through the model. Sensor zeros, sensor gains and the rig compliance are parameters too. The information
depends on the parameters: a stiff thread stretches less, so its stiffness is harder to measure. It is
therefore evaluated at several parameter vectors drawn from the prior.

Samples are equilibria of the muscle without rubber, tapered ends and mechanisms with memory.

On an isotonic rig, the force F is set and the length L is measured. At the solved length, a derivative of L
is that of F divided by −K, with the stiffness K = ∂F/∂L. The length depends on the parameters.

If muscle.toml states one error for each set length, each length of the runs has one error parameter, common
to all runs at this length. All strokes share another one, as in a fit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.infer.problem.dataset import Dataset, build_dataset
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.infer.problem.parameter_space import FreeParameter, ParameterSpace, build_space
from pamjax.infer.problem.priors import is_length_error
from pamjax.jit import compile_on_call
from pamjax.model.isotonic import MIN_STIFFNESS, solve_lengths
from pamjax.planning.rig_capabilities import RigCapabilities
from pamjax.planning.runs import PlannedRun, compute_fixed_lengths
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.recording import Recording

#: Number of parameter vectors at which information is evaluated.
_PRIOR_DRAW_COUNT = 9

#: Largest number of samples for the information of a run; the result is scaled to all samples.
_MAX_RUN_SAMPLES = 200

#: Limit of the drawn parameter vectors, in standard deviations from the mean.
_MAX_DRAW_SD = 2.0


@dataclass(frozen=True, eq=False)
class PriorInformation:
    """Information about the parameters before the next run.

    Attributes:
        muscle_toml: content of muscle.toml.
        capabilities: capabilities of the rig.
        law: thread law.
        space: free parameters with priors: muscle, sensor zeros and gains, rig, errors of set lengths.
        free_parameters: declarations of these parameters, in this order.
        mean: (p,) present estimates, SI.
        scale: (p,) unit of each parameter, SI: the sd of its prior, or a share of its range.
        matrix: (p, p) information of the priors and of the existing recording, in these units.
        misfit_ratios: for each channel of that recording, the rms residual over the noise.
        has_residual_noise: whether the residual of an isotonic recording counts as the noise of length,
            because no noise is stated.
    """

    muscle_toml: MuscleToml
    capabilities: RigCapabilities
    law: str
    space: ParameterSpace
    free_parameters: tuple[FreeParameter, ...]
    mean: np.ndarray
    scale: np.ndarray
    matrix: np.ndarray
    misfit_ratios: Mapping[str, float] = field(default_factory=dict)
    has_residual_noise: bool = False

    def find_index(self, name: str) -> int:
        """Return the index of a parameter."""
        return self.space.names.index(name)

    @property
    def muscle_indices(self) -> list[int]:
        """Return the indices of the parameters of the muscle, without those of the rig."""
        return [
            k
            for k, n in enumerate(self.space.names)
            if n not in self.capabilities.error_sds and not is_length_error(n)
        ]

    def draw_parameters(self, count: int = _PRIOR_DRAW_COUNT, seed: int = 0) -> np.ndarray:
        """Return parameter vectors drawn from the information, (count, p), SI; the first is the mean."""
        # A parameter without prior is drawn within its unit, not over its whole range.
        inverse = np.linalg.inv(self.matrix + np.diag(1.0 * ~np.isfinite(np.asarray(self.space.sd))))
        draws = np.random.default_rng(seed).standard_normal((count, self.mean.size))
        draws = np.clip(_stratify_draws(draws), -_MAX_DRAW_SD, _MAX_DRAW_SD)
        draws[0] = 0.0
        values = self.mean + draws @ np.linalg.cholesky(inverse).T * self.scale
        low, high = np.asarray(self.space.low), np.asarray(self.space.high)
        inside = 1e-3 * (high - low)
        return np.clip(values, np.minimum(low + inside, self.mean), np.maximum(high - inside, self.mean))

    def compute_information(
        self,
        case: Case,
        label: np.ndarray,
        count: int,
        values: np.ndarray,
        length_level: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the information in the samples of a case, (count, p, p), summed by label.

        Args:
            case: the samples.
            label: (n,) index of the sum of each sample.
            count: number of sums.
            values: (p,) parameter values, SI.
            length_level: (n,) index of the set length of each sample; None if set lengths have no errors.
        """
        n, muscle_count = label.size, len(self.muscle_indices)
        muscle_space = build_space(self.free_parameters[:muscle_count])
        dataset = build_dataset(_remove_length_errors(case), self.law, muscle_space, {})
        muscle_values, rows = jnp.asarray(values[:muscle_count]), dataset.rows
        slopes, readings, input_slopes = (
            np.asarray(x)[..., :n] for x in _compute_slopes(dataset, muscle_values)
        )
        error_slopes = self._compute_error_slopes(input_slopes, readings, np.asarray(rows.pressure)[:n])
        length_slopes = self._compute_length_error_slopes(input_slopes[1], length_level)
        slopes = np.concatenate([slopes, error_slopes, length_slopes])
        if self.capabilities.measures_length:
            slopes, variance = self._convert_to_length(slopes, input_slopes)
            is_loaded = find_informative_samples(case, "length")
        else:
            variance = self._compute_variance(input_slopes)
            is_loaded = readings[0] > 0
        # Samples of a slack muscle or without equilibrium have no information.
        informative = np.isfinite(variance) & np.isfinite(slopes).all(axis=0) & is_loaded
        # The misfit of the existing recording is expected in the next runs too.
        misfit_variance = np.array(
            [max(self.misfit_ratios.get(c, 1.0), 1.0) ** 2 for c in self.capabilities.model_channels]
        )
        weight = np.where(
            informative,
            self.capabilities.independent_share
            / np.where(informative, misfit_variance[:, None] * variance, 1.0),
            0.0,
        )
        scaled_slopes = np.nan_to_num(slopes) * self.scale[:, None, None]
        information = np.zeros((count, scaled_slopes.shape[0], scaled_slopes.shape[0]))
        for k in range(count):
            labelled_slopes = scaled_slopes[:, :, label == k]
            information[k] = np.einsum(
                "icn,jcn,cn->ij", labelled_slopes, labelled_slopes, weight[:, label == k]
            )
        return information

    def _compute_variance(self, input_slopes: np.ndarray) -> np.ndarray:
        """Return the variance of force and diameter, SI, (2, n), with the noise of pressure and length."""
        noise = [x**2 if x else math.inf for x in (self.capabilities.force_sd, self.capabilities.diameter_sd)]
        input_variance = (self.capabilities.pressure_sd * input_slopes[0]) ** 2 + (
            self.capabilities.length_sd * input_slopes[1]
        ) ** 2
        return np.array(noise)[:, None] + input_variance

    def _convert_to_length(
        self, slopes: np.ndarray, input_slopes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of length and diameter at a set force, and their variance, (2, n), SI.

        Args:
            slopes: (p, 2, n) derivatives of force and diameter by every parameter.
            input_slopes: (2, 2, n) the same by pressure and by length.
        """
        rig, stiffness = self.capabilities, np.maximum(input_slopes[1, 0], MIN_STIFFNESS)
        to_length = np.stack([-1 / stiffness, np.ones_like(stiffness)])
        length_variance = rig.length_sd**2 + ((rig.force_sd or 0.0) / stiffness) ** 2
        diameter_variance = (rig.diameter_sd or math.inf) ** 2 + (rig.length_sd * input_slopes[1, 1]) ** 2
        variance = np.stack([length_variance, diameter_variance])
        return slopes * to_length, variance + (rig.pressure_sd * input_slopes[0] * to_length) ** 2

    def _compute_error_slopes(
        self, input_slopes: np.ndarray, readings: np.ndarray, pressure: np.ndarray
    ) -> np.ndarray:
        """Return the derivatives of force and diameter by zeros, gains and compliance, (q, 2, n), at 0."""
        (by_pressure, by_length), unit = input_slopes, np.ones_like(pressure)
        columns = {
            "force_offset.offset": np.stack([unit, 0 * unit]),
            "force_gain.gain": np.stack([readings[0], 0 * unit]),
            "pressure_offset.offset": -by_pressure,
            "pressure_gain.gain": -pressure * by_pressure,
            "length_offset.offset": -by_length,
            "diameter_offset.offset": np.stack([0 * unit, unit]),
            "rig_compliance.compliance": -by_length * readings[0],
        }
        return np.array([columns[name] for name in self.space.names if name in columns]).reshape(
            -1, 2, unit.size
        )

    def _compute_length_error_slopes(
        self, by_length: np.ndarray, length_level: np.ndarray | None
    ) -> np.ndarray:
        """Return the derivatives of force and diameter by the errors of set lengths, (q, 2, n)."""
        error_count = sum(map(is_length_error, self.space.names))
        if length_level is None:
            return np.zeros((error_count, *by_length.shape))
        return by_length * (length_level == np.arange(error_count)[:, None])[:, None]

    def find_length_levels(self, runs: Sequence[PlannedRun]) -> np.ndarray:
        """Return the index of each run's set length; strokes have the index after the last length."""
        lengths = compute_fixed_lengths(self.capabilities, self.muscle_toml.rest_length.value)
        return np.array(
            [int(np.argmin(abs(lengths - r.length[0]))) if r.has_fixed_length else lengths.size for r in runs]
        )

    def compute_run_information(self, runs: Sequence[PlannedRun], values: np.ndarray) -> np.ndarray:
        """Return the information of each run at given parameter values, (r, p, p)."""
        thinned_runs = [run.select_samples(_MAX_RUN_SAMPLES) for run in runs]
        label = np.concatenate([np.full(run.pressure.size, k) for k, run in enumerate(thinned_runs)])
        information = np.zeros((len(runs), *self.matrix.shape))
        if label.size:
            length_level = self.find_length_levels(runs)[label]
            information = self.compute_information(
                self.build_case(thinned_runs, values), label, len(runs), values, length_level
            )
        for k, run in enumerate(runs):
            information[k] *= run.pressure.size / max(thinned_runs[k].pressure.size, 1)
            for name, sd in run.direct_sds.items():
                if name in self.space.names:
                    i = self.find_index(name)
                    information[k, i, i] += (self.scale[i] / sd) ** 2
        return information

    def build_case(self, runs: Sequence[PlannedRun], values: np.ndarray) -> Case:
        """Return runs as a recording without measured values.

        Isotonic lengths are those at the parameter values (p,), SI.
        """
        pressure = np.concatenate([run.pressure for run in runs])
        length = np.concatenate([run.length for run in runs])
        loads = [run.load for run in runs if run.load is not None]
        if not loads:
            return build_placeholder_case(self.muscle_toml, pressure, length)
        return self._solve_lengths(pressure, np.concatenate(loads), values)

    def _solve_lengths(self, pressure: np.ndarray, load: np.ndarray, values: np.ndarray) -> Case:
        """Return an isotonic recording; the set force is NaN where the muscle cannot lift it.

        These rows have no information: the muscle is vented, or the load stretches it beyond its rest length.
        """
        rest_length, count = self.muscle_toml.rest_length.value, len(self.muscle_indices)
        case = build_placeholder_case(self.muscle_toml, pressure, np.full(pressure.size, rest_length), load)
        dataset = build_dataset(case, self.law, build_space(self.free_parameters[:count]), {})
        is_inflated = find_informative_samples(case, "length")
        reading, is_solved = solve_lengths(
            dataset.build_muscle(jnp.asarray(values[:count])),
            jnp.where(is_inflated, pressure, np.max(pressure)),
            jnp.asarray(case.recording.length),
            jnp.asarray(load),
            dataset.history,
        )
        length = np.asarray(reading.length)
        is_lifted = is_inflated & np.asarray(is_solved) & (length <= rest_length)
        length, load = np.where(is_lifted, length, rest_length), np.where(is_lifted, load, np.nan)
        return build_placeholder_case(self.muscle_toml, pressure, length, load)


def _remove_length_errors(case: Case) -> Case:
    """Return the case without length errors of its own; the caller adds its own error parameters."""
    sensors = replace(case.muscle_toml.sensors, length_per_level=False)
    return replace(case, muscle_toml=replace(case.muscle_toml, sensors=sensors))


def build_placeholder_case(
    muscle_toml: MuscleToml, pressure: np.ndarray, length: np.ndarray, load: np.ndarray | None = None
) -> Case:
    """Return pressures and lengths as a case, with the set force or a placeholder value of force."""
    force = np.full(pressure.size, 1e3) if load is None else load
    recording = Recording.from_arrays(
        pressure=pressure, length=length, force=force, measures_length=load is not None
    )
    return Case("plan", Path(), muscle_toml, recording, "")


@compile_on_call
def _compute_slopes(dataset: Dataset, values: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of force and diameter by parameters, pressure and length, and their values.

    Shapes: by every parameter, (p, 2, n); the values, (2, n); by pressure and by length, (2, 2, n).
    """

    def predict_sample(x, pressure, length):
        reading = dataset.build_muscle(x)(pressure, length)
        return jnp.stack([reading.force, reading.diameter])

    def differentiate_sample(pressure, length):
        slopes = jax.jacfwd(predict_sample, argnums=(0, 1, 2))(values, pressure, length)
        return slopes[0].T, predict_sample(values, pressure, length), jnp.stack(slopes[1:])

    return jax.vmap(differentiate_sample, out_axes=-1)(dataset.rows.pressure, dataset.rows.length)


def _stratify_draws(draws: np.ndarray) -> np.ndarray:
    """Return draws at the quantiles of their ranks, so that few draws represent a normal distribution."""
    from scipy.stats import norm

    count = draws.shape[0] - 1
    rank = np.argsort(np.argsort(draws[1:], axis=0), axis=0)
    return np.concatenate([draws[:1], norm.ppf((rank + 0.5) / count)])
