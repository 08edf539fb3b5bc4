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
from pamjax.infer.fitting.fit import joint_space
from pamjax.infer.problem.dataset import CHANNELS, Member, case_history, counts, sample_rows
from pamjax.infer.problem.priors import stated, stated_mechanisms
from pamjax.model.assembly import bench_law
from pamjax.model.bench import LASTING
from pamjax.model.parameters import meaning
from pamjax.model.registry import MECHANISMS
from pamjax.parameter import Meaning
from pamjax.records.case import Case
from pamjax.records.fixed_length import held
from pamjax.records.reading.quantity import Measured

#: Rows of the shortest program. Longer ones have twice as many, and so on: those beyond a recording's cost
#: little, and recordings of other lengths need no program of their own.
SHORTEST = 640

#: Numbers in which one sweep takes derivatives, at most.
SLOTS = 32

#: How many of them are taken side by side.
TOGETHER = 4

#: A number that was measured stays within this many of its standard deviations: further off, the lab has
#: not made an error of measurement, but the model one of physics.
REACH = 3.0

#: Factor within which the threads' stiffness stays of what the lab believes of it.
STIFFNESS_REACH = 5.0

#: A presliding distance is at least this many times the noise of length: the friction of a shorter one
#: would answer to that noise, which stands in the residual as well.
ABOVE_NOISE = 10.0

#: How far a tube in a braid may be from its size as bought, where the lab says nothing of it: it is
#: stretched or squeezed to fit.
FITTED = 0.1

#: The mechanism that costs as much as all others together: left out of the program while it has no share.
COSTLY = "end_taper"

#: What leaves something to later samples, so that a recording is passed twice while one of them is on.
REMEMBERING = {kind.id for kind in MECHANISMS if issubclass(kind, LASTING)}

#: The threads' compliance, of which an inelastic braid has none.
COMPLIANCE = "braid_elasticity.compliance"


@dataclass(frozen=True, eq=False)
class Problem:
    """A recording, its muscle with the whole library, and what is believed of every number.

    Attributes:
        case: the recording, held lengths as one, and what the lab says of it.
        law: the baseline, "inelastic" or "elastic".
        names: (p,) of all numbers.
        meaning: (p,) their meanings.
        neutral: (p,) the baseline's values with every mechanism switched off, SI.
        start: (p,) where a number starts once it may move, SI.
        low, high: (p,) limits, SI.
        sd: (p,) of the prior around `start`, SI; infinite where there is none.
        own: (p,) whether the baseline itself moves the number.
        member: the compiled program's arrays.
        lighter: the same without the costliest mechanism, for as long as that is switched off.
        measured: (2, n) force and diameter, SI; NaN where there is nothing to compare.
    """

    case: Case
    law: str
    names: tuple[str, ...]
    meaning: tuple[Meaning, ...]
    neutral: np.ndarray
    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    sd: np.ndarray
    own: np.ndarray
    member: Member
    lighter: Member
    measured: np.ndarray

    @property
    def log(self) -> np.ndarray:
        """(p,) whether a number moves on a logarithmic scale."""
        return np.array([m.scale == "log" for m in self.meaning])

    @property
    def switch(self) -> np.ndarray:
        """(p,) whether a number switches its mechanism on."""
        return np.array([m.neutral is not None for m in self.meaning])

    @property
    def n(self) -> int:
        """How many rows there are."""
        return self.case.recording.n

    def place(self, name: str) -> int:
        """Index of a number."""
        return self.names.index(name)

    def shows(self, values: np.ndarray) -> np.ndarray:
        """What the bench shows at these values: force (N) and diameter (m), (2, n)."""
        return self.slopes(values, ())[0]

    def on(self, values: np.ndarray) -> set[str]:
        """Ids of the mechanisms that are switched on at these values."""
        return {_id(self.names[k]) for k in np.flatnonzero((values != self.neutral) & self.switch)}

    def compile(self) -> None:
        """Begin to compile both programs, side by side; whoever needs one waits for it."""
        for member in (self.lighter, self.member):
            programs.begin(_sweep, *_asked(member, self.neutral, (), True))

    def slopes(self, values: np.ndarray, places) -> tuple[np.ndarray, np.ndarray]:
        """What the bench shows, (2, n), and its derivative by each of the numbers, (k, 2, n), SI."""
        places, on = np.array(list(places), dtype=int), self.on(values)
        of = [_id(self.names[k]) for k in places]
        member = self.member if COSTLY in on or COSTLY in of else self.lighter
        lasting = np.array([bool(REMEMBERING & (on | {id})) for id in of], dtype=bool)
        shown, slopes = None, np.empty((places.size, 2, self.n))
        for twice in (False, True):
            some = np.flatnonzero(lasting == twice)
            for k in range(0, some.size, SLOTS):
                now = some[k : k + SLOTS]
                shown, slopes[now] = self._swept(member, values, places[now], twice)
        if shown is None:
            shown, _ = self._swept(member, values, (), bool(REMEMBERING & on))
        return shown, slopes

    def _swept(self, member: Member, values, places, twice: bool) -> tuple[np.ndarray, np.ndarray]:
        shown, slopes = programs.ready(_sweep, *_asked(member, values, places, twice))
        return np.asarray(shown)[:, : self.n], np.asarray(slopes)[: len(places), :, : self.n]


def _id(name: str) -> str:
    return name.partition(".")[0]


def _asked(member: Member, values, places, twice: bool) -> tuple:
    slots = np.zeros(SLOTS, dtype=int)
    slots[: len(places)] = places
    counts = jnp.asarray(len(places)), jnp.asarray(twice)
    return member, jnp.asarray(values), jnp.asarray(slots), *counts


@eqx.filter_jit
def _sweep(
    member: Member, values: Float[Array, " p"], slots: Array, many: Array, twice: Array
) -> tuple[Array, Array]:
    """What is shown, and its derivative by the first `many` of the numbers in `slots`.

    `twice` says whether any of them, or of what is switched on, leaves something to later samples.
    """
    member = eqx.tree_at(lambda m: m.history.lasting, member, twice, is_leaf=lambda x: x is None)

    def shows(x):
        reading = member.reading(x)
        return jnp.stack([reading.force, reading.diameter])

    def fill(k, carry):
        _, found = carry
        now = jax.lax.dynamic_slice_in_dim(slots, k * TOGETHER, TOGETHER)
        tangents = jax.nn.one_hot(now, values.size, dtype=values.dtype)
        # Side by side: what all directions share is worked out once for them, while it is in the cache.
        shown, along = jax.vmap(lambda t: jax.jvp(shows, (values,), (t,)), out_axes=(None, 0))(tangents)
        return shown, jax.lax.dynamic_update_slice_in_dim(found, along, k * TOGETHER, 0)

    nothing = jnp.zeros((2, member.rows.pressure.size))
    rounds = jnp.maximum(-(-many // TOGETHER), 1)
    return jax.lax.fori_loop(0, rounds, fill, (nothing, jnp.zeros((SLOTS, *nothing.shape))))


def program_rows(n: int) -> int:
    """Rows of the program that a recording of n rows runs in.

    >>> [program_rows(n) for n in (5, 870, 5000)]
    [640, 1280, 5120]
    """
    return SHORTEST * 2 ** max(math.ceil(math.log2(max(n, 1) / SHORTEST)), 0)


def problem(case: Case) -> Problem:
    """Put a recording before the whole library.

    Args:
        case: the recording and what the lab says of it; its baseline is inelastic or elastic.

    Raises:
        BadInput: for a baseline that no bench has, or nothing to compare with.
    """
    case = held(case)
    law = bench_law(case.entry.baseline, ())
    ids = tuple(kind.id for kind in MECHANISMS)
    at, _ = joint_space([case], law, ())
    believed = stated(case.entry, law) | _mechanisms(case, law, ids)
    believed["bladder_elasticity.inner_diameter"] = _fitted(believed["bladder_elasticity.inner_diameter"])
    rulers = {n: Measured(0.0, float(at.sd[i])) for i, n in enumerate(at.names) if n not in believed}
    believed |= rulers
    names = tuple(believed)
    meanings = tuple(meaning(n) if n not in rulers else _ruler(at, n) for n in names)
    start = np.array([m.value for m in believed.values()])
    sd = np.array([m.sd if m.sd > 0 else math.inf for m in believed.values()])
    own = np.isin(names, at.names)
    neutral = np.array([v if m.neutral is None else m.neutral for v, m in zip(start, meanings, strict=True)])
    low, high = _limits(names, meanings, start, sd, own)
    k = names.index("braid_friction.presliding")
    low[k] = max(low[k], ABOVE_NOISE * (case.entry.sensors.length or 0.0))
    recording, size = case.recording, program_rows(case.recording.n)
    if recording.time is not None:
        # A slip that a recording shows happened in it.
        k = names.index("thread_slip.when")
        low[k], high[k] = recording.time[0], max(recording.time[-1], recording.time[0] + 1)
        start[k] = np.clip(start[k], low[k], high[k])
    place = {n: i for i, n in enumerate(names)}
    member = Member(
        law=law,
        mechanisms=ids,
        owns=tuple((n, i) for n, i in place.items() if n not in rulers),
        length_errors=tuple(place[n] for n in rulers),
        known={},
        rows=sample_rows(case, size),
        history=case_history(case, size, padding=False),
        trust=jnp.ones(2),
    )
    measured = np.stack([np.where(counts(case, c), getattr(recording, c), np.nan) for c in CHANNELS])
    if not np.isfinite(measured).any():
        raise refuse(
            "a diagnosis compares force and diameter where the muscle is inflated and taut", "no such row",
            remedy="Inflate the muscle further, or check the zero of `pressure`.",
        )  # fmt: skip
    lighter = dataclasses.replace(member, mechanisms=tuple(id for id in ids if id != COSTLY))
    return Problem(case, law, names, meanings, neutral, start, low, high, sd, own, member, lighter, measured)


def _mechanisms(case: Case, law: str, ids: tuple[str, ...]) -> dict[str, Measured]:
    """The mechanisms' numbers; of an inelastic braid its compliance too, believed as its threads are."""
    found = stated_mechanisms(case.entry, ids)
    if law == "inelastic":
        found[COMPLIANCE] = _compliance(case)
    return found


def _fitted(size: Measured) -> Measured:
    return size if size.sd > 0 else Measured(size.value, FITTED * size.value)


def _compliance(case: Case) -> Measured:
    entry = case.entry
    if entry.stiffness is not None:
        return Measured(1 / entry.stiffness.value, entry.stiffness.sd / entry.stiffness.value**2)
    if entry.modulus is not None and entry.threads and entry.thread_area is not None:
        pull = entry.modulus.value * entry.threads * entry.thread_area.value
        return Measured(1 / pull, entry.modulus.sd / entry.modulus.value / pull)
    return Measured(1e-6, math.inf)


def _ruler(at, name: str) -> Meaning:
    sd = float(at.sd[at.names.index(name)])
    about = "true minus written length of one setting"
    return Meaning("m", "mm", -8 * sd, 8 * sd, "linear", about, "the ruler's own standard deviation")


def _limits(names, meanings, start, sd, own) -> tuple[np.ndarray, np.ndarray]:
    low = np.array([m.low for m in meanings])
    high = np.array([m.high for m in meanings])
    for k, name in enumerate(names):
        if not own[k]:
            continue
        if name in ("thread.modulus", "thread.stiffness"):
            low[k], high[k] = (
                max(low[k], start[k] / STIFFNESS_REACH),
                min(high[k], start[k] * STIFFNESS_REACH),
            )
        elif math.isfinite(sd[k]):
            low[k], high[k] = max(low[k], start[k] - REACH * sd[k]), min(high[k], start[k] + REACH * sd[k])
    return low, high
