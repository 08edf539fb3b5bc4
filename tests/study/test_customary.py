"""What pamjax is compared with does what it says."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from pamjax.study.customary import bic, likelihood, process


def curve(x):
    return np.sin(2 * x[:, 0]) + 0.5 * x[:, 1]


def test_a_process_learns_a_smooth_curve_through_noise():
    rng = np.random.default_rng(0)
    told, asked = rng.uniform(-1.5, 1.5, (200, 3)), rng.uniform(-1, 1, (100, 3))
    noisy = curve(told) + 0.05 * rng.standard_normal(200)
    assert np.sqrt(np.mean((process(told, noisy, asked) - curve(asked)) ** 2)) < 0.03
    # What has no pattern teaches nothing: at other places it says zero.
    noise = rng.standard_normal(200)
    assert np.sqrt(np.mean(process(told, noise, asked) ** 2)) < 0.4


def test_far_from_data_a_process_says_nothing():
    x = np.linspace(-1, 1, 60)[:, None]
    assert abs(process(x, np.cos(3 * x[:, 0]), np.array([[40.0]]))[0]) < 1e-3


def test_the_slope_of_its_likelihood_is_that_of_its_values():
    rng = np.random.default_rng(1)
    told = rng.standard_normal((30, 2))
    squares, y = (told[:, None] - told[None]) ** 2, rng.standard_normal(30)
    x = np.array([0.1, -0.3, 0.2, -0.8])
    numeric = approx_fprime(x, lambda at: likelihood(at, squares, y)[0], 1e-7)
    assert likelihood(x, squares, y)[1] == pytest.approx(numeric, rel=1e-4)


def test_bic_buys_a_number_for_its_price():
    n = 1000
    price = n * (1 - np.exp(-np.log(n) / n))
    assert bic(n - 0.9 * price, n, 3) > bic(n, n, 2)
    assert bic(n - 1.1 * price, n, 3) < bic(n, n, 2)
