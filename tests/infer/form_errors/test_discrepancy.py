"""Whitening by noise and form errors."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.infer.form_errors.discrepancy import (
    add_discrepancy,
    build_free_columns,
    compute_free_column_cost,
)
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel

N = 60
OWNERS = ("a", "a", "b")


def build_noise(rho=0.6):
    """Return correlated noise of a force channel, in two runs."""
    channel = Ar1Noise(np.full(N, 2.0), 0.8, rho, is_stated=True)
    rows, runs = np.arange(N), np.array([[0, 25], [25, N]])
    return NoiseModel((channel, None), (rows, np.zeros(0, int)), (runs, np.zeros((0, 2), int)))


def build_columns(rng):
    """Return three form errors in N, (3, 2, N)."""
    return rng.standard_normal((3, 2, N)) * 4.0


def test_whitened_covariance_is_the_identity():
    rng, noise = np.random.default_rng(0), build_noise()
    columns = build_columns(rng)
    with_forms = add_discrepancy(noise, columns, OWNERS)
    # C = W⁻¹ W⁻ᵀ + F Fᵀ of the force, W the whitening matrix of the noise alone.
    units = np.stack([np.eye(N), np.zeros((N, N))], axis=1)
    filter = noise.whiten(units).T
    inverse = np.linalg.inv(filter)
    covariance = inverse @ inverse.T + columns[:, 0].T @ columns[:, 0]
    whole = with_forms.whiten(units).T
    assert whole @ covariance @ whole.T == pytest.approx(np.eye(N), abs=1e-8)
    assert with_forms.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], abs=1e-8)


def test_nothing_changes_without_form_errors():
    noise = build_noise()
    values = np.random.default_rng(1).standard_normal((2, N))
    same = add_discrepancy(noise, np.zeros((0, 2, N)), ())
    assert np.array_equal(same.whiten(values), noise.whiten(values))
    assert same.log_determinant == noise.log_determinant


@pytest.mark.parametrize("rows", [25, 40])
def test_rows_of_a_mask_keep_their_form_errors(rows):
    """A mask can end within a run: the filter of the noise then restarts."""
    rng, noise = np.random.default_rng(2), build_noise()
    columns, values = build_columns(rng), rng.standard_normal((2, N))
    mask = np.arange(N) % rows >= rows // 2
    restricted = add_discrepancy(noise, columns, OWNERS).restrict_to_rows(mask)
    expected = add_discrepancy(noise.restrict_to_rows(mask), columns, OWNERS)
    assert restricted.whiten(values) == pytest.approx(expected.whiten(values), abs=1e-9)
    # A form error of one standard deviation has a χ² below one.
    assert np.sum(restricted.whiten(columns[0]) ** 2) < 1.0


def test_further_columns_are_added_in_any_order():
    rng, noise = np.random.default_rng(3), build_noise()
    columns, values = build_columns(rng), rng.standard_normal((2, N))
    parts = add_discrepancy(add_discrepancy(noise, columns[:2], OWNERS[:2]), columns[2:], OWNERS[2:])
    together = add_discrepancy(noise, columns, OWNERS)
    assert parts.whiten(values) == pytest.approx(together.whiten(values), abs=1e-9)
    assert parts.remove_columns({"b"}).columns == pytest.approx(columns[[0, 1]])


def test_a_free_column_removes_its_part_of_a_residual():
    noise = build_noise()
    columns = build_columns(np.random.default_rng(4))
    free_columns = build_free_columns(noise, columns[:1])
    free = add_discrepancy(noise, free_columns, ("a",))
    size = np.linalg.norm(noise.whiten(50 * columns[0]))
    assert np.linalg.norm(free.whiten(50 * columns[0])) < 0.02 * size
    assert np.linalg.norm(free.whiten(50 * columns[1])) > 0.5 * np.linalg.norm(noise.whiten(50 * columns[1]))
    # Apart from the width of its prior, it costs ln n, as a parameter does.
    cost = free.log_determinant - noise.log_determinant - compute_free_column_cost(1)
    assert cost == pytest.approx(np.log(N), abs=1e-3)


def test_estimated_form_errors_leave_the_noise():
    rng, noise = np.random.default_rng(5), build_noise(rho=0.0)
    columns = build_columns(rng)
    with_forms = add_discrepancy(noise, 10 * columns, OWNERS)
    values = np.stack([2 * rng.standard_normal(N), np.zeros(N)])
    form = 3 * columns[0]
    estimated = with_forms.estimate_discrepancy(values + form, "a")
    assert np.std((estimated - form)[0]) < 0.2 * np.std(form[0])
    assert np.std((with_forms.estimate_discrepancy(values + form, "b"))[0]) < 0.2 * np.std(form[0])


def test_a_free_column_of_means_costs_as_much_as_one_of_their_samples():
    noise = replace(build_noise(), samples_per_row=(5.0, 1.0))
    columns = build_free_columns(noise, build_columns(np.random.default_rng(6))[:1])
    free = add_discrepancy(noise, columns, ("a",))
    cost = free.log_determinant - noise.log_determinant - compute_free_column_cost(1)
    assert cost == pytest.approx(np.log(5 * N), abs=1e-3)
