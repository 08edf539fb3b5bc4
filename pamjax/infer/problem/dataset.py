"""One recording in a fit: its numbers, its arrays, and what the muscle would have shown.

Shapes are padded to few sizes and everything that differs from case to case is an array, so that
recordings of one kind share one compiled program.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Bool, Float, Int

from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.priors import (
    collect_mechanism_values,
    collect_stated_values,
    is_length_error,
    list_free_parameters,
)
from pamjax.model.assembly import assemble, assemble_bench
from pamjax.model.bench import Bench, BenchReading, clip_slack_force
from pamjax.model.history import History, build_time_history
from pamjax.model.muscle import Muscle, MuscleReading
from pamjax.records.blocks import find_blocks, find_length_settings
from pamjax.records.case import Case

#: The channels a fit looks at, in the order in which they are stacked.
CHANNELS = ("force", "diameter")

#: Force below this share of the largest one counts as a slack muscle's when the model would push.
MAX_SLACK_FORCE_SHARE = 0.02

#: A pressure of fewer standard deviations of its sensor than this cannot be told from none.
MIN_PRESSURE_SD = 3.0

#: Samples by whose median it is told whether a muscle is slack: at most, and as a share of their block.
MAX_MEDIAN_SAMPLES, MEDIAN_BLOCK_SHARE = 15, 1 / 30
#: Standard deviations of the load cell that no sample's noise reaches.
MAX_NOISE_SD = 4.0


class PaddedRows(eqx.Module):
    """The samples of a recording as arrays, padded; a padded or unmeasured sample has weight zero.

    Attributes:
        pressure, length: (n,) what was set, SI.
        force, diameter: (n,) what was measured, SI; zero where it was not.
        force_weight, diameter_weight: (n,) one over the standard deviation of a sample, or zero.
        length_setting: (n,) index of the length setting of a row.
        is_slack: (n,) whether the muscle pulled with (nearly) nothing.
        training_mask: (n,) one where a fit may look, zero where it may not (held out, or padding).
    """

    pressure: Float[Array, " n"]
    length: Float[Array, " n"]
    force: Float[Array, " n"]
    diameter: Float[Array, " n"]
    force_weight: Float[Array, " n"]
    diameter_weight: Float[Array, " n"]
    length_setting: Int[Array, " n"]
    is_slack: Bool[Array, " n"]
    training_mask: Float[Array, " n"]


class Dataset(eqx.Module):
    """One case of a fit.

    Attributes:
        law: thread law, a key of `catalogue.LAWS`.
        mechanisms: ids of the mechanisms; without any the muscle alone is computed.
        free_parameters: names of the muscle's free numbers, and where each stands in the space.
        length_error_indices: where the errors of the length settings stand in the space.
        fixed_values: the muscle's other numbers, SI.
        rows: the samples.
        history: their order in time.
        channel_weights: (2,) factor on the misfit of force and of diameter: below one where samples repeat
            each other (see `sensor_noise.py`).
    """

    law: str = eqx.field(static=True)
    mechanisms: tuple[str, ...] = eqx.field(static=True)
    free_parameters: tuple[tuple[str, int], ...] = eqx.field(static=True)
    length_error_indices: tuple[int, ...] = eqx.field(static=True)
    fixed_values: dict[str, Array]
    rows: PaddedRows
    history: History
    channel_weights: Float[Array, " 2"]

    def collect_parameters(self, values: Float[Array, " p"]) -> dict[str, Array]:
        """Every number of the muscle by name, SI, at a point of the space given as values."""
        return self.fixed_values | {name: values[i] for name, i in self.free_parameters}

    def build_muscle(self, values: Float[Array, " p"]) -> Muscle:
        """The muscle without its mechanisms, at a point of the space given as values."""
        return assemble(self.law, self.collect_parameters(values))

    def build_bench(self, values: Float[Array, " p"]) -> Bench:
        """The muscle with its mechanisms, at a point of the space given as values."""
        return assemble_bench(self.law, self.mechanisms, self.collect_parameters(values))

    def predict(self, values: Float[Array, " p"]) -> MuscleReading | BenchReading:
        """What the bench shows at every row."""
        length = self.rows.length
        if self.length_error_indices:
            length = length + values[jnp.array(self.length_error_indices)][self.rows.length_setting]
        if self.mechanisms:
            return self.build_bench(values)(self.rows.pressure, length, self.history, self.rows.is_slack)
        ideal = jax.vmap(self.build_muscle(values))(self.rows.pressure, length)
        return eqx.tree_at(lambda r: r.force, ideal, clip_slack_force(ideal.force, self.rows.is_slack))

    def compute_standardised_residuals(self, values: Float[Array, " p"]) -> tuple[Array, Array]:
        """(measured − model) / sd of force and of diameter, (n,) each; zero where not measured."""
        reading, rows = self.predict(values), self.rows
        return (
            (rows.force - reading.force) * rows.force_weight,
            (rows.diameter - reading.diameter) * rows.diameter_weight,
        )


def build_dataset(
    case: Case, law: str, space: ParameterSpace, space_names: dict[str, str], mechanisms: Sequence[str] = ()
) -> Dataset:
    """Put a case into a space.

    Args:
        case: the recording and what is known of its muscle.
        law: thread law, a key of `catalogue.LAWS`.
        space: the space that holds the case's free numbers.
        space_names: name in the space of each of the case's free numbers.
        mechanisms: ids of the mechanisms that act beside the threads.
    """
    free = [n.name for n in list_free_parameters(case, law, mechanisms)]
    indices = {name: space.names.index(space_names.get(name, name)) for name in free}
    numbers = collect_stated_values(case.entry, law) | collect_mechanism_values(case.entry, mechanisms)
    return Dataset(
        law=law,
        mechanisms=tuple(mechanisms),
        free_parameters=tuple((n, i) for n, i in indices.items() if not is_length_error(n)),
        length_error_indices=tuple(i for n, i in indices.items() if is_length_error(n)),
        fixed_values={n: jnp.asarray(m.value) for n, m in numbers.items() if n not in indices},
        rows=build_rows(case),
        history=build_history(case),
        channel_weights=jnp.ones(2),
    )


def build_history(case: Case, size: int | None = None, padding: bool = True) -> History:
    """The order of a case's samples in time, padded to `size` (by itself: `compute_padded_size`).

    Without `padding`, padded samples are not worked out.
    """
    recording = case.recording
    return build_time_history(
        recording.time,
        recording.starts,
        restart=case.gaps == "anew",
        settled=case.before == "settled",
        stroke_channels=recording.length_and_pressure,
        size=size or compute_padded_size(recording.n),
        padding=padding,
    )


@eqx.filter_jit
def predict_rows(dataset: Dataset, values: Float[Array, " p"]) -> MuscleReading | BenchReading:
    """What the muscle shows at every (padded) row, compiled."""
    return dataset.predict(values)


def find_slack_samples(case: Case) -> np.ndarray:
    """(n,) whether the muscle pulled with nearly nothing, by the median of each sample's neighbours.

    By its own force a sample would be kept for its noise: those kept beside the threshold then lie too high.
    Only one that is farther below than noise goes by itself: where a muscle straightens at once, its
    neighbours already pull.
    """
    recording, sd = case.recording, case.entry.sensors.force
    top = np.nanmax(np.abs(recording.force[recording.usable]), initial=0.0)
    force = pd.Series(np.where(recording.usable, recording.force, np.nan))
    # The rows of a static map stand in no order, and have no neighbours.
    for _, block in force.groupby(find_blocks(recording).label) if recording.time is not None else ():
        near = max(1, min(MAX_MEDIAN_SAMPLES, int(MEDIAN_BLOCK_SHARE * block.size)))
        force[block.index] = block.rolling(near, center=True, min_periods=1).median()
    below = recording.force < MAX_SLACK_FORCE_SHARE * top - MAX_NOISE_SD * (np.inf if sd is None else sd)
    return (force.fillna(np.inf).to_numpy() < MAX_SLACK_FORCE_SHARE * top) | (below & recording.usable)


def find_informative_samples(case: Case, channel: str) -> np.ndarray:
    """(n,) whether a sample of a channel says something about the model.

    At a fixed length a force near zero only says that the muscle is slack there, or bowed, until it
    is inflated further: not how strong it is. On a stroke it says where the stroke ends. Nor does anything
    hold the braid open there while the muscle is slack, or its pressure cannot be told from none: any
    diameter will do. (Of a sensor whose noise is not stated, what it reads above zero is pressure.)
    """
    informative = case.recording.usable & np.isfinite(getattr(case.recording, channel))
    if find_blocks(case.recording).kind != "lengths":
        return informative
    informative = informative & ~find_slack_samples(case)
    if channel == "force":
        return informative
    return informative & (case.recording.pressure > MIN_PRESSURE_SD * (case.entry.sensors.pressure or 0.0))


def compute_padded_size(n: int) -> int:
    """Number of rows an array is padded to: a power of two up to 512, then a multiple of 512."""
    return max(8, 1 << (n - 1).bit_length()) if n <= 512 else 512 * math.ceil(n / 512)


def build_rows(case: Case, size: int | None = None) -> PaddedRows:
    """The samples of a case, padded to `size` (by itself: `compute_padded_size`)."""
    recording = case.recording
    size = size or compute_padded_size(recording.n)
    usable = recording.usable
    force_sd, diameter_sd = estimate_starting_sd(case)

    def pad(array, fill=0.0):
        # The weight of a padded row is zero.
        out = np.full(size, fill, dtype=np.asarray(array).dtype)
        out[: recording.n] = array
        return jnp.asarray(out)

    def channel(name, sd):
        informative = find_informative_samples(case, name)
        measured = np.where(informative, getattr(recording, name), 0.0)
        return pad(measured), pad(np.where(informative, 1.0 / sd, 0.0))

    force, force_weight = channel("force", force_sd)
    diameter, diameter_weight = channel("diameter", diameter_sd)
    pressure = np.where(usable, recording.pressure, 0.0)
    length = np.where(usable, recording.length, case.entry.rest_length.value)
    return PaddedRows(
        # The last state is repeated: a muscle that goes through its recording twice is nowhere else between.
        pressure=pad(pressure, pressure[-1]),
        length=pad(length, length[-1]),
        force=force,
        diameter=diameter,
        force_weight=force_weight,
        diameter_weight=diameter_weight,
        length_setting=pad(find_length_settings(recording).clip(min=0), 0),
        is_slack=pad(find_slack_samples(case), False),
        training_mask=pad(usable.astype(float)),
    )


def estimate_starting_sd(case: Case) -> tuple[float, float]:
    """Standard deviation of a sample of force (N) and of diameter (m) before anything was fitted.

    The sensor's own where it is given; else one percent of the channel's range, which only sets the
    balance of the first fit and is replaced by what its residual shows.
    """
    recording, sensors = case.recording, case.entry.sensors
    return (
        sensors.force or _compute_one_percent(recording.force),
        sensors.diameter or _compute_one_percent(recording.diameter),
    )


def _compute_one_percent(channel: np.ndarray) -> float:
    measured = channel[np.isfinite(channel)]
    value_range = float(np.ptp(measured)) if measured.size > 1 else 0.0
    return 0.01 * value_range or 1.0
