"""One recording before the whole library: every mechanism at its neutral value, one compiled program.

A candidate is a choice of numbers that may move, so that every combination of mechanisms runs through
the same two programs: what the bench shows, and how that changes with one number at a time.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.compile import programs
from pamjax.errors import refuse
from pamjax.infer.fitting.fit import build_joint_space
from pamjax.infer.problem.dataset import (
    CHANNELS,
    Dataset,
    build_history,
    build_rows,
    find_informative_samples,
)
from pamjax.infer.problem.priors import collect_mechanism_values, collect_stated_values
from pamjax.model.assembly import resolve_bench_law
from pamjax.model.bench import HISTORY_DEPENDENT
from pamjax.model.parameters import find_meaning
from pamjax.model.registry import MECHANISMS
from pamjax.parameter import Meaning
from pamjax.records.case import Case
from pamjax.records.fixed_length import average_fixed_lengths
from pamjax.records.reading.quantity import MeasuredValue

#: Rows of the shortest program. Longer ones have twice as many, and so on: those beyond a recording's cost
#: little, and recordings of other lengths need no program of their own.
MIN_PROGRAM_ROWS = 640

#: Numbers in which one sweep takes derivatives, at most.
DERIVATIVES_PER_SWEEP = 32

#: How many of them are taken side by side.
DERIVATIVES_PER_PASS = 4

#: A number that was measured stays within this many of its standard deviations: further off, the lab has
#: not made an error of measurement, but the model one of physics.
MAX_PRIOR_DEVIATION_SD = 3.0

#: Factor within which the threads' stiffness stays of what the lab believes of it.
MAX_STIFFNESS_FACTOR = 5.0

#: A presliding distance is at least this many times the noise of length: the friction of a shorter one
#: would answer to that noise, which stands in the residual as well.
MIN_PRESLIDING_NOISE_RATIO = 10.0

#: How far a tube in a braid may be from its size as bought, where the lab says nothing of it: it is
#: stretched or squeezed to fit.
FITTED_SIZE_SD_SHARE = 0.1

#: The mechanism that costs as much as all others together: left out of the program while it has no share.
COSTLIEST_MECHANISM = "end_taper"

#: What leaves something to later samples, so that a recording is passed twice while one of them is on.
MECHANISMS_WITH_MEMORY = {kind.id for kind in MECHANISMS if issubclass(kind, HISTORY_DEPENDENT)}

#: The threads' compliance, of which an inelastic braid has none.
COMPLIANCE_PARAMETER = "braid_elasticity.compliance"


@dataclass(frozen=True, eq=False)
class LibraryProblem:
    """A recording, its muscle with the whole library, and what is believed of every number.

    Attributes:
        case: the recording, held lengths as one, and what the lab says of it.
        law: the baseline, "inelastic" or "elastic".
        names: (p,) of all numbers.
        meanings: (p,) their meanings.
        neutral: (p,) the baseline's values with every mechanism switched off, SI.
        start: (p,) where a number starts once it may move, SI.
        low, high: (p,) limits, SI.
        prior_sd: (p,) of the prior around `start`, SI; infinite where there is none.
        is_baseline: (p,) whether the baseline itself moves the number.
        dataset: the compiled program's arrays.
        reduced_dataset: the same without the costliest mechanism, for as long as that is switched off.
        measured: (2, n) force and diameter, SI; NaN where there is nothing to compare.
    """

    case: Case
    law: str
    names: tuple[str, ...]
    meanings: tuple[Meaning, ...]
    neutral: np.ndarray
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    prior_sd: np.ndarray
    is_baseline: np.ndarray
    dataset: Dataset
    reduced_dataset: Dataset
    measured: np.ndarray

    @property
    def is_logarithmic(self) -> np.ndarray:
        """(p,) whether a number moves on a logarithmic scale."""
        return np.array([m.scale == "log" for m in self.meanings])

    @property
    def is_switch(self) -> np.ndarray:
        """(p,) whether a number switches its mechanism on."""
        return np.array([m.neutral is not None for m in self.meanings])

    @property
    def n(self) -> int:
        """How many rows there are."""
        return self.case.recording.n

    def index(self, name: str) -> int:
        """Index of a number."""
        return self.names.index(name)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """What the bench shows at these values: force (N) and diameter (m), (2, n)."""
        return self.jacobian(values, ())[0]

    def active(self, values: np.ndarray) -> set[str]:
        """Ids of the mechanisms that are switched on at these values."""
        return {
            _get_mechanism_id(self.names[k])
            for k in np.flatnonzero((values != self.neutral) & self.is_switch)
        }

    def compile(self) -> None:
        """Begin to compile both programs, side by side; whoever needs one waits for it."""
        for dataset in (self.reduced_dataset, self.dataset):
            programs.start_compilation(
                _sweep_derivatives, *_pack_sweep_arguments(dataset, self.neutral, (), True)
            )

    def jacobian(self, values: np.ndarray, indices) -> tuple[np.ndarray, np.ndarray]:
        """What the bench shows, (2, n), and its derivative by each of the numbers, (k, 2, n), SI."""
        indices, active_ids = np.array(list(indices), dtype=int), self.active(values)
        mechanism_ids = [_get_mechanism_id(self.names[k]) for k in indices]
        dataset = (
            self.dataset
            if COSTLIEST_MECHANISM in active_ids or COSTLIEST_MECHANISM in mechanism_ids
            else self.reduced_dataset
        )
        has_memory = np.array(
            [bool(MECHANISMS_WITH_MEMORY & (active_ids | {id})) for id in mechanism_ids], dtype=bool
        )
        prediction, jacobian = None, np.empty((indices.size, 2, self.n))
        for twice in (False, True):
            some = np.flatnonzero(has_memory == twice)
            for k in range(0, some.size, DERIVATIVES_PER_SWEEP):
                now = some[k : k + DERIVATIVES_PER_SWEEP]
                prediction, jacobian[now] = self._run_sweep(dataset, values, indices[now], twice)
        if prediction is None:
            prediction, _ = self._run_sweep(dataset, values, (), bool(MECHANISMS_WITH_MEMORY & active_ids))
        return prediction, jacobian

    def _run_sweep(self, dataset: Dataset, values, indices, twice: bool) -> tuple[np.ndarray, np.ndarray]:
        prediction, jacobian = programs.run_compiled(
            _sweep_derivatives, *_pack_sweep_arguments(dataset, values, indices, twice)
        )
        return np.asarray(prediction)[:, : self.n], np.asarray(jacobian)[: len(indices), :, : self.n]


def _get_mechanism_id(name: str) -> str:
    return name.partition(".")[0]


def _pack_sweep_arguments(dataset: Dataset, values, indices, twice: bool) -> tuple:
    slots = np.zeros(DERIVATIVES_PER_SWEEP, dtype=int)
    slots[: len(indices)] = indices
    counts = jnp.asarray(len(indices)), jnp.asarray(twice)
    return dataset, jnp.asarray(values), jnp.asarray(slots), *counts


@eqx.filter_jit
def _sweep_derivatives(
    dataset: Dataset, values: Float[Array, " p"], slots: Array, count: Array, twice: Array
) -> tuple[Array, Array]:
    """What is shown, and its derivative by the first `evaluate_many` of the numbers in `slots`.

    `twice` says whether any of them, or of what is switched on, leaves something to later samples.
    """
    dataset = eqx.tree_at(lambda m: m.history.has_memory, dataset, twice, is_leaf=lambda x: x is None)

    def predict(x):
        reading = dataset.predict(x)
        return jnp.stack([reading.force, reading.diameter])

    def fill(k, carry):
        _, jacobian = carry
        now = jax.lax.dynamic_slice_in_dim(slots, k * DERIVATIVES_PER_PASS, DERIVATIVES_PER_PASS)
        tangents = jax.nn.one_hot(now, values.size, dtype=values.dtype)
        # Side by side: what all directions share is worked out once for them, while it is in the cache.
        prediction, tangent_prediction = jax.vmap(
            lambda t: jax.jvp(predict, (values,), (t,)), out_axes=(None, 0)
        )(tangents)
        return prediction, jax.lax.dynamic_update_slice_in_dim(
            jacobian, tangent_prediction, k * DERIVATIVES_PER_PASS, 0
        )

    nothing = jnp.zeros((2, dataset.rows.pressure.size))
    rounds = jnp.maximum(-(-count // DERIVATIVES_PER_PASS), 1)
    return jax.lax.fori_loop(0, rounds, fill, (nothing, jnp.zeros((DERIVATIVES_PER_SWEEP, *nothing.shape))))


def compute_program_rows(n: int) -> int:
    """Rows of the program that a recording of n rows runs in.

    >>> [compute_program_rows(n) for n in (5, 870, 5000)]
    [640, 1280, 5120]
    """
    return MIN_PROGRAM_ROWS * 2 ** max(math.ceil(math.log2(max(n, 1) / MIN_PROGRAM_ROWS)), 0)


def build_library_problem(case: Case) -> LibraryProblem:
    """Put a recording before the whole library.

    Args:
        case: the recording and what the lab says of it; its baseline is inelastic or elastic.

    Raises:
        BadInput: for a baseline that no bench has, or nothing to compare with.
    """
    case = average_fixed_lengths(case)
    law = resolve_bench_law(case.entry.baseline, ())
    ids = tuple(kind.id for kind in MECHANISMS)
    space, _ = build_joint_space([case], law, ())
    priors = collect_stated_values(case.entry, law) | _read_mechanism_priors(case, law, ids)
    priors["bladder_elasticity.inner_diameter"] = _widen_size_prior(
        priors["bladder_elasticity.inner_diameter"]
    )
    rulers = {n: MeasuredValue(0.0, float(space.sd[i])) for i, n in enumerate(space.names) if n not in priors}
    priors |= rulers
    names = tuple(priors)
    meanings = tuple(find_meaning(n) if n not in rulers else _describe_length_error(space, n) for n in names)
    start = np.array([m.value for m in priors.values()])
    prior_sd = np.array([m.sd if m.sd > 0 else math.inf for m in priors.values()])
    is_baseline = np.isin(names, space.names)
    neutral = np.array([v if m.neutral is None else m.neutral for v, m in zip(start, meanings, strict=True)])
    low, high = _compute_limits(names, meanings, start, prior_sd, is_baseline)
    k = names.index("braid_friction.presliding")
    low[k] = max(low[k], MIN_PRESLIDING_NOISE_RATIO * (case.entry.sensors.length or 0.0))
    recording, size = case.recording, compute_program_rows(case.recording.n)
    if recording.time is not None:
        # A slip that a recording shows happened in it.
        k = names.index("thread_slip.when")
        low[k], high[k] = recording.time[0], max(recording.time[-1], recording.time[0] + 1)
        start[k] = np.clip(start[k], low[k], high[k])
    index_by_name = {n: i for i, n in enumerate(names)}
    dataset = Dataset(
        law=law,
        mechanisms=ids,
        free_parameters=tuple((n, i) for n, i in index_by_name.items() if n not in rulers),
        length_error_indices=tuple(index_by_name[n] for n in rulers),
        fixed_values={},
        rows=build_rows(case, size),
        history=build_history(case, size, padding=False),
        channel_weights=jnp.ones(2),
    )
    measured = np.stack(
        [np.where(find_informative_samples(case, c), getattr(recording, c), np.nan) for c in CHANNELS]
    )
    if not np.isfinite(measured).any():
        raise refuse(
            "a diagnosis compares force and diameter where the muscle is inflated and taut", "no such row",
            remedy="Inflate the muscle further, or check the zero of `pressure`.",
        )  # fmt: skip
    reduced_dataset = dataclasses.replace(
        dataset, mechanisms=tuple(id for id in ids if id != COSTLIEST_MECHANISM)
    )
    return LibraryProblem(
        case,
        law,
        names,
        meanings,
        neutral,
        start,
        low,
        high,
        prior_sd,
        is_baseline,
        dataset,
        reduced_dataset,
        measured,
    )


def _read_mechanism_priors(case: Case, law: str, ids: tuple[str, ...]) -> dict[str, MeasuredValue]:
    """The mechanisms' numbers; of an inelastic braid its compliance too, believed as its threads are."""
    priors = collect_mechanism_values(case.entry, ids)
    if law == "inelastic":
        priors[COMPLIANCE_PARAMETER] = _estimate_compliance(case)
    return priors


def _widen_size_prior(size: MeasuredValue) -> MeasuredValue:
    return size if size.sd > 0 else MeasuredValue(size.value, FITTED_SIZE_SD_SHARE * size.value)


def _estimate_compliance(case: Case) -> MeasuredValue:
    entry = case.entry
    if entry.stiffness is not None:
        return MeasuredValue(1 / entry.stiffness.value, entry.stiffness.sd / entry.stiffness.value**2)
    if entry.modulus is not None and entry.threads and entry.thread_area is not None:
        stiffness = entry.modulus.value * entry.threads * entry.thread_area.value
        return MeasuredValue(1 / stiffness, entry.modulus.sd / entry.modulus.value / stiffness)
    return MeasuredValue(1e-6, math.inf)


def _describe_length_error(space, name: str) -> Meaning:
    sd = float(space.sd[space.names.index(name)])
    about = "true minus written length of one setting"
    return Meaning("m", "mm", -8 * sd, 8 * sd, "linear", about, "the ruler's own standard deviation")


def _compute_limits(names, meanings, start, prior_sd, is_baseline) -> tuple[np.ndarray, np.ndarray]:
    low = np.array([m.low for m in meanings])
    high = np.array([m.high for m in meanings])
    for k, name in enumerate(names):
        if not is_baseline[k]:
            continue
        if name in ("thread.modulus", "thread.stiffness"):
            low[k], high[k] = (
                max(low[k], start[k] / MAX_STIFFNESS_FACTOR),
                min(high[k], start[k] * MAX_STIFFNESS_FACTOR),
            )
        elif math.isfinite(prior_sd[k]):
            low[k], high[k] = (
                max(low[k], start[k] - MAX_PRIOR_DEVIATION_SD * prior_sd[k]),
                min(high[k], start[k] + MAX_PRIOR_DEVIATION_SD * prior_sd[k]),
            )
    return low, high
