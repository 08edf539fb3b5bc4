"""A recording with the model of all mechanisms: parameters, priors, limits and compiled predictions.

At its neutral value a parameter switches its mechanism off. A candidate is a set of free parameters.
So one compiled program evaluates every combination of mechanisms: the prediction and its derivatives.
It does not compute the mechanisms that are switched off.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from pamjax.compile import programs
from pamjax.diagnosis.library.evaluation_cache import EvaluationCache
from pamjax.diagnosis.library.library_parameters import LibraryParameters, collect_library_parameters
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.errors import BadInput
from pamjax.infer.problem.dataset import Dataset, build_history, build_rows
from pamjax.infer.problem.informative_samples import find_informative_samples
from pamjax.jit import compile_on_call
from pamjax.model.assembly import resolve_bench_law
from pamjax.model.bench import HISTORY_DEPENDENT
from pamjax.model.registry import MECHANISMS
from pamjax.records.case import Case
from pamjax.records.fixed_length import average_fixed_lengths
from pamjax.records.row_averages import RowAverages
from pamjax.records.turns import find_turns

#: Rows of the shortest compiled program. Longer ones have 2, 4, 8, ... times as many: balances of padding are
#: not computed, and recordings of different lengths share a program.
_MIN_PROGRAM_ROWS, _PROGRAM_ROWS_FACTOR = 1280, 2

#: Largest number of parameters in one sweep of derivatives; a multiple of the numbers below.
_DERIVATIVES_PER_SWEEP = 30

#: Number of derivatives that are computed in parallel, for short and for long recordings. Most refits have
#: at most six free parameters. Three keep the intermediate results of 10,240 rows below 32 MB, the largest
#: block that the C library reuses: a larger one is requested from the system in each call.
_DERIVATIVES_PER_PASS, _DERIVATIVES_PER_LONG_PASS = 6, 3

#: Most rows of a program that computes `_DERIVATIVES_PER_PASS` derivatives in parallel.
_MAX_SHORT_ROWS = 5120

#: Key of a prediction without derivatives. That of a sweep is whether a mechanism with memory acts.
_PREDICTION_ALONE = "alone"

#: Mechanisms that depend on earlier samples. If one is active, the recording is simulated twice.
_MECHANISMS_WITH_MEMORY = {kind.id for kind in MECHANISMS if issubclass(kind, HISTORY_DEPENDENT)}


@dataclass(frozen=True, eq=False)
class AveragedSamples:
    """The samples of a problem whose rows are means.

    Attributes:
        problem: the problem of the samples, with the same parameters.
        averages: the groups of neighbouring rows.
    """

    problem: LibraryProblem
    averages: RowAverages


@dataclass(frozen=True, eq=False)
class LibraryProblem(LibraryParameters):
    """A recording and the model of all mechanisms, with the prior and the limits of every parameter.

    A candidate model is a choice of free parameters; the others stay at `neutral`, where their mechanism is
    switched off. The parameters of the baseline are free in every fit.

    Attributes, besides those of `LibraryParameters`:
        case: the recording, with fixed lengths averaged, and the stated values of its muscle.toml.
        law: thread law of the baseline, "inelastic" or "elastic".
        dataset: arrays for the compiled program with all mechanisms.
        measured: (2, n) measured force (N) and diameter (m); NaN where no sample is compared.
        samples: the samples of which the rows are means; None if the rows are samples.
        is_turn: (n,) whether an input changes its speed at a row.
        settings: thresholds of the diagnosis.
        evaluations: cached results at recent parameter values.
    """

    case: Case
    law: str
    dataset: Dataset
    measured: np.ndarray
    samples: AveragedSamples | None
    is_turn: np.ndarray
    settings: DiagnosisSettings = DEFAULT_SETTINGS
    evaluations: EvaluationCache = field(default_factory=EvaluationCache, init=False, repr=False)

    @property
    def is_logarithmic(self) -> np.ndarray:
        """Return whether each parameter is fitted on a logarithmic scale, (p,).

        A stated value of the baseline is not: its prior is normal in the value itself, as in a fit.
        """
        is_stated = self.is_baseline & np.isfinite(self.prior_sd)
        return np.array([m.scale == "log" for m in self.meanings]) & ~is_stated

    @property
    def is_switch(self) -> np.ndarray:
        """Return whether each parameter switches its mechanism on, (p,)."""
        return np.array([m.neutral is not None for m in self.meanings])

    @property
    def channels(self) -> tuple[str, str]:
        """Return the names of both predicted channels: force, or length in an isotonic test, and diameter."""
        return self.case.recording.model_channels

    @property
    def n(self) -> int:
        """Return the number of rows of the recording."""
        return self.case.recording.n

    def index(self, name: str) -> int:
        """Return the index of a parameter by name."""
        return self.names.index(name)

    def set_shape(self, values: np.ndarray, shape: Mapping[str, float]) -> np.ndarray:
        """Return values with some shape parameters, by name, set within their limits, (p,), SI."""
        out = values.copy()
        for name, value in shape.items():
            k = self.index(name)
            out[k] = np.clip(value, self.low[k], self.high[k])
        return out

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the predicted force (N) and diameter (m), (2, n), at parameter values (p,), SI."""
        key = values.tobytes()
        evaluation = self.evaluations.get(key)
        if _PREDICTION_ALONE not in evaluation.predictions:
            prediction = programs.run_compiled(
                _predict_channels,
                self.dataset,
                values,
                _flag_mechanisms(self.find_active_mechanisms(values)),
            )
            evaluation = evaluation.merge(
                {_PREDICTION_ALONE: np.array(np.asarray(prediction)[:, : self.n])}, {}
            )
            self.evaluations.put(key, evaluation)
        return evaluation.predictions[_PREDICTION_ALONE]

    def find_active_mechanisms(self, values: np.ndarray) -> set[str]:
        """Return the ids of the mechanisms that are switched on at these values."""
        return {
            _get_mechanism_id(self.names[k])
            for k in np.flatnonzero((values != self.neutral) & self.is_switch)
        }

    def start_compilation(self) -> None:
        """Start to compile both programs, the longer one first; the first use of each waits for it."""
        self.start_compilation_of_derivatives()
        self.start_compilation_of_prediction()

    def start_compilation_of_derivatives(self) -> None:
        """Start to compile the program of the derivatives."""
        programs.start_compilation(
            _sweep_derivatives, *_pack_sweep_arguments(self.dataset, self.neutral, (), ())
        )

    def start_compilation_of_prediction(self) -> None:
        """Start to compile the program of the prediction alone."""
        programs.start_compilation(_predict_channels, self.dataset, self.neutral, _flag_mechanisms(()))

    def predict_with_jacobian(self, values: np.ndarray, indices) -> tuple[np.ndarray, np.ndarray]:
        """Return the prediction, (2, n), and its derivatives by some parameters, (k, 2, n), SI.

        It agrees with `predict` to rounding.
        """
        indices = [int(k) for k in indices]
        if not indices:
            return self.predict(values), np.empty((0, 2, self.n))
        key, active_ids = values.tobytes(), self.find_active_mechanisms(values)
        evaluation = self.evaluations.get(key)
        acting_ids = {k: active_ids | {_get_mechanism_id(self.names[k])} for k in indices}
        has_memory = {k: bool(_MECHANISMS_WITH_MEMORY & acting_ids[k]) for k in indices}
        # Parameters of one mechanism are neighbours: a pass computes the mechanisms of its parameters.
        missing = sorted(k for k in indices if k not in evaluation.derivatives)
        for with_memory in (False, True):
            group = [k for k in missing if has_memory[k] == with_memory]
            for start in range(0, len(group), _DERIVATIVES_PER_SWEEP):
                batch = group[start : start + _DERIVATIVES_PER_SWEEP]
                prediction, jacobian = self._run_sweep(values, batch, [acting_ids[k] for k in batch])
                # Copies: the arrays of the program have empty rows and slots.
                columns = {k: np.array(column) for k, column in zip(batch, jacobian, strict=True)}
                evaluation = evaluation.merge({with_memory: np.array(prediction)}, columns)
        if missing:
            self.evaluations.put(key, evaluation)
        # The program is that of the parameters, so that the result does not depend on earlier evaluations.
        prediction = evaluation.predictions[max(has_memory.values())]
        return prediction, np.stack([evaluation.derivatives[k] for k in indices])

    def _run_sweep(
        self, values: np.ndarray, indices: Sequence[int], acting_ids: Sequence[Collection[str]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the prediction, (2, n), and its derivatives, (k, 2, n), of one sweep.

        `acting_ids` are, for each parameter, the mechanisms that act at its derivative.
        """
        prediction, jacobian = programs.run_compiled(
            _sweep_derivatives, *_pack_sweep_arguments(self.dataset, values, indices, acting_ids)
        )
        return np.asarray(prediction)[:, : self.n], np.asarray(jacobian)[: len(indices), :, : self.n]


def _get_mechanism_id(name: str) -> str:
    return name.partition(".")[0]


def _flag_mechanisms(acting_ids: Collection[str]) -> np.ndarray:
    """Return whether each mechanism acts, in the order of the registry."""
    return np.array([kind.id in acting_ids for kind in MECHANISMS])


def _pack_sweep_arguments(
    dataset: Dataset, values, indices: Sequence[int], acting_ids: Sequence[Collection[str]]
) -> tuple:
    slots, per_pass = np.zeros(_DERIVATIVES_PER_SWEEP, dtype=int), _choose_derivatives_per_pass(dataset)
    slots[: len(indices)] = indices
    acting = [
        _flag_mechanisms(set().union(*acting_ids[k : k + per_pass]))
        for k in range(0, _DERIVATIVES_PER_SWEEP, per_pass)
    ]
    return dataset, values, slots, np.array(len(indices)), np.stack(acting)


def _choose_derivatives_per_pass(dataset: Dataset) -> int:
    rows = dataset.rows.pressure.size
    return _DERIVATIVES_PER_PASS if rows <= _MAX_SHORT_ROWS else _DERIVATIVES_PER_LONG_PASS


@compile_on_call
def _predict_channels(dataset: Dataset, values: Float[Array, " p"], acting: Bool[Array, " m"]) -> Array:
    """Return the predicted channels; `acting` is whether each mechanism acts, as in the registry."""
    flag_by_id = {kind.id: flag for kind, flag in zip(MECHANISMS, acting, strict=True)}
    return dataclasses.replace(dataset, acting=flag_by_id).predict_channels(values)


@compile_on_call
def _sweep_derivatives(
    dataset: Dataset, values: Float[Array, " p"], slots: Array, count: Array, acting: Bool[Array, "k m"]
) -> tuple[Array, Array]:
    """Return the prediction and its derivatives by the first `count` parameters in `slots`.

    `acting` is whether each mechanism acts, or is that of a parameter, in each pass over the rows.
    """
    rows, per_pass = dataset.rows.pressure.size, _choose_derivatives_per_pass(dataset)

    def fill(k, carry):
        _, jacobian = carry
        now = jax.lax.dynamic_slice_in_dim(slots, k * per_pass, per_pass)
        tangents = jax.nn.one_hot(now, values.size, dtype=values.dtype)
        # Batched: the common part of all directions is computed once, while it is in the processor cache.
        prediction, tangent_prediction = jax.vmap(
            lambda t: jax.jvp(lambda x: _predict_channels(dataset, x, acting[k]), (values,), (t,)),
            out_axes=(None, 0),
        )(tangents)
        return prediction, jax.lax.dynamic_update_slice_in_dim(jacobian, tangent_prediction, k * per_pass, 0)

    empty_results = jnp.zeros((2, rows)), jnp.zeros((_DERIVATIVES_PER_SWEEP, 2, rows))
    return jax.lax.fori_loop(0, -(-count // per_pass), fill, empty_results)


def compute_program_rows(n: int) -> int:
    """Return the number of rows of the compiled program for a recording of n rows.

    >>> [compute_program_rows(n) for n in (5, 870, 5000)]
    [1280, 1280, 5120]
    """
    power = math.ceil(math.log(max(n, 1) / _MIN_PROGRAM_ROWS, _PROGRAM_ROWS_FACTOR) - 1e-9)
    return _MIN_PROGRAM_ROWS * _PROGRAM_ROWS_FACTOR ** max(power, 0)


def build_library_problem(case: Case, settings: DiagnosisSettings = DEFAULT_SETTINGS) -> LibraryProblem:
    """Return the problem of a recording and all mechanisms.

    Args:
        case: the recording and the stated values of its muscle; the baseline is inelastic or elastic.
        settings: thresholds of the diagnosis.

    Raises:
        BadInput: if the baseline is not available, or if no sample can be compared.
    """
    case = average_fixed_lengths(case)
    law = resolve_bench_law(case.muscle_toml.baseline, ())
    mechanism_ids = tuple(kind.id for kind in MECHANISMS)
    parameters = collect_library_parameters(case, law, mechanism_ids, settings)
    return LibraryProblem(
        **vars(parameters),
        case=case,
        law=law,
        dataset=_build_dataset(case, law, mechanism_ids, parameters),
        measured=_collect_measurements(case),
        samples=None,
        is_turn=find_turns(case.recording),
        settings=settings,
    )


def average_rows(problem: LibraryProblem, averages: RowAverages) -> LibraryProblem:
    """Return the problem of averages of neighbouring rows, with the same parameters."""
    recording, muscle_toml = averages.averaged_recording, problem.case.muscle_toml
    sensors = averages.scale_sensors(muscle_toml.sensors)
    case = dataclasses.replace(
        problem.case, recording=recording, muscle_toml=dataclasses.replace(muscle_toml, sensors=sensors)
    )
    names, original = recording.model_channels, averages.recording
    is_ignored = [
        averages.contains(np.isfinite(getattr(original, name)) & np.isnan(measured))
        for name, measured in zip(names, problem.measured, strict=True)
    ]
    measured = np.where(is_ignored, np.nan, np.stack([getattr(recording, name) for name in names]))
    return dataclasses.replace(
        problem,
        case=case,
        dataset=_build_dataset(
            case, problem.law, problem.dataset.mechanisms, problem, averages.part[averages.centres]
        ),
        measured=measured,
        samples=AveragedSamples(problem, averages),
        is_turn=averages.is_turn[averages.centres],
    )


def _build_dataset(
    case: Case,
    law: str,
    mechanism_ids: tuple[str, ...],
    parameters: LibraryParameters,
    part: np.ndarray | None = None,
) -> Dataset:
    """Return the arrays of a recording for the compiled program with all mechanisms.

    `part` is the number of the continuous part of each row, if known.
    """
    size = compute_program_rows(case.recording.n)
    index_by_name = {n: i for i, n in enumerate(parameters.names)}
    length_errors = parameters.length_error_names
    return Dataset(
        law=law,
        mechanisms=mechanism_ids,
        free_parameters=tuple((n, i) for n, i in index_by_name.items() if n not in length_errors),
        length_error_indices=tuple(index_by_name[n] for n in length_errors),
        fixed_values={},
        rows=build_rows(case, size),
        history=build_history(case, size, compute_padding=False, part=part),
        channel_weights=jnp.ones(2),
    )


def _collect_measurements(case: Case) -> np.ndarray:
    """Return measured force (N) and diameter (m), (2, n); NaN where no sample is compared."""
    recording = case.recording
    measured = np.stack(
        [
            np.where(find_informative_samples(case, c), getattr(recording, c), np.nan)
            for c in recording.model_channels
        ]
    )
    if not np.isfinite(measured).any():
        raise BadInput.from_rule(
            "a diagnosis needs rows with force or diameter in which the muscle is inflated and taut",
            "no such row", remedy="Inflate the muscle further, or check the zero of `pressure`.",
        )  # fmt: skip
    return measured
