"""The compiled filter agrees with the filter of the noise model, and restarts where a row is excluded."""

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from tests.agreement import agree

ROWS, SIZE = 300, 320


def build_noise(ar1_fraction, correlation, rows=None):
    """Return the noise of a force in two runs; a diameter is not measured."""
    rows = np.delete(np.arange(ROWS), [40, 41]) if rows is None else rows
    channel = Ar1Noise(np.full(ROWS, 2.0), ar1_fraction, correlation, True)
    runs = np.array([[0, 100], [100, rows.size]])
    return NoiseModel((channel, None), (rows, np.arange(0)), (runs, np.zeros((0, 2), int)))


@pytest.mark.parametrize(("ar1_fraction", "correlation"), [(1.0, 0.0), (1.0, 0.9), (0.5, 0.8), (0.0, 0.8)])
def test_compiled_filter_agrees_with_the_noise_model(ar1_fraction, correlation):
    noise = build_noise(ar1_fraction, correlation)
    residual = np.random.default_rng(3).standard_normal((2, ROWS))
    standard = np.concatenate([residual[0] / 2.0, np.full(SIZE - ROWS, 7.0)])
    white = noise.build_filter(SIZE).whiten(jnp.asarray(standard), 0)
    # Beyond the first samples of a run, the noise model uses the steady filter.
    agree(white[: noise.size], noise.whiten(residual), 2e-3, scale=1.0)
    agree(white[noise.size :], 0.0, 1e-12, scale=1.0)
    agree(noise.build_filter(SIZE).whiten(jnp.asarray(standard), 1), 0.0, 1e-12, scale=1.0)


def test_an_excluded_row_ends_a_run():
    noise = build_noise(0.7, 0.8)
    is_kept = np.random.default_rng(4).random(SIZE) > 0.2
    residual = np.random.default_rng(5).standard_normal((2, ROWS))
    standard = jnp.asarray(np.concatenate([residual[0] / 2.0, np.zeros(SIZE - ROWS)]))
    reduced = noise.restrict_to_rows(is_kept[:ROWS])
    white = noise.build_filter(SIZE).restrict_to_rows(is_kept).whiten(standard, 0)
    agree(white[: reduced.size], reduced.whiten(residual), 2e-3, scale=1.0)
    # Negative control: with the runs of all rows, the result differs.
    other = np.delete(noise.whiten(residual), np.flatnonzero(~is_kept[noise.rows[0]]))
    assert np.abs(np.asarray(white[: reduced.size]) - other).max() > 0.1
