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

from pamjax.infer.fitting.fit import joint_space
from pamjax.infer.fitting.least_squares import solve
from pamjax.infer.fitting.reweight import weigh
from pamjax.infer.problem.dataset import Member, member
from pamjax.infer.problem.parameter_space import Free, Space, space
from pamjax.infer.problem.priors import free_numbers, is_ruler
from pamjax.model.parameters import RULER, meaning
from pamjax.planning.bench import Means
from pamjax.planning.runs import Run, set_lengths
from pamjax.records.blocks import setting_of_length
from pamjax.records.case import Case
from pamjax.records.reading.muscle_toml import Entry
from pamjax.records.recording import Recording

#: Truths at which information is taken.
TRUTHS = 9

#: Samples of a run at which its information is taken; more of them tell so much more, in proportion.
MOST = 200

#: No truth is drawn beyond this many standard deviations: there the fit itself would ask questions.
FAR = 2.0


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is believed before the next run.

    Attributes:
        entry: what muscle.toml says.
        means: what the rig can do.
        law: thread law.
        at: every number that a fit would move, the rig's zeros, gains and set lengths too, with its prior.
        free: the same numbers as they are declared: the muscle's, zeros and gains, errors of set lengths.
        mean: (p,) where they are believed to be, SI.
        scale: (p,) the step in which each is measured, SI: its prior's sd, or a share of its limits.
        before: (p, p) information of priors and of the recording at hand, in those steps.
        missed: by channel of that recording, how many times its noise the muscle misses it by, in rms.
    """

    entry: Entry
    means: Means
    law: str
    at: Space
    free: tuple[Free, ...]
    mean: np.ndarray
    scale: np.ndarray
    before: np.ndarray
    missed: Mapping[str, float] = field(default_factory=dict)

    def place(self, name: str) -> int:
        """Index of a number."""
        return self.at.names.index(name)

    @property
    def own(self) -> list[int]:
        """Indices of the muscle's numbers, without the rig's."""
        return [k for k, n in enumerate(self.at.names) if n not in self.means.off and not is_ruler(n)]

    def truths(self, many: int = TRUTHS, seed: int = 0) -> np.ndarray:
        """Values that the numbers may truly have, (many, p), SI; the first are the believed ones."""
        # A number that nothing is known of is drawn within its step, and not over all its limits.
        inverse = np.linalg.inv(self.before + np.diag(1.0 * ~np.isfinite(np.asarray(self.at.sd))))
        draws = np.random.default_rng(seed).standard_normal((many, self.mean.size))
        draws = np.clip(_spread_evenly(draws), -FAR, FAR)
        draws[0] = 0.0
        values = self.mean + draws @ np.linalg.cholesky(inverse).T * self.scale
        low, high = np.asarray(self.at.low), np.asarray(self.at.high)
        inside = 1e-3 * (high - low)
        return np.clip(values, np.minimum(low + inside, self.mean), np.maximum(high - inside, self.mean))

    def information(
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
        n, many = label.size, len(self.own)
        one = member(without_rulers(case), self.law, space(self.free[:many]), {})
        at, rows = jnp.asarray(values[:many]), one.rows
        slopes, shown, by_set = (np.asarray(x)[..., :n] for x in _slopes(one, at))
        off = self._off(by_set, shown, np.asarray(rows.pressure)[:n])
        slopes = np.concatenate([slopes, off, self._rulers(by_set[1], setting)])
        noise = [x**2 if x else math.inf for x in (self.means.force, self.means.diameter)]
        carried = (self.means.gauge * by_set[0]) ** 2 + (self.means.ruler * by_set[1]) ** 2
        variance = np.array(noise)[:, None] + carried
        # A slack muscle tells nothing, and one without an answer less.
        there = np.isfinite(variance) & np.isfinite(slopes).all(axis=0) & (shown[0] > 0)
        # What the muscle missed so far it will miss again.
        again = np.array([max(self.missed.get(c, 1.0), 1.0) ** 2 for c in ("force", "diameter")])
        weight = np.where(there, self.means.worth / np.where(there, again[:, None] * variance, 1.0), 0.0)
        by = np.nan_to_num(slopes) * self.scale[:, None, None]
        out = np.zeros((count, by.shape[0], by.shape[0]))
        for k in range(count):
            mine = by[:, :, label == k]
            out[k] = np.einsum("icn,jcn,cn->ij", mine, mine, weight[:, label == k])
        return out

    def _off(self, by_set: np.ndarray, shown: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Derivatives of force and diameter by what the rig may be off by, (q, 2, n); near zero of each."""
        (by_pressure, by_length), one = by_set, np.ones_like(pressure)
        columns = {
            "force_offset.offset": np.stack([one, 0 * one]),
            "force_gain.gain": np.stack([shown[0], 0 * one]),
            "pressure_offset.offset": -by_pressure,
            "pressure_gain.gain": -pressure * by_pressure,
            "length_offset.offset": -by_length,
            "diameter_offset.offset": np.stack([0 * one, one]),
            "rig_compliance.compliance": -by_length * shown[0],
        }
        return np.array([columns[name] for name in self.at.names if name in columns]).reshape(-1, 2, one.size)

    def _rulers(self, by_length: np.ndarray, setting: np.ndarray | None) -> np.ndarray:
        """Return the derivatives of force and diameter by the errors of set lengths, (q, 2, n)."""
        many = sum(map(is_ruler, self.at.names))
        if setting is None:
            return np.zeros((many, *by_length.shape))
        return by_length * (setting == np.arange(many)[:, None])[:, None]

    def settings(self, offered: Sequence[Run]) -> np.ndarray:
        """Return the index of each run's length among those that are set; strokes come after all of them."""
        lengths = set_lengths(self.means, self.entry.rest_length.value)
        return np.array(
            [int(np.argmin(abs(lengths - r.length[0]))) if r.still else lengths.size for r in offered]
        )

    def of_runs(self, offered: Sequence[Run], values: np.ndarray) -> np.ndarray:
        """What each run tells at some values, (r, p, p)."""
        kept = [run.thinned(MOST) for run in offered]
        label = np.concatenate([np.full(run.pressure.size, k) for k, run in enumerate(kept)])
        found = np.zeros((len(offered), *self.before.shape))
        if label.size:
            setting = self.settings(offered)[label]
            found = self.information(self.case(kept), label, len(offered), values, setting)
        for k, run in enumerate(offered):
            found[k] *= run.pressure.size / max(kept[k].pressure.size, 1)
            for name, sd in run.direct.items():
                if name in self.at.names:
                    i = self.place(name)
                    found[k, i, i] += (self.scale[i] / sd) ** 2
        return found

    def case(self, offered: Sequence[Run]) -> Case:
        """Runs as a recording, with nothing measured in it yet."""
        pressure = np.concatenate([run.pressure for run in offered])
        length = np.concatenate([run.length for run in offered])
        return map_case(self.entry, pressure, length)


def without_rulers(case: Case) -> Case:
    """Return the case with exact set lengths: whoever asks for their errors has numbers of its own."""
    sensors = replace(case.entry.sensors, length_per_setting=False)
    return replace(case, entry=replace(case.entry, sensors=sensors))


def rulers(sd: float, many: int) -> list[Free]:
    """Return the errors of so many set lengths as numbers with this sd, m; none where it is 0."""
    about = replace(meaning(RULER), low=-8 * sd, high=8 * sd)
    return [Free(f"{RULER}{k + 1}", about, 0.0, sd) for k in range(many if sd else 0)]


def map_case(entry: Entry, pressure: np.ndarray, length: np.ndarray) -> Case:
    """A static map as a case, with nothing of it known but that the muscle pulls."""
    force = np.full(pressure.size, 1e3)
    recording = Recording.from_arrays(pressure=pressure, length=length, force=force)
    return Case("plan", Path(), entry, recording, "")


@eqx.filter_jit
def _slopes(one: Member, values: Array) -> tuple[Array, Array, Array]:
    """Derivatives of force and diameter by every number, (p, 2, n); what is shown, (2, n); and its
    derivatives by pressure and by length, (2, 2, n)."""

    def instant(x, pressure, length):
        reading = one.muscle(x)(pressure, length)
        return jnp.stack([reading.force, reading.diameter])

    def everything(pressure, length):
        slopes = jax.jacfwd(instant, argnums=(0, 1, 2))(values, pressure, length)
        return slopes[0].T, instant(values, pressure, length), jnp.stack(slopes[1:])

    return jax.vmap(everything, out_axes=-1)(one.rows.pressure, one.rows.length)


def _spread_evenly(draws: np.ndarray) -> np.ndarray:
    """Draws with their ranks put at even shares of a normal: few of them then stand for many."""
    from scipy.stats import norm

    many = draws.shape[0] - 1
    rank = np.argsort(np.argsort(draws[1:], axis=0), axis=0)
    return np.concatenate([draws[:1], norm.ppf((rank + 0.5) / many)])


def knowledge(entry: Entry, means: Means, law: str | None = None, case: Case | None = None) -> Knowledge:
    """What is believed of a muscle, by muscle.toml and, where there is one, by its recording.

    Args:
        entry: what muscle.toml says.
        means: what the rig can do.
        law: thread law; None takes the baseline's.
        case: a recording made already.

    Raises:
        BadInput: where nothing may move.
    """
    law = law or entry.baseline
    bare = case or map_case(entry, np.array([0.0, 1e5]), np.full(2, entry.rest_length.value))
    joint_space([bare], law, ())
    free = [n for n in free_numbers(bare, law) if not is_ruler(n.name)]
    # What was recorded was read by channels, and with their zeros, that the rig may no longer have.
    channels = {*means.channels, *(case.recording.channels if case else ())}
    means = replace(means, off={n: sd for n, sd in means.off.items() if _read(n, channels)})
    free += [Free(n, meaning(n), max(0.0, sd * (meaning(n).low >= 0)), sd) for n, sd in means.off.items()]
    # One for each length that is set, and one for the strokes.
    lengths = rulers(means.setting, set_lengths(means, entry.rest_length.value).size + 1)
    found = _before(entry, means, law, [*free, *lengths])
    return found if case is None else _learned(found, case)


def _before(entry: Entry, means: Means, law: str, free: Sequence[Free]) -> Knowledge:
    """Return what the priors of some numbers say of them."""
    at = space(free)
    mean, sd = np.asarray(at.mean), np.asarray(at.sd)
    reach = np.where(at.log, 0.5 * np.abs(mean), (np.asarray(at.high) - np.asarray(at.low)) / math.sqrt(12))
    scale = np.where(np.isfinite(sd), sd, reach)
    prior = np.diag(np.where(np.isfinite(sd), 1.0, 1e-6))
    return Knowledge(entry, means, law, at, tuple(free), mean, scale, prior)


def _read(name: str, channels: set[str]) -> bool:
    """Whether a zero or gain belongs to a channel that there is."""
    return name.partition("_")[0] in {"pressure", "length", "rig", *channels}


def _learned(found: Knowledge, case: Case) -> Knowledge:
    """Knowledge after a recording: where a fit of it ends, and what it tells there.

    What the muscle misses counts as noise, and samples that know each other as fewer, as in a fit.
    """
    many = len(found.own)
    shared = [n for n in found.free if not is_ruler(n.name)]
    sd = case.entry.sensors.length if case.entry.sensors.length_per_setting else None
    setting = setting_of_length(case.recording) if sd else None
    errors = rulers(sd, int(setting.max()) + 1) if sd and setting is not None else []
    fitted = space([*found.free[:many], *errors])
    one = member(case, found.law, fitted, {})
    solution = solve((one,), fitted, jnp.zeros(fitted.size))
    weighed, _ = weigh(case, one, fitted, solution)
    solution = solve((weighed,), fitted, fitted.inside(solution.u))
    _, noise = weigh(case, weighed, fitted, solution)
    values = np.concatenate([np.asarray(fitted.values(solution.u))[:many], found.mean[many:]])
    # The recording's set lengths take the place of those to come.
    here = _before(found.entry, found.means, found.law, [*shared, *errors])
    label, told = np.zeros(case.recording.n, dtype=int), here.before
    for channel, its in noise.items():
        # A channel whose noise nobody stated is as noisy as its residual, and not better than usual.
        usual = getattr(found.means, channel) or getattr(Means, channel)
        own = getattr(case.entry.sensors, channel) or max(usual, its.sd)
        seen = replace(found.means, **{channel: own}).alone(channel)
        seen = replace(seen, ruler=0.0) if sd else seen
        worth = max(its.excess, 1.0) ** 2 * its.inflation
        told = told + replace(here, means=seen).information(case, label, 1, values, setting)[0] / worth
    before = found.before.copy()
    before[: len(shared), : len(shared)] = _freed(told, len(shared))
    return replace(found, mean=values, before=before, missed={c: its.excess for c, its in noise.items()})


def _freed(information: np.ndarray, many: int) -> np.ndarray:
    """Return the information about the first numbers with the others unknown, (many, many)."""
    others = information[many:, many:]
    across = information[:many, many:]
    return information[:many, :many] - across @ np.linalg.solve(others, across.T)
