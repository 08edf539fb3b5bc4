"""Noise of a static table, estimated from lines of settings under any smooth misfit."""

import numpy as np
import pytest

from pamjax.infer.noise.static_table import estimate_table_variance
from tests.agreement import SAMPLED

NOISE = 0.3


def table(seed=1, lengths=40, pressures=12):
    """Return an unordered table with a large misfit that is linear in pressure."""
    rng = np.random.default_rng(seed)
    p, l = (
        grid.ravel() for grid in np.meshgrid(np.linspace(1, 7, pressures), np.linspace(0.2, 0.3, lengths))
    )
    order = rng.permutation(p.size)
    p, l = p[order], l[order]
    return p, l, 50 * p * (l - 0.22) + NOISE * rng.standard_normal(p.size)


def test_noise_is_estimated_under_a_misfit_a_hundred_times_larger():
    estimate = estimate_table_variance(*table())
    assert estimate.variance / NOISE**2 == pytest.approx(
        1.0, abs=SAMPLED * np.sqrt(2 / estimate.degrees_of_freedom)
    )
    # Negative control: differences of neighbouring rows contain the misfit.
    assert np.mean(np.diff(table()[2]) ** 2) / 2 > 10 * NOISE**2


@pytest.mark.parametrize("rows", [4, 5, 9])
def test_stated_sd_of_the_noise_agrees_with_many_tables(rows):
    p = np.linspace(1.0, 5.0, rows)
    rng = np.random.default_rng(3)
    results = [estimate_table_variance(p, np.ones(rows), rng.standard_normal(rows)) for _ in range(4000)]
    variances, freedom = np.array([r.variance for r in results]), results[0].degrees_of_freedom
    # A mean of ν squares has the relative variance 2/ν.
    assert np.var(variances) == pytest.approx(2 / freedom, rel=0.15)
    assert np.mean(variances) == pytest.approx(1.0, abs=0.1)


def test_noise_needs_three_settings_in_a_line():
    assert estimate_table_variance(np.array([1.0, 2.0]), np.ones(2), np.ones(2)) is None
    assert estimate_table_variance(np.zeros(0), np.zeros(0), np.zeros(0)) is None
