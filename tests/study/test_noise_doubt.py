"""What is not known of a correlation matters to a slow direction one way, to a fast one the other."""

import numpy as np
import pytest

from pamjax.study.noise_doubt import doubts
from pamjax.study.whiten import Colour, Whitening, correlation_error

N, RHO = 2000, 0.8


def white(colour, n=N):
    """A channel of force with a colour and one of diameter without correlation."""
    rows = np.arange(n)
    plain = Colour(np.ones(n), 1.0, 0.0, True)
    return Whitening((colour, plain), (rows, rows), (np.array([[0, n]]),) * 2)


def unit(force, diameter=0.0):
    both = np.concatenate([force * np.ones(N), diameter * np.ones(N)])
    return both / np.linalg.norm(both)


COLOUR = Colour(np.ones(N), 1.0, RHO, True)
ALTERNATING = (-1.0) ** np.arange(N)


def test_a_slow_and_a_fast_direction_have_the_closed_form():
    """Constant: S(0) = (1 + ρ) / (1 − ρ); alternating: S(π) is its inverse."""
    error = correlation_error(1.0, RHO, N)
    more = RHO + error
    want = 0.5 * np.log((1 + more) / (1 - more) * (1 - RHO) / (1 + RHO))
    slow, fast = doubts(white(COLOUR), np.stack([unit(1.0), unit(ALTERNATING)]))
    assert slow[0] == pytest.approx(want, rel=1e-6)
    assert fast[0] == pytest.approx(want, rel=1e-6)
    assert slow[1] == fast[1] == 0.0
    # Able to fail: of all frequencies alike only what is left of a sample by its past matters, 1 − ρ².
    any_ = unit(np.random.default_rng(0).standard_normal(N))
    fresh = 0.5 * np.log((1 - RHO**2) / (1 - more**2))
    assert doubts(white(COLOUR), any_[None])[0, 0] == pytest.approx(fresh, rel=0.1)
    assert fresh < 0.9 * want


def test_a_direction_is_in_doubt_by_its_share_of_a_channel():
    whole, half = doubts(white(COLOUR), np.stack([unit(1.0), unit(1.0, 1.0)]))
    assert half[0] == pytest.approx(whole[0] / 2)
    # Of a channel without correlation it is not known that it has none.
    assert half[1] > 0 == whole[1]


def test_noise_that_was_taken_for_less_correlated_is_larger_by_as_much():
    """Simulated: noise of ρ + its error, whitened as of ρ, along a wave of 100 samples."""
    rng, n, draws = np.random.default_rng(2), 200, 20000
    rho = RHO + correlation_error(1.0, RHO, n)
    noise = rng.standard_normal((draws, n))
    for k in range(1, n):
        noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1 - rho**2) * noise[:, k]
    whitening = white(Colour(np.ones(n), 1.0, RHO, True), n)
    along = np.concatenate([np.sin(2 * np.pi * np.arange(n) / 100), np.zeros(n)]) / np.sqrt(n / 2)
    seen = whitening(np.stack([noise, np.zeros_like(noise)], axis=1)) @ along
    want = doubts(whitening, along[None])[0, 0]
    # The logarithm of an sd of 20,000 draws is known to 0.005.
    assert np.log(seen.std()) == pytest.approx(want, abs=0.015)
    assert want > 0.03


def test_noise_of_a_table_has_its_doubt_elsewhere():
    table = Colour(np.ones(N), 1.0, 0.0, False, freedom=4.0)
    assert doubts(white(table), unit(1.0)[None])[0, 0] == 0.0
