"""What pamjax is compared with does what it says."""

import numpy as np

from pamjax.baselines.stepwise_bic import compute_bic


def test_bic_buys_a_number_for_its_price():
    n = 1000
    price = n * (1 - np.exp(-np.log(n) / n))
    assert compute_bic(n - 0.9 * price, n, 3) > compute_bic(n, n, 2)
    assert compute_bic(n - 1.1 * price, n, 3) < compute_bic(n, n, 2)
