"""Uncertainty of an autocorrelation: opposite effects on slow and on fast directions."""

import numpy as np
import pytest
from scipy.stats import norm

from pamjax.diagnosis.noise.uncertainty import (
    NORMAL_NODES,
    _compute_correlation_nodes,
    estimate_noise_uncertainty,
)
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error
from pamjax.infer.noise.noise_model import NoiseModel

N, RHO = 2000, 0.8


def white(colour, n=N):
    """Return a correlated force channel and an uncorrelated diameter channel."""
    rows = np.arange(n)
    plain = Ar1Noise(np.ones(n), 1.0, 0.0, True)
    return NoiseModel((colour, plain), (rows, rows), (np.array([[0, n]]),) * 2)


def unit(force, diameter=0.0):
    both = np.concatenate([force * np.ones(N), diameter * np.ones(N)])
    return both / np.linalg.norm(both)


COLOUR = Ar1Noise(np.ones(N), 1.0, RHO, True, rho_from_differences=RHO)
ALTERNATING = (-1.0) ** np.arange(N)
ABOVE = np.array([[1.0, 0.0]])


def test_slow_and_fast_directions_have_the_closed_form():
    """Constant: S(0) = (1 + ρ) / (1 − ρ); alternating: S(π) is its inverse."""
    more = RHO + compute_correlation_error(1.0, RHO, N)
    want = (1 + more) / (1 - more) * (1 - RHO) / (1 + RHO)
    slow, fast = (
        estimate_noise_uncertainty(
            white(COLOUR), np.stack([unit(1.0), unit(ALTERNATING)]), DEFAULT_SETTINGS
        ).compute_sd(ABOVE)[0]
        ** 2
    )
    assert slow == pytest.approx(want, rel=1e-3)
    assert fast == pytest.approx(1 / want, rel=1e-3)
    # Negative control: for a direction with all frequencies, only the innovation variance 1 − ρ² matters.
    any_ = unit(np.random.default_rng(0).standard_normal(N))
    assert estimate_noise_uncertainty(white(COLOUR), any_[None], DEFAULT_SETTINGS).compute_sd(ABOVE)[
        0, 0
    ] ** 2 < 1 + 0.9 * (want - 1)


def test_direction_combines_channels_and_priors():
    both = np.concatenate([unit(1.0, 1.0), [1.0]]) / np.sqrt(2)
    doubt = estimate_noise_uncertainty(white(COLOUR), both[None], DEFAULT_SETTINGS)
    force = (
        estimate_noise_uncertainty(white(COLOUR), unit(1.0)[None], DEFAULT_SETTINGS).compute_sd(ABOVE)[0, 0]
        ** 2
    )
    # The estimated correlation of the diameter is zero.
    assert doubt.compute_sd(ABOVE)[0, 0] ** 2 == pytest.approx(0.25 * force + 0.25 + 0.5, rel=1e-3)
    assert doubt.known_variance == pytest.approx([0.5])


def test_underestimated_correlation_increases_the_noise():
    """Simulation: noise of ρ + its error, whitened with ρ, along a wave of 100 samples."""
    rng, n, draws = np.random.default_rng(2), 200, 20000
    rho = RHO + compute_correlation_error(1.0, RHO, n)
    noise = rng.standard_normal((draws, n))
    for k in range(1, n):
        noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1 - rho**2) * noise[:, k]
    whitening = white(Ar1Noise(np.ones(n), 1.0, RHO, True, rho_from_differences=RHO), n)
    along = np.concatenate([np.sin(2 * np.pi * np.arange(n) / 100), np.zeros(n)]) / np.sqrt(n / 2)
    seen = whitening.whiten(np.stack([noise, np.zeros_like(noise)], axis=1)) @ along
    want = np.log(
        estimate_noise_uncertainty(whitening, along[None], DEFAULT_SETTINGS).compute_sd(ABOVE)[0, 0]
    )
    # ln(sd) from 20,000 draws has a standard error of 0.005.
    assert np.log(seen.std()) == pytest.approx(want, abs=0.015)
    assert want > 0.03


def test_weak_slow_noise_may_be_undetected():
    """If a channel's own noise is a fifth, differences of neighbours hardly determine the correlation."""
    few, n = 0.2, 700
    noise = Ar1Noise(np.ones(n), few, 0.0, True, rho_from_differences=0.4)
    direction = np.concatenate([np.ones(n), np.zeros(n)]) / np.sqrt(n)
    far = (
        estimate_noise_uncertainty(white(noise, n), direction[None], DEFAULT_SETTINGS).compute_sd(
            np.array([[2.0, 0.0]])
        )[0, 0]
        ** 2
    )
    assert far > 1 - few + few * 1.8 / 0.2
    # Negative control: if it is the complete noise, the same differences exclude it.
    clear = Ar1Noise(np.ones(n), 1.0, 0.0, True, rho_from_differences=0.02)
    assert (
        estimate_noise_uncertainty(white(clear, n), direction[None], DEFAULT_SETTINGS).compute_sd(
            np.array([[2.0, 0.0]])
        )[0, 0]
        ** 2
        < 1.3
    )


def test_posterior_of_the_correlation_agrees_with_bayes_rule():
    """Simulation: half of the channels uncorrelated, half with any correlation, and their differences."""
    colour, n = Ar1Noise(np.ones(N), 1.0, 0.0, True, rho_from_differences=0.06), 700
    error = compute_correlation_error(1.0, colour.rho_from_differences, n)
    rng = np.random.default_rng(1)
    rho = np.where(
        rng.random(4_000_000) < 0.5, 0.0, rng.uniform(0, DEFAULT_SETTINGS.max_noise_correlation, 4_000_000)
    )
    alike = np.abs(rho + error * rng.standard_normal(rho.size) - colour.rho_from_differences) < 0.1 * error
    want = np.quantile(rho[alike], norm.cdf(NORMAL_NODES[::4]))
    assert _compute_correlation_nodes(colour, n, DEFAULT_SETTINGS)[::4] == pytest.approx(want, abs=0.01)


def test_noise_of_a_table_has_no_uncertain_correlation():
    table = Ar1Noise(np.ones(N), 1.0, 0.0, False, degrees_of_freedom=4.0)
    there = estimate_noise_uncertainty(white(table), unit(1.0)[None], DEFAULT_SETTINGS).compute_sd(
        np.array([[-4.0, 0.0], [4.0, 0.0]])
    )
    assert there == pytest.approx(np.ones((2, 1)))
