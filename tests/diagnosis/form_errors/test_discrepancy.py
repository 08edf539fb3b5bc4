"""Whitening by noise and form errors."""

import numpy as np
import pytest

from pamjax.diagnosis.form_errors.discrepancy import add_discrepancy, build_free_columns, extend_discrepancy
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel

N = 60


def build_noise(rho=0.6):
    """Return correlated noise of a force channel, in two runs."""
    channel = Ar1Noise(np.full(N, 2.0), 0.8, rho, stated=True)
    rows, runs = np.arange(N), np.array([[0, 25], [25, N]])
    return NoiseModel((channel, None), (rows, np.zeros(0, int)), (runs, np.zeros((0, 2), int)))


def build_columns(noise, rng):
    """Return form errors in N, (3, 2, N), and whitened."""
    columns = rng.standard_normal((3, 2, N)) * 4.0
    return columns, noise.whiten(columns)


def test_whitened_covariance_is_the_identity():
    rng, noise = np.random.default_rng(0), build_noise()
    columns, white = build_columns(noise, rng)
    with_forms = add_discrepancy(noise, white)
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
    same = add_discrepancy(noise, np.zeros((0, N)))
    assert np.array_equal(same.whiten(values), noise.whiten(values))
    assert same.log_determinant == noise.log_determinant


def test_rows_of_one_run_keep_their_form_errors():
    rng, noise = np.random.default_rng(2), build_noise()
    _, white = build_columns(noise, rng)
    mask = np.arange(N) < 25
    values = rng.standard_normal((2, N))
    restricted = add_discrepancy(noise, white).restrict_to_rows(mask)
    expected = add_discrepancy(noise.restrict_to_rows(mask), white[:, :25])
    assert restricted.whiten(values) == pytest.approx(expected.whiten(values), abs=1e-9)


def test_further_columns_are_added_in_any_order():
    rng, noise = np.random.default_rng(3), build_noise()
    columns, white = build_columns(noise, rng)
    values = rng.standard_normal((2, N))
    first = add_discrepancy(noise, white[:2])
    extended = extend_discrepancy(first, first.whiten(columns[2:]))
    together = add_discrepancy(noise, white)
    assert extended.log_determinant == pytest.approx(together.log_determinant, abs=1e-8)
    whitened = (extended.whiten(values), together.whiten(values))
    # The two filters differ by a rotation, which keeps all products.
    assert whitened[0] @ whitened[0] == pytest.approx(whitened[1] @ whitened[1], rel=1e-9)


def test_a_free_column_removes_its_part_of_a_residual():
    rng, noise = np.random.default_rng(4), build_noise()
    columns, white = build_columns(noise, rng)
    free = add_discrepancy(noise, build_free_columns(white[:1]))
    size = np.linalg.norm(noise.whiten(50 * columns[0]))
    assert np.linalg.norm(free.whiten(50 * columns[0])) < 0.02 * size
    assert np.linalg.norm(free.whiten(50 * columns[1])) > 0.5 * np.linalg.norm(noise.whiten(50 * columns[1]))
