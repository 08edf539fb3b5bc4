"""Noise model of a recording, which whitens residuals and derivatives (generalised least squares)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import jax.numpy as jnp
import numpy as np

from pamjax.infer.noise.ar1_filter import Ar1Noise, RunFilter
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.infer.problem.whitening import Whitening, pack_samples


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Noise of force and diameter, which whitens (…, 2, n) residuals or derivatives, SI, to unit variance.

    Attributes:
        by_channel: noise of each channel; None for a channel without measurements.
        rows: by channel, the rows in use, in order.
        runs: by channel, (k, 2) begin and end of the continuous runs in `rows`.
        weight: factor on all whitened values; below one for a model with systematic misfit.
        samples_per_row: by channel, mean number of samples of which a row is the mean.
    """

    by_channel: tuple[Ar1Noise | None, ...]
    rows: tuple[np.ndarray, ...]
    runs: tuple[np.ndarray, ...]
    weight: float = 1.0
    samples_per_row: tuple[float, float] = (1.0, 1.0)

    @property
    def size(self) -> int:
        """Return the number of values in use: samples, or means of samples."""
        return sum(r.size for r in self.rows)

    @property
    def sample_count(self) -> float:
        """Return the number of samples in use."""
        return sum(rows.size * count for rows, count in zip(self.rows, self.samples_per_row, strict=True))

    @property
    def log_determinant(self) -> float:
        """Return the logarithm of the determinant of the noise covariance, SI."""
        out = -2 * self.size * math.log(self.weight)
        for channel, rows, run_filter in zip(self.by_channel, self.rows, self._filters, strict=True):
            if channel is not None:
                out += 2 * float(np.sum(np.log(channel.sd[rows])))
            if run_filter is not None:
                out += 2 * float(np.sum(np.log(run_filter.sd)))
        return out

    def compute_rms_sd(self, c: int) -> float:
        """Return the rms of the sds of a channel's samples, SI; infinite without measurements.

        Samples that are a run of their own count only if there are no others.
        """
        channel = self.by_channel[c]
        if channel is None:
            return math.inf
        sizes = self.runs[c][:, 1] - self.runs[c][:, 0]
        is_in_run = np.repeat(sizes > 1, sizes)
        rows = self.rows[c][is_in_run] if is_in_run.any() else self.rows[c]
        return float(np.sqrt(np.mean(channel.sd[rows] ** 2)))

    def restrict_to_rows(self, mask: np.ndarray) -> NoiseModel:
        """Return the same noise model for the rows of a mask, (n,), only."""
        rows = tuple(channel_rows[mask[channel_rows]] for channel_rows in self.rows)
        runs = tuple(
            _split_runs(mask[channel_rows], run)
            for channel_rows, run in zip(self.rows, self.runs, strict=True)
        )
        return replace(self, rows=rows, runs=runs)

    def add_row_variance(self, variance: np.ndarray) -> NoiseModel:
        """Return the noise with a further variance of some samples, which become runs of their own.

        Args:
            variance: (2, n) SI squared; zero for no further variance.
        """
        by_channel, all_runs = [], []
        for c, (channel, rows, runs) in enumerate(zip(self.by_channel, self.rows, self.runs, strict=True)):
            is_changed = variance[c, rows] > 0
            if channel is not None and is_changed.any():
                channel = replace(channel, sd=np.sqrt(channel.sd**2 + variance[c]))
                edges = np.flatnonzero(is_changed)
                bounds = np.unique(np.concatenate([runs[:, 0], [rows.size], edges, edges + 1]))
                runs = np.stack([bounds[:-1], bounds[1:]], axis=1)
            by_channel.append(channel)
            all_runs.append(runs)
        return replace(self, by_channel=tuple(by_channel), runs=tuple(all_runs))

    def build_filter(self, size: int) -> Whitening:
        """Return the filter for the residuals of a dataset of `size` rows, within a compiled program."""
        arrays = [self._build_channel_filter(c, size) for c in range(len(CHANNELS))]
        order, position, feedback, sd = (jnp.asarray(np.stack(a)) for a in zip(*arrays, strict=True))
        correlation = jnp.asarray(
            [c.correlation if c is not None and c.ar1_fraction > 0 else 0.0 for c in self.by_channel]
        )
        return Whitening(order, position, correlation, feedback, sd, jnp.asarray(1.0))

    def _build_channel_filter(self, c: int, size: int) -> tuple[np.ndarray, ...]:
        channel, rows = self.by_channel[c], self.rows[c]
        begins = np.zeros(rows.size, dtype=bool)
        begins[self.runs[c][:, 0]] = True
        coefficients = (
            (np.zeros(size), np.ones(size)) if channel is None else channel.compute_coefficients(size)
        )
        return *pack_samples(rows, begins, size), *coefficients

    @property
    def is_run_start(self) -> np.ndarray:
        """Return whether each whitened sample begins a run, (size,)."""
        parts = [np.zeros(rows.size, dtype=bool) for rows in self.rows]
        for part, runs in zip(parts, self.runs, strict=True):
            part[runs[:, 0]] = True
        return np.concatenate(parts)

    @cached_property
    def _filters(self) -> tuple[RunFilter | None, ...]:
        """Return the filter of each channel; None for uncorrelated noise."""
        return tuple(
            None if channel is None else channel.build_filter(runs, rows)
            for channel, rows, runs in zip(self.by_channel, self.rows, self.runs, strict=True)
        )

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Return values divided by their sd and whitened, (…, size): force first, then diameter."""
        parts = [
            self._whiten_channel(values[..., c, :], c) for c in range(len(CHANNELS)) if self.rows[c].size
        ]
        return self.weight * np.concatenate(parts, axis=-1)

    def _whiten_channel(self, values: np.ndarray, c: int) -> np.ndarray:
        channel, rows = self.by_channel[c], self.rows[c]
        assert channel is not None
        standardised = values[..., rows] / channel.sd[rows]
        channel_filter = self._filters[c]
        return standardised if channel_filter is None else channel_filter.whiten(standardised)

    def standardise(self, values: np.ndarray, c: int) -> np.ndarray:
        """Return one channel over its standard deviation, (…, n), not whitened; NaN in rows not in use."""
        out = np.full(values.shape[:-2] + values.shape[-1:], np.nan)
        channel, rows = self.by_channel[c], self.rows[c]
        if channel is not None:
            out[..., rows] = values[..., c, rows] / channel.sd[rows]
        return out


def _split_runs(is_kept: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Return (k, 2) begin and end of the runs among the kept samples; a removed sample ends a run."""
    run = np.repeat(np.arange(len(runs)), runs[:, 1] - runs[:, 0])[is_kept]
    breaks = (np.diff(run) != 0) | (np.diff(np.flatnonzero(is_kept)) > 1)
    bounds = np.concatenate([[0], np.flatnonzero(breaks) + 1, [run.size]]).astype(int)
    return np.stack([bounds[:-1], bounds[1:]], axis=1) if run.size else np.zeros((0, 2), int)
