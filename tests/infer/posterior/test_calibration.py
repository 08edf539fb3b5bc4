"""Are the posterior's widths true? Small; `python -m tests.benchmarks.calibration` is the whole of it."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from pamjax.infer.posterior.laplace import fit_laplace
from tests.calibrated import Bench, believing_white

COUNT = 40


def distances(bench, change=lambda density: density):
    """How far the truth lies from the top of each posterior, as a probability: uniform if it is right.

    A recording of 250 rows knows the muscle's three numbers so well that their posterior is a Gaussian.
    """
    found = []
    for k in range(COUNT):
        density, start = bench.recording(k)
        density = change(density)
        ball = fit_laplace(density, start)
        at = density.space
        off = np.asarray(at.to_point(dict(zip(at.names, bench.true[k], strict=True))) - ball.centre)[:3]
        covariance = np.asarray(ball.covariance_root @ ball.covariance_root.T)[:3, :3]
        found.append(chi2.cdf(off @ np.linalg.solve(covariance, off), 3))
    return np.array(found)


@pytest.mark.slow
def test_the_truth_lies_where_it_should_and_a_wrong_likelihood_is_caught():
    bench = Bench("elastic", COUNT)
    assert kstest(distances(bench), "uniform").pvalue > 0.01
    # Half the noise of a sample is that of the one before: taken for white, intervals are too narrow.
    assert kstest(distances(bench, believing_white), "uniform").pvalue < 1e-3
