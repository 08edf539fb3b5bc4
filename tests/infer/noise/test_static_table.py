"""The noise of a static table is read off lines of settings, whatever smooth misfit lies under it."""

import numpy as np
import pytest

from pamjax.infer.noise.static_table import estimate_table_variance
from tests.agreement import SAMPLED

NOISE = 0.3


def table(seed=1, lengths=40, pressures=12):
    """A table in no order, with a misfit that is large, and straight in pressure."""
    rng = np.random.default_rng(seed)
    p, l = (
        grid.ravel() for grid in np.meshgrid(np.linspace(1, 7, pressures), np.linspace(0.2, 0.3, lengths))
    )
    order = rng.permutation(p.size)
    p, l = p[order], l[order]
    return p, l, 50 * p * (l - 0.22) + NOISE * rng.standard_normal(p.size)


def test_noise_is_found_under_a_misfit_a_hundred_times_as_large():
    variance, freedom = estimate_table_variance(*table())
    assert variance / NOISE**2 == pytest.approx(1.0, abs=SAMPLED * np.sqrt(2 / freedom))
    # Able to fail: neighbours in the order of rows see the misfit.
    assert np.mean(np.diff(table()[2]) ** 2) / 2 > 10 * NOISE**2


@pytest.mark.parametrize("rows", [4, 5, 9])
def test_how_well_it_is_known_is_the_spread_over_many_tables(rows):
    p = np.linspace(1.0, 5.0, rows)
    rng = np.random.default_rng(3)
    found = [estimate_table_variance(p, np.ones(rows), rng.standard_normal(rows)) for _ in range(4000)]
    variances, freedom = np.array([v for v, _ in found]), found[0][1]
    # A mean of ν squares has the relative variance 2/ν.
    assert np.var(variances) == pytest.approx(2 / freedom, rel=0.15)
    assert np.mean(variances) == pytest.approx(1.0, abs=0.1)


def test_without_a_line_of_three_it_is_not_known():
    assert estimate_table_variance(np.array([1.0, 2.0]), np.ones(2), np.ones(2))[1] == 0
    assert estimate_table_variance(np.zeros(0), np.zeros(0), np.zeros(0))[1] == 0
