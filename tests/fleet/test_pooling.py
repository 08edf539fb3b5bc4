"""Partial pooling against a closed form, a simulated truth and a wrong model."""

import numpy as np
import pytest
from scipy import integrate, stats

from pamjax.errors import BadInput
from pamjax.fleet.common_prior import remove_prior
from pamjax.fleet.pooling import maximise_likelihood, pool_estimates
from pamjax.fleet.regression import fit_slope


def test_equal_sd_has_the_closed_form():
    """With equal sd, τ² is the variance of the estimates minus that of one estimate."""
    y = np.array([3.0, 5.5, 4.0, 7.0, 6.0, 4.5])
    pooled = pool_estimates(y, np.full(6, 0.8))
    between = np.sqrt(y.var(ddof=1) - 0.8**2)
    assert pooled.mean == pytest.approx(y.mean(), rel=1e-9)
    assert pooled.between_sd == pytest.approx(between, rel=1e-3)
    assert pooled.mean_sd == pytest.approx(y.std(ddof=1) / np.sqrt(6), rel=1e-3)
    share = 0.8**2 / y.var(ddof=1)
    assert pooled.shrunken == pytest.approx(y + share * (y.mean() - y), rel=1e-3)


def test_estimates_that_agree_within_their_sd_have_no_spread():
    pooled = pool_estimates(np.array([10.0, 10.1, 9.9, 10.05]), np.full(4, 1.0))
    assert pooled.between_sd == 0
    assert pooled.between_interval[0] == 0 < pooled.between_interval[1]
    assert pooled.shrunken == pytest.approx(np.full(4, pooled.mean))


def test_likelihood_is_the_integral_over_the_mean():
    """The restricted likelihood is the product of the densities, integrated over a flat prior of the mean."""
    y, s = np.array([0.2, 1.4, -0.3, 0.9]), np.array([0.3, 0.5, 0.4, 0.2])

    def integrate_mean(tau):
        sd = np.hypot(tau, s)
        return integrate.quad(lambda mean: np.prod(stats.norm.pdf(y, mean, sd)), -5, 5)[0]

    taus = np.linspace(0.0, 3.0, 601)
    values = [np.log(integrate_mean(tau)) for tau in taus]
    best, interval = maximise_likelihood(y, s)
    assert best == pytest.approx(taus[np.argmax(values)], abs=0.006)
    inside = taus[np.array(values) > max(values) - stats.chi2.ppf(0.95, 1) / 2]
    assert interval == pytest.approx((inside[0], inside[-1]), abs=0.01)


def simulate(random, specimens=30, between=1.0):
    sd = random.uniform(0.3, 2.0, specimens)
    truth = random.normal(5.0, between, specimens)
    return truth, truth + sd * random.normal(size=specimens), sd


def test_simulated_spread_is_recovered():
    """The interval has the truth in 95 % of fleets; the plain sd of the estimates is too wide."""
    random, covered, plain, pooled_sds, alarms, errors = np.random.default_rng(1), 0, [], [], 0, []
    for _ in range(200):
        truth, y, sd = simulate(random)
        pooled = pool_estimates(y, sd)
        low, high = pooled.between_interval
        covered += low <= 1.0 <= high
        plain.append(y.std(ddof=1))
        pooled_sds.append(pooled.between_sd)
        alarms += pooled.outliers.any()
        errors.append([np.mean((pooled.shrunken - truth) ** 2), np.mean((y - truth) ** 2)])
    assert stats.binomtest(covered, 200, 0.95).pvalue > 1e-3
    assert np.mean(pooled_sds) == pytest.approx(1.0, abs=0.08)
    assert np.mean(plain) > 1.4  # a negative control: the specimens' own uncertainty is not removed
    assert stats.binomtest(alarms, 200, 0.05).pvalue > 1e-3
    shrunken_error, own_error = np.mean(errors, axis=0)
    assert shrunken_error < 0.6 * own_error


def test_specimen_that_differs_is_an_outlier():
    random = np.random.default_rng(2)
    _, y, sd = simulate(random)
    y[7] += 12.0
    pooled = pool_estimates(y, sd)
    assert np.flatnonzero(pooled.outliers).tolist() == [7]


def test_deviation_is_that_of_a_refit_without_the_specimen():
    _, y, sd = simulate(np.random.default_rng(3), specimens=12)
    pooled = pool_estimates(y, sd)
    for k in (0, 5, 11):
        others = np.arange(12) != k
        rest = pool_estimates(y[others], sd[others])
        expected = (y[k] - rest.mean) / np.sqrt(rest.between_sd**2 + rest.mean_sd**2 + sd[k] ** 2)
        assert pooled.deviation[k] == pytest.approx(expected, rel=0.03)


def test_units_do_not_matter():
    _, y, sd = simulate(np.random.default_rng(4))
    pooled, scaled = pool_estimates(y, sd), pool_estimates(1e9 * y + 7e9, 1e9 * sd)
    assert scaled.between_sd == pytest.approx(1e9 * pooled.between_sd, rel=1e-6)
    assert scaled.mean == pytest.approx(1e9 * pooled.mean + 7e9, rel=1e-9)


def test_refused_estimates():
    with pytest.raises(BadInput, match="a distribution needs 3 specimens; got 2"):
        pool_estimates(np.ones(2), np.ones(2))
    with pytest.raises(BadInput, match="their sd positive"):
        pool_estimates(np.ones(3), np.array([1.0, 0.0, 1.0]))


def test_prior_is_removed_from_a_posterior():
    """The posterior of a normal prior and a normal measurement gives the measurement back."""
    measured, sd, prior, prior_sd = np.array([80.0, 95.0]), np.array([4.0, 9.0]), 100.0, 20.0
    precision = sd**-2 + prior_sd**-2
    posterior = (measured / sd**2 + prior / prior_sd**2) / precision
    value, value_sd = remove_prior(posterior, precision**-0.5, np.full(2, prior), np.full(2, prior_sd))
    assert value == pytest.approx(measured)
    assert value_sd == pytest.approx(sd)


def test_slope_with_equal_sd_is_that_of_least_squares():
    random = np.random.default_rng(5)
    x = np.arange(25.0)
    y = 3.0 + 0.2 * x + random.normal(0, 1.0, 25)
    slope = fit_slope(y, np.full(25, 0.1), x)
    line = stats.linregress(x, y)
    assert slope.value == pytest.approx(line.slope, rel=1e-6)
    assert slope.sd == pytest.approx(line.stderr, rel=1e-3)
    assert slope.p_value == pytest.approx(line.pvalue, rel=0.02)
    assert slope.intercept == pytest.approx(line.intercept, rel=1e-6)


def test_slope_beside_another_quantity_is_that_of_least_squares():
    """The slope within groups equals that of a regression with one intercept for each group."""
    random, n = np.random.default_rng(5), 24
    group = np.arange(n) % 3
    x = random.normal(size=n) + group
    y = 5.0 * group + 0.3 * x + random.normal(size=n)
    shares = (group[:, None] == np.arange(3)).astype(float)
    slope = fit_slope(y, np.full(n, 0.1), x, shares)
    design = np.column_stack([x, shares])
    coefficients, squares, rank, _ = np.linalg.lstsq(design, y, rcond=None)
    sd = np.sqrt(squares[0] / (n - rank) * np.linalg.inv(design.T @ design)[0, 0])
    assert slope.value == pytest.approx(coefficients[0], rel=1e-6)
    assert slope.sd == pytest.approx(sd, rel=1e-3)
    assert abs(fit_slope(y, np.full(n, 0.1), x).value - coefficients[0]) > 5 * sd


def test_quantity_that_others_determine_has_no_slope():
    share = np.repeat([0.0, 1.0], 8)[:, None]
    x = 3.0 + 2.0 * share[:, 0]
    assert fit_slope(np.arange(16.0), np.ones(16), x) is not None
    assert fit_slope(np.arange(16.0), np.ones(16), x, share) is None


def test_slope_without_drift_has_uniform_p_values():
    random = np.random.default_rng(6)
    p_values = []
    for _ in range(300):
        _, y, sd = simulate(random, specimens=15)
        p_values.append(fit_slope(y, sd, random.uniform(size=15)).p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_no_slope_without_a_difference():
    assert fit_slope(np.ones(9), np.ones(9), np.ones(9)) is None
    assert fit_slope(np.arange(4.0), np.ones(4), np.arange(4.0)) is None
