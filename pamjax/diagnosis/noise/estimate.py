"""The noise of a recording, read off neighbouring samples, which a filter makes white.

A misfit is smooth where noise is not: what neighbours differ by tells the noise before anything is known
of the misfit. Filtered alike (`colour`), residual and derivatives meet as in generalised least squares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.input_noise import passed_on
from pamjax.infer.noise.ar1_filter import Colour, correlation_error
from pamjax.infer.noise.sensor_noise import sensitivities
from pamjax.infer.noise.static_table import table_variance
from pamjax.infer.noise.unknown_sensor import LAGS, Seen, Unstated, second_differences, unstated
from pamjax.infer.problem.dataset import CHANNELS, starting_sd

#: Largest correlation of neighbours. Beyond it noise cannot be told from misfit.
MOST = 0.98

#: Correlation of neighbours, in standard errors, below which samples count as independent.
SEEN = 2.0

#: How well a lab knows its sensors' noise, as a share of its variance.
SENSOR = 0.1

#: Samples below which no correlation is looked for.
FEW = 30

#: Share of all steps that are near where a few jump.
MOSTLY = 0.9


@dataclass(frozen=True, eq=False)
class Whitening:
    """Makes (…, 2, n) residuals or derivatives, SI, into white ones of unit variance.

    Attributes:
        colours: by channel, None where nothing was measured.
        rows: by channel, the rows that are looked at, in order.
        runs: by channel, where in `rows` continuous runs begin and end.
        trust: factor on everything white; below one where the model is wrong by more than noise.
    """

    colours: tuple[Colour | None, ...]
    rows: tuple[np.ndarray, ...]
    runs: tuple[np.ndarray, ...]
    trust: float = 1.0

    @property
    def size(self) -> int:
        """How many samples are looked at."""
        return sum(r.size for r in self.rows)

    @property
    def volume(self) -> float:
        """Logarithm of the determinant of the noise's covariance, SI."""
        out = -2 * self.size * math.log(self.trust)
        for colour, rows, runs in zip(self.colours, self.rows, self.runs, strict=True):
            if colour is not None:
                out += 2 * float(np.sum(np.log(colour.sd[rows])))
                out += 2 * sum(colour.log_sd(int(last - first)) for first, last in runs)
        return out

    def of_rows(self, mask: np.ndarray) -> Whitening:
        """The same noise, looked at in the rows of a mask, (n,), alone."""
        rows = tuple(there[mask[there]] for there in self.rows)
        runs = tuple(_runs_in(mask[there], run) for there, run in zip(self.rows, self.runs, strict=True))
        return replace(self, rows=rows, runs=runs)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Standardised and filtered, (…, size): force first, then diameter."""
        parts = [self._channel(values[..., c, :], c) for c in range(len(CHANNELS)) if self.rows[c].size]
        return self.trust * np.concatenate(parts, axis=-1)

    def _channel(self, values: np.ndarray, c: int) -> np.ndarray:
        colour, rows = self.colours[c], self.rows[c]
        assert colour is not None
        standard = values[..., rows] / colour.sd[rows]
        if colour.correlation == 0:
            return standard
        # Nothing is known before a run.
        parts = [colour.whitened(standard[..., first:last]) for first, last in self.runs[c]]
        return np.concatenate(parts, axis=-1)

    def standard(self, values: np.ndarray, c: int) -> np.ndarray:
        """One channel over its standard deviation, unfiltered, NaN where it is not looked at, (…, n)."""
        out = np.full(values.shape[:-2] + values.shape[-1:], np.nan)
        colour, rows = self.colours[c], self.rows[c]
        if colour is not None:
            out[..., rows] = values[..., c, rows] / colour.sd[rows]
        return out


def _runs_in(kept: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """(k, 2) begin and end of runs, in what is kept of their samples; what is left out ends a run."""
    run = np.repeat(np.arange(len(runs)), runs[:, 1] - runs[:, 0])[kept]
    breaks = (np.diff(run) != 0) | (np.diff(np.flatnonzero(kept)) > 1)
    bounds = np.concatenate([[0], np.flatnonzero(breaks) + 1, [run.size]]).astype(int)
    return np.stack([bounds[:-1], bounds[1:]], axis=1) if run.size else np.zeros((0, 2), int)


def whitening(found: Problem, values: np.ndarray, used: np.ndarray) -> Whitening:
    """The noise that the residual at these values shows.

    Args:
        found: the recording before the library.
        values: (p,) numbers, SI.
        used: (n,) the rows that may be looked at.
    """
    residual = found.measured - found.shows(values)
    own, carried = _variances(found, values)
    # What was left out ends a run: samples on either side of it are no neighbours.
    starts = np.cumsum(found.case.recording.starts | (np.diff(used, prepend=used[:1])))
    sensors = found.case.entry.sensors
    silent = sensors.pressure is None or (sensors.length is None and not sensors.length_per_setting)
    colours, rows, runs = [], [], []
    tables = _table_variances(found, used)
    noise = passed_on(found, values)
    for c, stated in enumerate((sensors.force, sensors.diameter)):
        there = np.flatnonzero(np.isfinite(found.measured[c]) & used)
        edges = np.flatnonzero(np.diff(starts[there])) + 1
        bounds = np.concatenate([[0], edges, [there.size]]).astype(int)
        rows.append(there)
        runs.append(np.stack([bounds[:-1], bounds[1:]], axis=1) if there.size else np.zeros((0, 2), int))
        colours.append(
            _colour(
                residual[c],
                own[c],
                carried[c],
                there,
                starts,
                stated is not None,
                tables[c],
                None if noise is None else noise[:, c],
                silent,
            )
            if there.size
            else None
        )
    return Whitening(tuple(colours), tuple(rows), tuple(runs))


def _variances(found: Problem, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variance of a channel's own noise, (2, 1), and of what pressure and length carry into it, (2, n)."""
    sensors = found.case.entry.sensors
    by_pressure, by_length = (
        np.asarray(s)[:, : found.n] for s in sensitivities(found.member, jnp.asarray(values))
    )
    length = 0.0 if sensors.length_per_setting else sensors.length or 0.0
    carried = ((sensors.pressure or 0.0) * by_pressure) ** 2 + (length * by_length) ** 2
    return np.square(np.array(starting_sd(found.case)))[:, None], np.nan_to_num(carried)


def _table_variances(found: Problem, used: np.ndarray) -> list[tuple[float, float]]:
    """By channel, the variance of a reading of a static table and how well it is known; NaN in a history.

    Of the neutral muscle's misfit, so that no model that bends to few rows makes its own noise small.
    """
    recording = found.case.recording
    if recording.has_time:
        return [(math.nan, 0.0)] * len(CHANNELS)
    misfit = found.measured - found.shows(found.neutral)
    there = [np.isfinite(misfit[c]) & used for c in range(len(CHANNELS))]
    return [
        table_variance(recording.pressure[rows], recording.length[rows], misfit[c, rows])
        for c, rows in enumerate(there)
    ]


def _colour(
    residual, own, carried, there, starts, given: bool, table=(math.nan, 0.0), noise=None, silent=False
):
    variance, freedom = table
    if not given and freedom > 0:
        sd = np.sqrt(np.maximum(variance, carried))
        return Colour(sd, 1.0, 0.0, given, freedom)
    might = None if given else _unstated(residual, carried, noise, there, starts, silent)
    if might:
        (memory, own), carried = might.taken, carried + might.white
    elif not given:
        one = np.ones_like(residual)
        rough = _roughness(residual, one, there, starts)
        own = max(rough - _rough_of_set(carried, noise, one, there, starts), 1e-18)
    variance = np.broadcast_to(own + carried, residual.shape)
    sd = np.sqrt(variance)
    shared = float(np.mean(np.broadcast_to(own, residual.shape)[there] / variance[there]))
    if might:
        return Colour(sd, shared, memory, given, told=memory, might=might)
    if not given or there.size < FEW:
        return Colour(sd, shared, 0.0, given)
    # Half the mean square of neighbours' differences is W + A (1 − ρ); less than W where a lag averages.
    rough, of_set = _roughness(residual, sd, there, starts), _rough_of_set(carried, noise, sd, there, starts)
    if of_set > rough:
        # A model that would make more of noise than there is tells nothing of it.
        of_set = _rough_of_set(carried, None, sd, there, starts)
    rough -= of_set
    rho = 1 - rough / shared
    seen = rho > SEEN * correlation_error(shared, 0.0, there.size)
    return Colour(sd, shared, min(rho, MOST) if seen else 0.0, given, told=rho)


def _unstated(residual, carried, noise, there, starts, open_: bool) -> Unstated | None:
    """What the recording tells of a sensor of which nothing was stated; None where runs are too short."""
    left = [d[np.isfinite(d)] for d in second_differences(residual[there], starts[there])]
    counts = np.array([d.size for d in left])
    if counts.min() < FEW:
        return None
    if noise is None:
        white = np.full(LAGS.size, 6 * float(np.mean(carried[there])))
    else:
        white = np.array([np.mean(d**2) for d in second_differences(noise[:, there], starts[there])])
    return unstated(Seen(np.array([_mean_square(d) for d in left]), counts, white, SENSOR, open_))


def _rough_of_set(carried, noise, sd, there, starts) -> float:
    """Half the mean square of neighbours' differences by noise of what was set, over sd²."""
    if noise is None:
        return float(np.mean((carried / sd**2)[there]))
    step = np.diff((noise / sd)[:, there], axis=1)[:, np.diff(starts[there]) == 0]
    return 0.5 * float(np.mean(step**2)) if step.size else 0.0


def _roughness(residual, sd, there, starts) -> float:
    """Half the mean square of neighbours' differences, insensitive to the few that jump."""
    standard = residual[there] / sd[there]
    step = np.diff(standard)[np.diff(starts[there]) == 0]
    if step.size < 3:
        return float(np.var(standard)) if standard.size > 1 else 1.0
    return 0.5 * _mean_square(step)


def _mean_square(steps: np.ndarray) -> float:
    """Of steps, insensitive to the few that jump."""
    near = np.abs(steps) < 3.5 * 1.4826 * np.median(np.abs(steps))
    # Where many are far (the steps of a coarse converter) they do not jump: that is how they are.
    if np.mean(near) < MOSTLY:
        return float(np.mean(steps**2))
    # Of a normal variable 0.046 % lies beyond 3.5 standard deviations, with 0.6 % of its square.
    return float(np.mean(steps[near] ** 2)) * 1.0061
