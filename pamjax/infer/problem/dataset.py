"""One recording in a fit: its parameters, its arrays, and the predictions of the model.

Arrays are padded to a few sizes, and everything that differs between cases is an array. So similar recordings
share one compiled program.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from pamjax.compile.programs import run_compiled
from pamjax.infer.problem.form_filter import FormFilter
from pamjax.infer.problem.informative_samples import (
    estimate_starting_sd,
    find_informative_samples,
    find_slack_samples,
)
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.priors import (
    collect_mechanism_values,
    collect_stated_values,
    is_length_error,
    list_free_parameters,
)
from pamjax.infer.problem.whitening import Whitening
from pamjax.model.assembly import assemble, assemble_bench
from pamjax.model.bench import Bench, BenchReading, clip_slack_force
from pamjax.model.history import History, build_time_history
from pamjax.model.isotonic import LengthReading, predict_length
from pamjax.model.muscle import Muscle, MuscleReading
from pamjax.records.blocks import assign_length_levels
from pamjax.records.case import Case

#: The channels of a fit, in the order of the stacked arrays. In an isotonic test, the length takes the place
#: of the force; `Recording.model_channels` has both names.
CHANNELS = ("force", "diameter")


class PaddedRows(eqx.Module):
    """Samples of a recording as padded arrays; a padded or unmeasured sample has weight zero.

    Attributes:
        pressure, length: (n,) inputs, SI.
        force, diameter: (n,) measurements, SI; zero where not measured. In an isotonic test, `force` is the
            measured length, and `force_weight` its weight.
        force_weight, diameter_weight: (n,) 1 / standard deviation of a sample, or zero.
        length_level: (n,) index of the length level of a row.
        is_slack: (n,) whether the muscle exerts nearly no force.
        training_mask: (n,) one for a row of the fit, zero for a held-out or padded row.
        set_force: (n,) set force of an isotonic test, N; None if the force is measured.
    """

    pressure: Float[Array, " n"]
    length: Float[Array, " n"]
    force: Float[Array, " n"]
    diameter: Float[Array, " n"]
    force_weight: Float[Array, " n"]
    diameter_weight: Float[Array, " n"]
    length_level: Int[Array, " n"]
    is_slack: Bool[Array, " n"]
    training_mask: Float[Array, " n"]
    set_force: Float[Array, " n"] | None = None

    @property
    def weights(self) -> np.ndarray:
        """Return 1 / standard deviation of force and diameter, (2, n); zero where not measured."""
        return np.stack([self.force_weight, self.diameter_weight])


class Dataset(eqx.Module):
    """The model of one case in a fit: its parameters, samples and noise weights.

    Attributes:
        law: thread law, a key of `THREAD_LAWS`.
        mechanisms: ids of the mechanisms; empty for the muscle alone.
        free_parameters: names of the muscle's free parameters, each with its index in the space.
        length_error_indices: indices of the errors of the length levels in the space.
        fixed_values: the muscle's other parameters, SI.
        rows: the samples.
        history: their order in time.
        channel_weights: (2,) factor on the residuals of force and of diameter: below one for autocorrelated
            residuals (see `sensor_noise.py`).
        whitening: filter of the residuals; None for independent samples.
        form_filter: form errors of the mechanisms; None for exact equations.
        acting: whether each mechanism acts, by id; see `Bench`. None for all.
    """

    law: str = eqx.field(static=True)
    mechanisms: tuple[str, ...] = eqx.field(static=True)
    free_parameters: tuple[tuple[str, int], ...] = eqx.field(static=True)
    length_error_indices: tuple[int, ...] = eqx.field(static=True)
    fixed_values: dict[str, Array]
    rows: PaddedRows
    history: History
    channel_weights: Float[Array, " 2"]
    whitening: Whitening | None = None
    form_filter: FormFilter | None = None
    acting: dict[str, Bool[Array, ""]] | None = None

    def without_filters(self) -> Dataset:
        """Return the dataset without filters of the residuals.

        A program for it serves before and after they are known.
        """
        return replace(self, whitening=None, form_filter=None)

    def collect_parameters(self, values: Float[Array, " p"]) -> dict[str, Array]:
        """Return all parameters of the muscle by name, SI, from the free parameters, (p,), SI."""
        return self.fixed_values | {name: values[i] for name, i in self.free_parameters}

    def build_muscle(self, values: Float[Array, " p"]) -> Muscle:
        """Return the muscle without its mechanisms, from the free parameters, (p,), SI."""
        return assemble(self.law, self.collect_parameters(values))

    def build_bench(self, values: Float[Array, " p"]) -> Bench:
        """Return the muscle with its mechanisms, from the free parameters, (p,), SI."""
        bench = assemble_bench(self.law, self.mechanisms, self.collect_parameters(values))
        return replace(bench, acting=self.acting)

    def predict(self, values: Float[Array, " p"]) -> MuscleReading | BenchReading | LengthReading:
        """Return the predicted reading at every row; the length at the set force in an isotonic test."""
        length = self.rows.length
        if self.length_error_indices:
            length = length + values[jnp.array(self.length_error_indices)][self.rows.length_level]
        if self.rows.set_force is not None:
            muscle = self.build_bench(values) if self.mechanisms else self.build_muscle(values)
            return predict_length(muscle, self.rows.pressure, length, self.rows.set_force, self.history)
        if self.mechanisms:
            return self.build_bench(values)(self.rows.pressure, length, self.history, self.rows.is_slack)
        ideal = jax.vmap(self.build_muscle(values))(self.rows.pressure, length)
        return eqx.tree_at(lambda r: r.force, ideal, clip_slack_force(ideal.force, self.rows.is_slack))

    def predict_channels(self, values: Float[Array, " p"]) -> Float[Array, "2 n"]:
        """Return the predicted force, or length in an isotonic test, and diameter, SI."""
        return _stack_channels(self.predict(values))

    def compute_standardised_residuals(self, values: Float[Array, " p"]) -> tuple[Array, Array]:
        """Return (measured − model) / sd of both channels, (n,) each; zero where not measured."""
        (first, diameter), rows = self.predict_channels(values), self.rows
        return (rows.force - first) * rows.force_weight, (rows.diameter - diameter) * rows.diameter_weight

    def compute_weighted_residuals(self, values: Float[Array, " p"]) -> tuple[Array, Array]:
        """Return the residuals of force and of diameter of the rows in use, (n,) each.

        With a whitening filter they are white, in the order of its samples.
        """
        return self.whiten_channels(*self.compute_standardised_residuals(values))

    def whiten_channels(self, force: Float[Array, " n"], diameter: Float[Array, " n"]) -> tuple[Array, Array]:
        """Return standardised residuals, or columns, of the rows in use, white with a whitening filter."""
        if self.whitening is None:
            return force * self.rows.training_mask, diameter * self.rows.training_mask
        return self.whitening.whiten(force, 0), self.whitening.whiten(diameter, 1)

    def whiten_form_errors(self, white: Float[Array, " 2n"]) -> Float[Array, " 2n"]:
        """Return the whitened residuals of both channels, whitened by the form errors too."""
        return white if self.form_filter is None else self.form_filter.whiten(white)


def _stack_channels(reading: MuscleReading | BenchReading | LengthReading) -> Float[Array, "2 n"]:
    first = reading.length if isinstance(reading, LengthReading) else reading.force
    return jnp.stack([first, reading.diameter])


def build_dataset(
    case: Case,
    law: str,
    space: ParameterSpace,
    space_names: Mapping[str, str],
    mechanisms: Sequence[str] = (),
    *,
    rows: PaddedRows | None = None,
    history: History | None = None,
) -> Dataset:
    """Return the dataset of a case.

    Args:
        case: the recording and its muscle.toml.
        law: thread law, a key of `THREAD_LAWS`.
        space: the space with the case's free parameters.
        space_names: name in the space of each of the case's free parameters.
        mechanisms: ids of the mechanisms in addition to the threads.
        rows, history: samples and their order, if not those of the whole recording.
    """
    free = [n.name for n in list_free_parameters(case, law, mechanisms)]
    indices = {name: space.names.index(space_names.get(name, name)) for name in free}
    stated_values = collect_stated_values(case.muscle_toml, law) | collect_mechanism_values(
        case.muscle_toml, mechanisms
    )
    return Dataset(
        law=law,
        mechanisms=tuple(mechanisms),
        free_parameters=tuple((n, i) for n, i in indices.items() if not is_length_error(n)),
        length_error_indices=tuple(i for n, i in indices.items() if is_length_error(n)),
        fixed_values={n: jnp.asarray(m.value) for n, m in stated_values.items() if n not in indices},
        rows=rows or build_rows(case),
        history=history or build_history(case),
        channel_weights=jnp.ones(2),
    )


def build_history(
    case: Case, size: int | None = None, compute_padding: bool = True, part: np.ndarray | None = None
) -> History:
    """Return the order of a case's samples in time.

    Args:
        case: the case.
        size: number of rows with padding; None for `_compute_padded_size`.
        compute_padding: whether padded samples are computed.
        part: (n,) number of the known part of each sample, such as a stroke.
    """
    recording = case.recording
    return build_time_history(
        recording.time,
        recording.is_run_start,
        restart=case.gaps == "anew",
        settled=case.before == "settled",
        stroke_channels=recording.length_and_pressure,
        part=part,
        size=size or _compute_padded_size(recording.n),
        compute_padding=compute_padding,
    )


def predict_rows(dataset: Dataset, values: Float[Array, " p"]) -> tuple[np.ndarray, np.ndarray]:
    """Return both predicted channels, (2, n), SI, and the `Status`, (n,), at every (padded) row, compiled.

    See `Dataset.predict_channels` for the channels.
    """
    channels, status = run_compiled(_predict_rows, dataset.without_filters(), values)
    return np.asarray(channels), np.asarray(status)


def _predict_rows(dataset: Dataset, values: Float[Array, " p"]) -> tuple[Array, Array]:
    reading = dataset.predict(values)
    return _stack_channels(reading), reading.status


def predict_row_channels(dataset: Dataset, values: Float[Array, " p"]) -> np.ndarray:
    """Return both predicted channels at every (padded) row, (2, n), SI, compiled."""
    return predict_rows(dataset, values)[0]


def compute_si_misfit(dataset: Dataset, values: Float[Array, " p"]) -> np.ndarray:
    """Return measured − model of both channels at every (padded) row, (2, n), SI."""
    rows = dataset.rows
    return np.stack([rows.force, rows.diameter]) - predict_row_channels(dataset, values)


def _compute_padded_size(n: int) -> int:
    """Return the number of rows with padding: a power of two up to 512, then a multiple of 512."""
    return max(8, 1 << (n - 1).bit_length()) if n <= 512 else 512 * math.ceil(n / 512)


@dataclass(frozen=True, eq=False)
class CaseRows:
    """The samples of a case, and what follows from all of them.

    Attributes:
        case: the recording and its muscle.toml.
        sds: standard deviations of force, or of a measured length, and of diameter, SI.
        is_informative: (2, n) whether a sample of each channel is informative.
        is_slack: (n,) whether the muscle exerts nearly no force.
        length_level: (n,) index of the length level.
    """

    case: Case
    sds: tuple[float, float]
    is_informative: np.ndarray
    is_slack: np.ndarray
    length_level: np.ndarray

    @classmethod
    def from_case(cls, case: Case) -> CaseRows:
        """Return the samples of a case."""
        recording = case.recording
        return cls(
            case=case,
            sds=estimate_starting_sd(case),
            is_informative=np.stack([find_informative_samples(case, c) for c in recording.model_channels]),
            is_slack=find_slack_samples(case),
            length_level=assign_length_levels(recording).clip(min=0),
        )

    def pad(self, rows: slice, size: int) -> PaddedRows:
        """Return some of the samples, padded to `size` rows."""
        recording = self.case.recording
        pressure, length = recording.pressure[rows], recording.length[rows]
        usable = np.isfinite(pressure) & np.isfinite(length)

        def pad(array, fill=0.0):
            # The weight of a padded row is zero.
            padded_array = np.full(size, fill, dtype=np.asarray(array).dtype)
            padded_array[: usable.size] = array
            return jnp.asarray(padded_array)

        def channel(k):
            informative = self.is_informative[k, rows]
            measured = np.where(informative, getattr(recording, recording.model_channels[k])[rows], 0.0)
            return pad(measured), pad(np.where(informative, 1.0 / self.sds[k], 0.0))

        (force, force_weight), (diameter, diameter_weight) = channel(0), channel(1)
        pressure = np.where(usable, pressure, 0.0)
        length = np.where(usable, length, self.case.muscle_toml.rest_length.value)
        set_force = pad(np.nan_to_num(recording.force[rows])) if recording.measures_length else None
        return PaddedRows(
            # The last state is repeated, because a model with memory may run through the recording twice.
            pressure=pad(pressure, pressure[-1]),
            length=pad(length, length[-1]),
            force=force,
            diameter=diameter,
            force_weight=force_weight,
            diameter_weight=diameter_weight,
            length_level=pad(self.length_level[rows], 0),
            is_slack=pad(self.is_slack[rows], False),
            training_mask=pad(usable.astype(float)),
            set_force=set_force,
        )


def build_rows(case: Case, size: int | None = None) -> PaddedRows:
    """Return the samples of a case, padded to `size` rows; None for `_compute_padded_size`."""
    n = case.recording.n
    return CaseRows.from_case(case).pad(slice(0, n), size or _compute_padded_size(n))
