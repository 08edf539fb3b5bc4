"""Noise of a channel as numbers of a posterior: its standard deviation and its lag-one correlation.

Sample i of a channel misses the model by e_i. With the channel's own sd σ and the noise c_i of pressure
and length carried through the model,

    s_i = e_i / sqrt(σ² + c_i²),      s_i | s_{i−1} ~ Normal(ρ s_{i−1}, 1 − ρ²)

along every continuous run of samples: noise with an exponential memory, of which white noise is ρ = 0.

What it leaves out: noise with two memories, such as a white sensor on top of a slow misfit. What of that
is left in the innovations is found by `worth` and widens the posterior (see `density.py`).

Source: autoregression of order one, Box & Jenkins, Time Series Analysis (1970), ch. 3.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.channels import DISPLAY_UNIT, SI_UNIT
from pamjax.infer.fitting.reweight import misfit_of
from pamjax.infer.noise.sensor_noise import effective_sd, inflation
from pamjax.infer.problem.dataset import CHANNELS, Member, starting_sd
from pamjax.infer.problem.parameter_space import Free
from pamjax.parameter import Meaning
from pamjax.records.case import Case

#: With fewer samples than this a channel's memory cannot be seen; as in `noise.inflation`.
ENOUGH = 30
#: A sensor's sd is believed to lie within these factors of what was stated: a little better, or much worse.
STATED = (0.5, 200.0)
#: ... and, where none was stated, of a hundredth of the channel's range.
UNSTATED = (0.01, 100.0)
#: Limits of a lag-one correlation; white noise is no limit of it.
CORRELATION = (-0.5, 0.9995)


def noise_units(name: str) -> tuple[str, str]:
    """SI unit of a number of the noise, and the unit in which a person reads it."""
    channel = name.rpartition(".")[2]
    return (SI_UNIT[channel], DISPLAY_UNIT[channel]) if channel in SI_UNIT else ("1", "1")


class Stream(eqx.Module):
    """One channel of one member, its samples in the order of time.

    Attributes:
        channel: 0 for force, 1 for diameter.
        sd: where the channel's sd stands among the numbers.
        correlation: where its lag-one correlation stands, or -1 for none.
        there: (n,) one where a sample counts.
        linked: (n,) one where a sample has a measured one before it in its run.
        before: (n,) row of that sample; None where it is always the row before.
        carried: (n,) noise of pressure and length carried through the model, SI.
    """

    channel: int = eqx.field(static=True)
    sd: int = eqx.field(static=True)
    correlation: int = eqx.field(static=True)
    there: Float[Array, " n"]
    linked: Float[Array, " n"]
    before: Array | None
    carried: Float[Array, " n"]

    def standard(self, misfit: Float[Array, " n"], values: Float[Array, " p"]) -> tuple[Array, Array]:
        """Innovations in their own sd, and the logarithm of that sd, SI; (n,) each.

        Args:
            misfit: measured − model, SI; zero where a sample does not count.
            values: every number of the posterior, SI.
        """
        variance = values[self.sd] ** 2 + self.carried**2
        s = misfit / jnp.sqrt(variance)
        if self.correlation < 0:
            return s * self.there, 0.5 * jnp.log(variance)
        memory = values[self.correlation] * self.linked
        last = jnp.roll(s, 1) if self.before is None else s[self.before]
        left = 1 - memory**2
        return (s - memory * last) / jnp.sqrt(left) * self.there, 0.5 * jnp.log(variance * left)

    def log_density(self, misfit: Float[Array, " n"], values: Float[Array, " p"]) -> Float[Array, " n"]:
        """Log-density of every sample given those before it, in SI; zero where it does not count."""
        innovation, log_sd = self.standard(misfit, values)
        return (-0.5 * innovation**2 - log_sd - 0.5 * jnp.log(2 * jnp.pi)) * self.there

    def information(self, values: Float[Array, " p"]) -> Float[Array, "2 2"]:
        """Expected information on (ln sd, correlation); the second is idle without a correlation."""
        own = values[self.sd] ** 2 / (values[self.sd] ** 2 + self.carried**2)
        n, linked = jnp.sum(self.there * own**2), jnp.sum(self.linked)
        if self.correlation < 0:
            return jnp.array([[2 * n, 0.0], [0.0, 1.0]])
        # The variance of an innovation, σ²(1 − ρ²), and ρ are orthogonal: 1/2 and 1/(1 − ρ²) a sample.
        memory = values[self.correlation]
        left = 1 - memory**2
        across = -2 * memory / left * jnp.sum(self.linked * own)
        alone = linked * (2 * memory**2 / left**2 + 1 / left)
        return jnp.array([[2 * n, across], [across, alone]])


def noise_numbers(
    case: Case, one: Member, at: Float[Array, " p"], head: str, size: int
) -> tuple[list[Free], list[Stream]]:
    """The numbers of a case's noise, started at what a residual shows, and its channels.

    Args:
        case: the recording.
        one: its member; only samples with a weight count.
        at: (p,) values of the muscle's numbers, SI.
        head: before every name, as "case/".
        size: how many numbers stand before these.
    """
    sensors, n = case.entry.sensors, case.recording.n
    misfit = misfit_of(one, at)
    carried = effective_sd(one, at, sensors, (0.0, 0.0))
    numbers, streams = [], []
    for k, (channel, stated) in enumerate(zip(CHANNELS, (sensors.force, sensors.diameter), strict=True)):
        there = np.isfinite(misfit[k]) & (np.asarray(one.rows.used) > 0)
        if not there.any():
            continue
        before, linked = _before(there[:n], case.recording.starts)
        own = _own_sd(misfit[k][there], carried[k][there])
        reference = stated or starting_sd(case)[k]
        numbers.append(_sd_number(f"{head}noise.{channel}", channel, own, reference, stated is not None))
        memory = case.recording.has_time and linked.sum() >= ENOUGH
        if memory:
            s = np.where(there, misfit[k], 0.0)[:n] / np.sqrt(own**2 + carried[k][:n] ** 2)
            numbers.append(_memory_number(f"{head}noise.{channel}_correlation", s, before, linked))
        first = size + len(numbers) - (2 if memory else 1)
        streams.append(_stream(k, first, memory, there, before, linked, carried[k]))
    return numbers, streams


def worth(innovation: np.ndarray, stream: Stream, case: Case) -> float:
    """How many innovations are worth one independent one: 1 where the noise has one memory."""
    there = np.asarray(stream.there)[: case.recording.n] > 0
    row = np.where(there, innovation[: case.recording.n], np.nan)
    return inflation(row, case.recording.starts)


def _before(there: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row of the measured sample before each one, and whether it is one of the same run; (n,) each."""
    n = there.size
    row = np.where(there, np.arange(n), -1)
    last = np.concatenate([[-1], np.maximum.accumulate(row)[:-1]])
    run = np.cumsum(starts)
    linked = there & (last >= 0) & (run[last] == run)
    return np.where(linked, last, np.maximum(np.arange(n) - 1, 0)), linked


def _own_sd(misfit: np.ndarray, carried: np.ndarray) -> float:
    """The channel's own sd: what of the misfit the carried noise does not explain, at least a tenth."""
    square = float(np.mean(misfit**2))
    return float(np.sqrt(max(square - float(np.mean(carried**2)), 0.01 * square, 1e-30)))


def _sd_number(name: str, channel: str, own: float, reference: float, stated: bool) -> Free:
    low, high = (factor * reference for factor in (STATED if stated else UNSTATED))
    unit, show = SI_UNIT[channel], DISPLAY_UNIT[channel]
    source = "half to 200 times the stated sensor" if stated else "1e-4 to 1 of the channel's range"
    about = Meaning(unit, show, low, high, "log", f"sd of a sample of {channel}", source)
    return Free(name, about, float(np.clip(own, 1.05 * low, 0.95 * high)))


def _memory_number(name: str, s: np.ndarray, before: np.ndarray, linked: np.ndarray) -> Free:
    low, high = CORRELATION
    pairs = float(np.sum(s[linked] * s[before[linked]]) / max(np.sum(s[linked] ** 2), 1e-300))
    about = "correlation of a sample's noise with that of the one before"
    meaning = Meaning("1", "1", low, high, "linear", about, "from alternating to almost constant")
    return Free(name, meaning, float(np.clip(pairs, -0.4, 0.995)))


def _stream(channel, first, memory, there, before, linked, carried) -> Stream:
    def pad(array):
        return jnp.asarray(np.concatenate([array, np.zeros(there.size - array.size)]))

    rows = np.concatenate([before, np.zeros(there.size - before.size, dtype=int)])
    adjacent = bool(np.all(before[linked] == np.flatnonzero(linked) - 1))
    return Stream(
        channel=channel,
        sd=first,
        correlation=first + 1 if memory else -1,
        there=jnp.asarray(there.astype(float)),
        linked=pad(linked.astype(float)),
        before=None if adjacent else jnp.asarray(rows),
        carried=jnp.asarray(carried),
    )
