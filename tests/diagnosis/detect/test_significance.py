"""The global p-value of the largest of many correlated directions."""

import numpy as np
import pytest
from scipy.stats import norm, t

from pamjax.diagnosis.detect import significance as under_test
from pamjax.diagnosis.detect.significance import (
    _compute_deviation,
    _compute_sd_bound,
    _estimate_tail_probability,
    compute_significance,
)
from pamjax.diagnosis.detect.tested_subsets import compute_subset_shifts
from pamjax.diagnosis.noise.uncertainty import NORMAL_NODES, NoiseUncertainty, estimate_noise_uncertainty
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.ar1_filter import Ar1Noise
from tests.diagnosis.bank import simulate_without_noise
from tests.diagnosis.plain_fits import build_estimate, build_noise


def doubt(log_sd):
    """Return a noise uncertainty: the sd of ln(standard deviation) of each direction, (k,)."""
    by = np.exp(2 * np.outer(log_sd, NORMAL_NODES))[:, None]
    return NoiseUncertainty(np.zeros(len(log_sd)), by)


def sure(many):
    return doubt(np.zeros(many))


def directions(many, size, seed=0):
    """Return unit directions with correlated neighbours."""
    rng = np.random.default_rng(seed)
    raw = np.cumsum(rng.standard_normal((many, size)), axis=0)
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)


@pytest.mark.slow
def test_p_values_are_uniform_without_an_effect():
    rows = directions(40, 300)
    rng = np.random.default_rng(1)
    largest = np.abs(rows @ rng.standard_normal((300, 400))).max(axis=0)
    p = np.array([_estimate_tail_probability(rows @ rows.T, x, sure(40), seed=2) for x in largest])
    # The Kolmogorov-Smirnov distance of 400 uniform values exceeds 0.0815 with probability 0.01.
    assert np.max(np.abs(np.sort(p) - (np.arange(400) + 0.5) / 400)) < 0.0815


@pytest.mark.slow
def test_p_values_are_uniform_for_one_sided_directions():
    rows, either = directions(40, 300), np.arange(40) < 4
    rng = np.random.default_rng(3)
    largest = _compute_deviation(rng.standard_normal((150, 300)) @ rows.T, either).max(axis=1)
    # The distance of 150 uniform values exceeds 0.133 with probability 0.01.
    p = np.array(
        [_estimate_tail_probability(rows @ rows.T, x, sure(40), seed=2, is_two_sided=either) for x in largest]
    )
    assert np.max(np.abs(np.sort(p) - (np.arange(150) + 0.5) / 150)) < 0.133
    both = np.array([_estimate_tail_probability(rows @ rows.T, x, sure(40), seed=2) for x in largest])
    assert np.max(np.abs(np.sort(both) - (np.arange(150) + 0.5) / 150)) > 0.133


def test_tail_continues_the_distribution_of_the_draws():
    rows = directions(40, 300)
    gram = rows @ rows.T
    chances = [_estimate_tail_probability(gram, x, sure(40), seed=2) for x in np.linspace(3.0, 6.0, 13)]
    steps = np.diff(np.log(chances))
    assert np.all(steps < 0)
    # No jump: each step is slightly steeper than the previous one.
    assert np.all(np.abs(np.diff(steps)) < 1.0)


def test_single_direction_has_the_normal_p_value():
    assert _estimate_tail_probability(np.eye(1), 1.96, sure(1), seed=0) == pytest.approx(0.05, abs=0.01)
    assert _estimate_tail_probability(np.eye(1), 5.0, sure(1), seed=0) == pytest.approx(5.7e-7, rel=0.5)


def seen(deviation, log_sd):
    """Return the p-value of the largest of five deviations with uncertain noise."""
    five = doubt(np.full(5, log_sd))
    return _estimate_tail_probability(np.eye(5), deviation / _compute_sd_bound(five)[0], five, seed=0)


def test_noise_uncertainty_increases_the_p_value():
    assert seen(4.0, 0.2) > 3 * seen(4.0, 0.0)


def test_uncertain_noise_of_one_direction_hardly_affects_the_others(monkeypatch):
    """Thirty directions, one with uncertain noise; the others have about the same p-values as without it."""
    uncertainty = doubt(np.r_[0.6, np.zeros(29)])
    known = _estimate_tail_probability(np.eye(30), 4.2, sure(30), seed=0)
    assert known < _estimate_tail_probability(np.eye(30), 4.2, uncertainty, seed=0) < 4 * known
    # Negative control: without scaling, the uncertain direction hides it.
    monkeypatch.setattr(under_test, "_compute_sd_bound", lambda doubt: np.ones(30))
    assert _estimate_tail_probability(np.eye(30), 4.2, uncertainty, seed=0) > 10 * known


def test_tail_of_uncertain_noise_has_the_closed_form():
    """One direction with normal ln(sd): the p-value is an integral over it, far beyond all draws."""
    log_sd, far = 0.3, 6.0
    scale = np.linspace(-4, 4, 4001)
    want = 2 * np.trapezoid(norm.sf(far / np.exp(log_sd * scale)) * norm.pdf(scale), scale)
    uncertainty = doubt(np.array([log_sd]))
    assert want < 1e-3
    assert _estimate_tail_probability(
        np.eye(1), far / _compute_sd_bound(uncertainty)[0], uncertainty, seed=0
    ) == pytest.approx(want, rel=0.02)
    # Negative control: known noise has no such tail.
    assert _estimate_tail_probability(np.eye(1), far, sure(1), seed=0) < 1e-2 * want


@pytest.mark.parametrize("alike", [0.0, 0.99])
def test_tail_of_many_uncertain_directions_agrees_with_simulation(alike):
    """Two hundred directions of one uncertain noise, independent or nearly identical; half one-sided."""
    many, log_sd, far = 200, 0.5, 9.0
    gram = np.full((many, many), alike) + (1 - alike) * np.eye(many)
    either = np.arange(many) < 100
    every = doubt(np.full(many, log_sd))
    rng = np.random.default_rng(4)
    hits = []
    for _ in range(40):
        shared, own = rng.standard_normal((2000, 1)), rng.standard_normal((2000, many))
        drawn = np.sqrt(alike) * shared + np.sqrt(1 - alike) * own
        drawn *= np.exp(log_sd * rng.standard_normal((2000, 1)))
        hits.append(np.mean(_compute_deviation(drawn, either).max(axis=1) >= far))
    want, error = np.mean(hits), np.std(hits) / np.sqrt(40)
    assert 1e-4 < want < 0.1
    assert _estimate_tail_probability(
        gram, far / _compute_sd_bound(every)[0], every, is_two_sided=either
    ) == pytest.approx(want, abs=4 * error)
    # Negative control: independent directions of known noise have another tail.
    assert (
        abs(
            _estimate_tail_probability(
                np.eye(many), far / _compute_sd_bound(every)[0], sure(many), is_two_sided=either
            )
            - want
        )
        > 8 * error
    )


def test_noise_estimate_of_a_table_is_shared_by_all_directions():
    """Simulation: fifty directions divided by one mean square with three degrees of freedom."""
    rng, freedom, far = np.random.default_rng(5), 3.0, 12.0
    drawn = np.abs(rng.standard_normal((200_000, 50))).max(axis=1)
    want = np.mean(drawn / np.sqrt(rng.chisquare(freedom, drawn.size) / freedom) > far)
    assert _estimate_tail_probability(np.eye(50), far, sure(50), freedom) == pytest.approx(want, rel=0.05)
    # Negative control: with one mean square for each of the fifty, this deviation is far more frequent.
    assert 1 - (1 - 2 * t.sf(far, freedom)) ** 50 > 2 * want


def test_without_directions_nothing_is_significant():
    assert _estimate_tail_probability(np.eye(0), 0.0, sure(0)) == 1.0


def test_correlation_errors_of_both_signs_are_considered():
    """A fast direction has more noise for a smaller correlation."""
    fast = NoiseUncertainty(np.zeros(1), np.exp(-2 * 0.3 * NORMAL_NODES)[None, None])
    assert _compute_sd_bound(fast) == pytest.approx([np.exp(0.6)])
    slow_and_fast = np.stack([0.5 * np.exp(2 * 0.3 * NORMAL_NODES), 0.5 * np.exp(-2 * 0.3 * NORMAL_NODES)])[
        None
    ]
    assert _compute_sd_bound(NoiseUncertainty(np.zeros(1), slow_and_fast)) == pytest.approx([np.exp(0.6)])


def test_noise_estimate_of_few_rows_increases_the_p_value():
    """One direction with Student's t noise: the closed form."""
    gram = np.eye(1)
    for deviation, freedom in ((3.0, 3.0), (25.0, 3.0), (25.0, 2.0)):
        want = 2 * t.sf(deviation, freedom)
        assert _estimate_tail_probability(gram, deviation, sure(1), freedom, 0) == pytest.approx(
            want, rel=0.25
        )
    # Negative control: with known noise this deviation is practically impossible.
    assert _estimate_tail_probability(gram, 25.0, sure(1), np.inf, 0) < 1e-100


@pytest.mark.parametrize("freedom", [np.inf, 3.0])
@pytest.mark.parametrize("log_sd", [0.3, 2.0])
def test_underflow_of_the_tail_loses_no_deviation(log_sd, freedom):
    chances = [
        _estimate_tail_probability(np.eye(5), x, doubt(np.full(5, log_sd)), freedom, 0)
        for x in (1e4, 1e6, 1e8)
    ]
    assert np.all(np.isfinite(chances))
    assert chances[0] >= chances[1] >= chances[2]
    assert chances[2] < 1e-6


@pytest.mark.slow
def test_observed_deviation_is_scaled_like_the_draws():
    """A deviation of 4 sd along a slow direction of a channel; its sensor noise is a fifth of its noise."""
    problem = simulate_without_noise()
    noise = build_noise(Ar1Noise(np.ones(problem.n), 0.2, 0.0, True, rho_from_differences=0.4))
    shifts = compute_subset_shifts(problem, noise)
    shifts /= np.linalg.norm(shifts, axis=1, keepdims=True)
    longest = int(np.argmax(np.count_nonzero(shifts, axis=1)))
    estimate = build_estimate(problem.neutral, residual=4.0 * shifts[longest])
    result = compute_significance(problem, noise, estimate, [])
    assert result.direction_count == len(shifts)
    uncertainty = estimate_noise_uncertainty(noise, shifts, DEFAULT_SETTINGS)
    bound = _compute_sd_bound(uncertainty)
    assert bound[longest] > 1.3
    assert result.largest_deviation == pytest.approx((np.abs(shifts @ estimate.residual) / bound).max())
    # Negative control: without scaling, the p-value is that of a deviation larger by the bound.
    unscaled = _estimate_tail_probability(shifts @ shifts.T, 4.0, uncertainty)
    assert unscaled < 0.5 * result.p_value
