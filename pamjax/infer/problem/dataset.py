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

from pamjax.infer.problem.parameter_space import Space
from pamjax.infer.problem.priors import free_numbers, is_ruler, stated, stated_mechanisms
from pamjax.model.assembly import assemble, assemble_bench
from pamjax.model.bench import Bench, Shown, unpushed
from pamjax.model.history import History, history
from pamjax.model.muscle import Muscle, Reading
from pamjax.records.blocks import blocks, setting_of_length
from pamjax.records.case import Case

#: The channels a fit looks at, in the order in which they are stacked.
CHANNELS = ("force", "diameter")

#: Force below this share of the largest one counts as a slack muscle's when the model would push.
SLACK = 0.02

#: A pressure of fewer standard deviations of its sensor than this cannot be told from none.
EMPTY = 3.0

#: Samples by whose median it is told whether a muscle is slack: at most, and as a share of their block.
NEIGHBOURS, OF_BLOCK = 15, 1 / 30
#: Standard deviations of the load cell that no sample's noise reaches.
BEYOND_NOISE = 4.0


class Rows(eqx.Module):
    """The samples of a recording as arrays, padded; a padded or unmeasured sample has weight zero.

    Attributes:
        pressure, length: (n,) what was set, SI.
        force, diameter: (n,) what was measured, SI; zero where it was not.
        force_weight, diameter_weight: (n,) one over the standard deviation of a sample, or zero.
        setting: (n,) index of the length setting of a row.
        slack: (n,) whether the muscle pulled with (nearly) nothing.
        used: (n,) one where a fit may look, zero where it may not (held out, or padding).
    """

    pressure: Float[Array, " n"]
    length: Float[Array, " n"]
    force: Float[Array, " n"]
    diameter: Float[Array, " n"]
    force_weight: Float[Array, " n"]
    diameter_weight: Float[Array, " n"]
    setting: Int[Array, " n"]
    slack: Bool[Array, " n"]
    used: Float[Array, " n"]


class Member(eqx.Module):
    """One case of a fit.

    Attributes:
        law: thread law, a key of `catalogue.LAWS`.
        mechanisms: ids of the mechanisms; without any the muscle alone is computed.
        owns: names of the muscle's free numbers, and where each stands in the space.
        length_errors: where the errors of the length settings stand in the space.
        known: the muscle's other numbers, SI.
        rows: the samples.
        history: their order in time.
        trust: (2,) factor on the misfit of force and of diameter: below one where samples repeat
            each other (see `noise.py`).
    """

    law: str = eqx.field(static=True)
    mechanisms: tuple[str, ...] = eqx.field(static=True)
    owns: tuple[tuple[str, int], ...] = eqx.field(static=True)
    length_errors: tuple[int, ...] = eqx.field(static=True)
    known: dict[str, Array]
    rows: Rows
    history: History
    trust: Float[Array, " 2"]

    def numbers(self, values: Float[Array, " p"]) -> dict[str, Array]:
        """Every number of the muscle by name, SI, at a point of the space given as values."""
        return self.known | {name: values[i] for name, i in self.owns}

    def muscle(self, values: Float[Array, " p"]) -> Muscle:
        """The muscle without its mechanisms, at a point of the space given as values."""
        return assemble(self.law, self.numbers(values))

    def bench(self, values: Float[Array, " p"]) -> Bench:
        """The muscle with its mechanisms, at a point of the space given as values."""
        return assemble_bench(self.law, self.mechanisms, self.numbers(values))

    def reading(self, values: Float[Array, " p"]) -> Reading | Shown:
        """What the bench shows at every row."""
        length = self.rows.length
        if self.length_errors:
            length = length + values[jnp.array(self.length_errors)][self.rows.setting]
        if self.mechanisms:
            return self.bench(values)(self.rows.pressure, length, self.history, self.rows.slack)
        ideal = jax.vmap(self.muscle(values))(self.rows.pressure, length)
        return eqx.tree_at(lambda r: r.force, ideal, unpushed(ideal.force, self.rows.slack))

    def misfit(self, values: Float[Array, " p"]) -> tuple[Array, Array]:
        """(measured − model) / sd of force and of diameter, (n,) each; zero where not measured."""
        reading, rows = self.reading(values), self.rows
        return (
            (rows.force - reading.force) * rows.force_weight,
            (rows.diameter - reading.diameter) * rows.diameter_weight,
        )


def member(case: Case, law: str, at: Space, rename: dict[str, str], mechanisms: Sequence[str] = ()) -> Member:
    """Put a case into a space.

    Args:
        case: the recording and what is known of its muscle.
        law: thread law, a key of `catalogue.LAWS`.
        at: the space that holds the case's free numbers.
        rename: name in the space of each of the case's free numbers.
        mechanisms: ids of the mechanisms that act beside the threads.
    """
    free = [n.name for n in free_numbers(case, law, mechanisms)]
    place = {name: at.names.index(rename.get(name, name)) for name in free}
    numbers = stated(case.entry, law) | stated_mechanisms(case.entry, mechanisms)
    return Member(
        law=law,
        mechanisms=tuple(mechanisms),
        owns=tuple((n, i) for n, i in place.items() if not is_ruler(n)),
        length_errors=tuple(i for n, i in place.items() if is_ruler(n)),
        known={n: jnp.asarray(m.value) for n, m in numbers.items() if n not in place},
        rows=sample_rows(case),
        history=case_history(case),
        trust=jnp.ones(2),
    )


def case_history(case: Case, size: int | None = None, padding: bool = True) -> History:
    """The order of a case's samples in time, padded to `size` (by itself: `padded`).

    Without `padding`, padded samples are not worked out.
    """
    recording = case.recording
    return history(
        recording.time,
        recording.starts,
        restart=case.gaps == "anew",
        settled=case.before == "settled",
        turning=recording.strokes,
        size=size or padded(recording.n),
        padding=padding,
    )


@eqx.filter_jit
def read(one: Member, values: Float[Array, " p"]) -> Reading | Shown:
    """What the muscle shows at every (padded) row, compiled."""
    return one.reading(values)


def slack(case: Case) -> np.ndarray:
    """(n,) whether the muscle pulled with nearly nothing, by the median of each sample's neighbours.

    By its own force a sample would be kept for its noise: those kept beside the threshold then lie too high.
    Only one that is farther below than noise goes by itself: where a muscle straightens at once, its
    neighbours already pull.
    """
    recording, sd = case.recording, case.entry.sensors.force
    top = np.nanmax(np.abs(recording.force[recording.usable]), initial=0.0)
    force = pd.Series(np.where(recording.usable, recording.force, np.nan))
    # The rows of a static map stand in no order, and have no neighbours.
    for _, block in force.groupby(blocks(recording).label) if recording.time is not None else ():
        near = max(1, min(NEIGHBOURS, int(OF_BLOCK * block.size)))
        force[block.index] = block.rolling(near, center=True, min_periods=1).median()
    below = recording.force < SLACK * top - BEYOND_NOISE * (np.inf if sd is None else sd)
    return (force.fillna(np.inf).to_numpy() < SLACK * top) | (below & recording.usable)


def counts(case: Case, channel: str) -> np.ndarray:
    """(n,) whether a sample of a channel says something about the model.

    At a fixed length a force near zero only says that the muscle is slack there, or bowed, until it
    is inflated further: not how strong it is. On a stroke it says where the stroke ends. Nor does anything
    hold the braid open there while the muscle is slack, or its pressure cannot be told from none: any
    diameter will do. (Of a sensor whose noise is not stated, what it reads above zero is pressure.)
    """
    there = case.recording.usable & np.isfinite(getattr(case.recording, channel))
    if blocks(case.recording).kind != "lengths":
        return there
    there = there & ~slack(case)
    if channel == "force":
        return there
    return there & (case.recording.pressure > EMPTY * (case.entry.sensors.pressure or 0.0))


def padded(n: int) -> int:
    """Number of rows an array is padded to: a power of two up to 512, then a multiple of 512."""
    return max(8, 1 << (n - 1).bit_length()) if n <= 512 else 512 * math.ceil(n / 512)


def sample_rows(case: Case, size: int | None = None) -> Rows:
    """The samples of a case, padded to `size` (by itself: `padded`)."""
    recording = case.recording
    size = size or padded(recording.n)
    good = recording.usable
    force_sd, diameter_sd = starting_sd(case)

    def pad(array, fill=0.0):
        # The weight of a padded row is zero.
        out = np.full(size, fill, dtype=np.asarray(array).dtype)
        out[: recording.n] = array
        return jnp.asarray(out)

    def channel(name, sd):
        there = counts(case, name)
        measured = np.where(there, getattr(recording, name), 0.0)
        return pad(measured), pad(np.where(there, 1.0 / sd, 0.0))

    force, force_weight = channel("force", force_sd)
    diameter, diameter_weight = channel("diameter", diameter_sd)
    pressure = np.where(good, recording.pressure, 0.0)
    length = np.where(good, recording.length, case.entry.rest_length.value)
    return Rows(
        # The last state is repeated: a muscle that goes through its recording twice is nowhere else between.
        pressure=pad(pressure, pressure[-1]),
        length=pad(length, length[-1]),
        force=force,
        diameter=diameter,
        force_weight=force_weight,
        diameter_weight=diameter_weight,
        setting=pad(setting_of_length(recording).clip(min=0), 0),
        slack=pad(slack(case), False),
        used=pad(good.astype(float)),
    )


def starting_sd(case: Case) -> tuple[float, float]:
    """Standard deviation of a sample of force (N) and of diameter (m) before anything was fitted.

    The sensor's own where it is given; else one percent of the channel's range, which only sets the
    balance of the first fit and is replaced by what its residual shows.
    """
    recording, sensors = case.recording, case.entry.sensors
    return (
        sensors.force or _one_percent(recording.force),
        sensors.diameter or _one_percent(recording.diameter),
    )


def _one_percent(channel: np.ndarray) -> float:
    there = channel[np.isfinite(channel)]
    spread = float(np.ptp(there)) if there.size > 1 else 0.0
    return 0.01 * spread or 1.0
