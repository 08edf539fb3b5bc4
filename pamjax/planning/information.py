"""Knowledge: what a muscle's numbers are believed to be, and what runs would add to it.

The information of a run is Σ Jᵀ J over its samples, J the exact derivatives of force and diameter by every
number, over the noise of a sample (that of pressure and length carried through the model). Zeros and
gains of the channels, and what the rig gives, count as numbers beside the muscle's. It is taken at several
truths drawn from what is believed, because a stiff thread is told less well than a soft one.
Samples are equilibria of the bare muscle: rubber, ends and whatever remembers take no part.

Where muscle.toml states one error for each length that is set, each length of the runs has an error of its
own, one number for all runs at that length; all strokes share one more, as in a fit. The errors of a
recording at hand are other numbers, which its information is freed of. What it leaves out: a length that
is set again in the same place is not known any better from the recording.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.infer.fitting.fit import build_joint_space
from pamjax.infer.fitting.least_squares import solve_least_squares
from pamjax.infer.fitting.reweight import reweight_dataset
from pamjax.infer.problem.dataset import Dataset, build_dataset
from pamjax.infer.problem.parameter_space import FreeParameter, ParameterSpace, build_space
from pamjax.infer.problem.priors import is_length_error, list_free_parameters
from pamjax.model.parameters import LENGTH_ERROR_PREFIX, find_meaning
from pamjax.planning.bench import RigCapabilities
from pamjax.planning.runs import PlannedRun, set_lengths
from pamjax.records.blocks import find_length_settings
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import MuscleToml
from pamjax.records.recording import Recording

#: Truths at which information is taken.
TRUTH_COUNT = 9

#: Samples of a run at which its information is taken; more of them tell so much more, in proportion.
MAX_RUN_SAMPLES = 200

#: No truth is drawn beyond this many standard deviations: there the fit itself would ask questions.
MAX_TRUTH_SD = 2.0


@dataclass(frozen=True, eq=False)
class PriorInformation:
    """What is believed before the next run.

    Attributes:
        entry: what muscle.toml says.
        capabilities: what the rig can do.
        law: thread law.
        space: every parameter that a fit can change, with its prior; zeros, gains and set lengths included.
        free_parameters: their declarations: the muscle's, zeros and gains, errors of set lengths.
        mean: (p,) where they are believed to be, SI.
        scale: (p,) the step in which each is measured, SI: its prior's sd, or a share of its limits.
        matrix: (p, p) information of priors and of the recording at hand, in those steps.
        misfit_ratios: by channel of that recording, how many times its noise the muscle misses it by, in rms.
    """

    entry: MuscleToml
    capabilities: RigCapabilities
    law: str
    space: ParameterSpace
    free_parameters: tuple[FreeParameter, ...]
    mean: np.ndarray
    scale: np.ndarray
    matrix: np.ndarray
    misfit_ratios: Mapping[str, float] = field(default_factory=dict)

    def find_index(self, name: str) -> int:
        """Index of a number."""
        return self.space.names.index(name)

    @property
    def muscle_indices(self) -> list[int]:
        """Indices of the muscle's numbers, without the rig's."""
        return [
            k
            for k, n in enumerate(self.space.names)
            if n not in self.capabilities.error_sds and not is_length_error(n)
        ]

    def draw_truths(self, count: int = TRUTH_COUNT, seed: int = 0) -> np.ndarray:
        """Values that the numbers may truly have, (many, p), SI; the first are the believed ones."""
        # A number that nothing is known of is drawn within its step, and not over all its limits.
        inverse = np.linalg.inv(self.matrix + np.diag(1.0 * ~np.isfinite(np.asarray(self.space.sd))))
        draws = np.random.default_rng(seed).standard_normal((count, self.mean.size))
        draws = np.clip(_stratify_draws(draws), -MAX_TRUTH_SD, MAX_TRUTH_SD)
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
        setting: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the information in the samples of a case, (count, p, p), summed by label.

        Args:
            case: the samples.
            label: (n,) which sum each belongs to.
            count: how many sums.
            values: (p,) of the numbers, SI.
            setting: (n,) which set length each sample has; None where set lengths have no errors.
        """
        n, many = label.size, len(self.muscle_indices)
        dataset = build_dataset(without_rulers(case), self.law, build_space(self.free_parameters[:many]), {})
        muscle_values, rows = jnp.asarray(values[:many]), dataset.rows
        slopes, readings, input_slopes = (
            np.asarray(x)[..., :n] for x in _compute_slopes(dataset, muscle_values)
        )
        off = self._compute_error_slopes(input_slopes, readings, np.asarray(rows.pressure)[:n])
        slopes = np.concatenate([slopes, off, self._rulers(input_slopes[1], setting)])
        noise = [x**2 if x else math.inf for x in (self.capabilities.force, self.capabilities.diameter)]
        input_variance = (self.capabilities.gauge * input_slopes[0]) ** 2 + (
            self.capabilities.ruler * input_slopes[1]
        ) ** 2
        variance = np.array(noise)[:, None] + input_variance
        # A slack muscle tells nothing, and one without an answer less.
        informative = np.isfinite(variance) & np.isfinite(slopes).all(axis=0) & (readings[0] > 0)
        # What the muscle missed so far it will miss again.
        misfit_variance = np.array(
            [max(self.misfit_ratios.get(c, 1.0), 1.0) ** 2 for c in ("force", "diameter")]
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
            labelled = scaled_slopes[:, :, label == k]
            information[k] = np.einsum("icn,jcn,cn->ij", labelled, labelled, weight[:, label == k])
        return information

    def _compute_error_slopes(
        self, input_slopes: np.ndarray, readings: np.ndarray, pressure: np.ndarray
    ) -> np.ndarray:
        """Derivatives of force and diameter by what the rig may be off by, (q, 2, n); near zero of each."""
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

    def _rulers(self, by_length: np.ndarray, setting: np.ndarray | None) -> np.ndarray:
        """Return the derivatives of force and diameter by the errors of set lengths, (q, 2, n)."""
        many = sum(map(is_length_error, self.space.names))
        if setting is None:
            return np.zeros((many, *by_length.shape))
        return by_length * (setting == np.arange(many)[:, None])[:, None]

    def settings(self, offered: Sequence[PlannedRun]) -> np.ndarray:
        """Return the index of each run's length among those that are set; strokes come after all of them."""
        lengths = set_lengths(self.capabilities, self.entry.rest_length.value)
        return np.array(
            [int(np.argmin(abs(lengths - r.length[0]))) if r.still else lengths.size for r in offered]
        )

    def compute_run_information(self, runs: Sequence[PlannedRun], values: np.ndarray) -> np.ndarray:
        """What each run tells at some values, (r, p, p)."""
        thinned_runs = [run.thin(MAX_RUN_SAMPLES) for run in runs]
        label = np.concatenate([np.full(run.pressure.size, k) for k, run in enumerate(thinned_runs)])
        information = np.zeros((len(runs), *self.matrix.shape))
        if label.size:
            setting = self.settings(runs)[label]
            information = self.compute_information(
                self.build_case(thinned_runs), label, len(runs), values, setting
            )
        for k, run in enumerate(runs):
            information[k] *= run.pressure.size / max(thinned_runs[k].pressure.size, 1)
            for name, sd in run.direct_sds.items():
                if name in self.space.names:
                    i = self.find_index(name)
                    information[k, i, i] += (self.scale[i] / sd) ** 2
        return information

    def build_case(self, runs: Sequence[PlannedRun]) -> Case:
        """Runs as a recording, with nothing measured in it yet."""
        pressure = np.concatenate([run.pressure for run in runs])
        length = np.concatenate([run.length for run in runs])
        return build_map_case(self.entry, pressure, length)


def without_rulers(case: Case) -> Case:
    """Return the case with exact set lengths: whoever asks for their errors has numbers of its own."""
    sensors = replace(case.entry.sensors, length_per_setting=False)
    return replace(case, entry=replace(case.entry, sensors=sensors))


def rulers(sd: float, many: int) -> list[FreeParameter]:
    """Return the errors of so many set lengths as numbers with this sd, m; none where it is 0."""
    about = replace(find_meaning(LENGTH_ERROR_PREFIX), low=-8 * sd, high=8 * sd)
    return [FreeParameter(f"{LENGTH_ERROR_PREFIX}{k + 1}", about, 0.0, sd) for k in range(many if sd else 0)]


def build_map_case(entry: MuscleToml, pressure: np.ndarray, length: np.ndarray) -> Case:
    """A static map as a case, with nothing of it known but that the muscle pulls."""
    force = np.full(pressure.size, 1e3)
    recording = Recording.from_arrays(pressure=pressure, length=length, force=force)
    return Case("plan", Path(), entry, recording, "")


@eqx.filter_jit
def _compute_slopes(dataset: Dataset, values: Array) -> tuple[Array, Array, Array]:
    """Derivatives of force and diameter by every number, (p, 2, n); what is shown, (2, n); and its
    derivatives by pressure and by length, (2, 2, n)."""

    def instant(x, pressure, length):
        reading = dataset.build_muscle(x)(pressure, length)
        return jnp.stack([reading.force, reading.diameter])

    def everything(pressure, length):
        slopes = jax.jacfwd(instant, argnums=(0, 1, 2))(values, pressure, length)
        return slopes[0].T, instant(values, pressure, length), jnp.stack(slopes[1:])

    return jax.vmap(everything, out_axes=-1)(dataset.rows.pressure, dataset.rows.length)


def _stratify_draws(draws: np.ndarray) -> np.ndarray:
    """Draws with their ranks put at even shares of a normal: few of them then stand for many."""
    from scipy.stats import norm

    count = draws.shape[0] - 1
    rank = np.argsort(np.argsort(draws[1:], axis=0), axis=0)
    return np.concatenate([draws[:1], norm.ppf((rank + 0.5) / count)])


def build_prior_information(
    entry: MuscleToml, capabilities: RigCapabilities, law: str | None = None, case: Case | None = None
) -> PriorInformation:
    """What is believed of a muscle, by muscle.toml and, where there is one, by its recording.

    Args:
        entry: what muscle.toml says.
        capabilities: what the rig can do.
        law: thread law; None takes the baseline's.
        case: a recording made already.

    Raises:
        BadInput: where nothing may move.
    """
    law = law or entry.baseline
    bare_case = case or build_map_case(entry, np.array([0.0, 1e5]), np.full(2, entry.rest_length.value))
    build_joint_space([bare_case], law, ())
    free_parameters = [n for n in list_free_parameters(bare_case, law) if not is_length_error(n.name)]
    # What was recorded was read by channels, and with their zeros, that the rig may no longer have.
    channels = {*capabilities.channels, *(case.recording.channels if case else ())}
    capabilities = replace(
        capabilities,
        error_sds={n: sd for n, sd in capabilities.error_sds.items() if _has_channel(n, channels)},
    )
    free_parameters += [
        FreeParameter(n, find_meaning(n), max(0.0, sd * (find_meaning(n).low >= 0)), sd)
        for n, sd in capabilities.error_sds.items()
    ]
    # One for each length that is set, and one for the strokes.
    lengths = rulers(capabilities.setting, set_lengths(capabilities, entry.rest_length.value).size + 1)
    prior_information = _before(entry, capabilities, law, [*free_parameters, *lengths])
    return prior_information if case is None else _update_with_recording(prior_information, case)


def _before(
    entry: MuscleToml, means: RigCapabilities, law: str, free: Sequence[FreeParameter]
) -> PriorInformation:
    """Return what the priors of some numbers say of them."""
    at = build_space(free)
    mean, sd = np.asarray(at.mean), np.asarray(at.sd)
    reach = np.where(
        at.log_scale, 0.5 * np.abs(mean), (np.asarray(at.high) - np.asarray(at.low)) / math.sqrt(12)
    )
    scale = np.where(np.isfinite(sd), sd, reach)
    prior = np.diag(np.where(np.isfinite(sd), 1.0, 1e-6))
    return PriorInformation(entry, means, law, at, tuple(free), mean, scale, prior)


def _has_channel(name: str, channels: set[str]) -> bool:
    """Whether a zero or gain belongs to a channel that there is."""
    return name.partition("_")[0] in {"pressure", "length", "rig", *channels}


def _update_with_recording(prior_information: PriorInformation, case: Case) -> PriorInformation:
    """Knowledge after a recording: where a fit of it ends, and what it tells there.

    What the muscle misses counts as noise, and samples that know each other as fewer, as in a fit.
    """
    many = len(prior_information.muscle_indices)
    shared = [n for n in prior_information.free_parameters if not is_length_error(n.name)]
    sd = case.entry.sensors.length if case.entry.sensors.length_per_setting else None
    setting = find_length_settings(case.recording) if sd else None
    errors = rulers(sd, int(setting.max()) + 1) if sd and setting is not None else []
    fitted = build_space([*prior_information.free_parameters[:many], *errors])
    dataset = build_dataset(case, prior_information.law, fitted, {})
    solution = solve_least_squares((dataset,), fitted, jnp.zeros(fitted.size))
    reweighted, _ = reweight_dataset(case, dataset, fitted, solution)
    solution = solve_least_squares((reweighted,), fitted, fitted.move_inside_limits(solution.u))
    _, noise = reweight_dataset(case, reweighted, fitted, solution)
    values = np.concatenate([np.asarray(fitted.to_values(solution.u))[:many], prior_information.mean[many:]])
    # The recording's set lengths take the place of those to come.
    here = _before(
        prior_information.entry, prior_information.capabilities, prior_information.law, [*shared, *errors]
    )
    label, matrix = np.zeros(case.recording.n, dtype=int), here.matrix
    for channel, channel_noise in noise.items():
        # A channel whose noise nobody stated is as noisy as its residual, and not better than usual.
        default_sd = getattr(prior_information.capabilities, channel) or getattr(RigCapabilities, channel)
        own_space = getattr(case.entry.sensors, channel) or max(default_sd, channel_noise.sd)
        channel_rig = replace(prior_information.capabilities, **{channel: own_space}).keep_channel(channel)
        channel_rig = replace(channel_rig, ruler=0.0) if sd else channel_rig
        samples_per_independent = max(channel_noise.excess, 1.0) ** 2 * channel_noise.inflation
        matrix = (
            matrix
            + replace(here, capabilities=channel_rig).compute_information(case, label, 1, values, setting)[0]
            / samples_per_independent
        )
    before = prior_information.matrix.copy()
    before[: len(shared), : len(shared)] = _freed(matrix, len(shared))
    return replace(
        prior_information,
        mean=values,
        matrix=before,
        misfit_ratios={c: channel_noise.excess for c, channel_noise in noise.items()},
    )


def _freed(information: np.ndarray, many: int) -> np.ndarray:
    """Return the information about the first numbers with the others unknown, (many, many)."""
    others = information[many:, many:]
    across = information[:many, many:]
    return information[:many, :many] - across @ np.linalg.solve(others, across.T)
