"""Short simulation-based calibration; `python -m tests.benchmarks.calibration` is the complete one."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from pamjax.infer.posterior.laplace import fit_laplace
from tests.calibrated import Bench, treat_noise_as_white

COUNT = 40


def distances(bench, change=lambda density: density):
    """Return the probability of the distance of each truth from the mode: uniform if correct.

    With 250 rows the posterior of the three muscle parameters is nearly Gaussian.
    """
    probabilities = []
    for k in range(COUNT):
        density, start = bench.recording(k)
        density = change(density)
        ball = fit_laplace(density, start)
        at = density.space
        off = np.asarray(at.to_point(dict(zip(at.names, bench.true[k], strict=True))) - ball.centre)[:3]
        covariance = np.asarray(ball.covariance_root @ ball.covariance_root.T)[:3, :3]
        probabilities.append(chi2.cdf(off @ np.linalg.solve(covariance, off), 3))
    return np.array(probabilities)


@pytest.mark.slow
def test_posterior_is_calibrated_and_a_wrong_likelihood_is_detected():
    bench = Bench("elastic", COUNT)
    assert kstest(distances(bench), "uniform").pvalue > 0.01
    # Lag-one correlation 0.5: if the noise is treated as white, intervals are too narrow.
    assert kstest(distances(bench, treat_noise_as_white), "uniform").pvalue < 1e-3
