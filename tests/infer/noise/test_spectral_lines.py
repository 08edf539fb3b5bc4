"""Periodic disturbances are removed before the noise is estimated, and noise stays."""

import numpy as np
import pytest

from pamjax.infer.noise.spectral_lines import (
    _fit_wave,
    compute_relative_power,
    refine_frequency,
    remove_spectral_lines,
)

N = 1500
TIME = 0.5 * np.arange(N)
ROWS = np.arange(N)


def draw_noise(correlation, seed):
    """Return AR(1) noise of unit variance, (n,)."""
    rng, out = np.random.default_rng(seed), np.empty(N)
    out[0] = rng.standard_normal()
    for k, step in enumerate(np.sqrt(1 - correlation**2) * rng.standard_normal(N - 1), 1):
        out[k] = correlation * out[k - 1] + step
    return out


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_noise_has_no_lines(correlation):
    unchanged = sum(
        np.array_equal(noise, remove_spectral_lines(noise, ROWS, TIME))
        for noise in (draw_noise(correlation, seed) for seed in range(100))
    )
    # One in 10,000 white recordings has a line; the local mean of correlated noise is less exact.
    assert unchanged >= 98


def test_a_wave_is_removed_and_the_noise_stays():
    noise = draw_noise(0.3, 1)
    wave = 2.0 * np.sin(2 * np.pi * 0.1037 * TIME + 0.4)
    cleaned = remove_spectral_lines(noise + wave, ROWS, TIME)
    assert np.std(cleaned - noise) < 0.1
    assert np.std(wave) > 1.4


@pytest.mark.parametrize("frequency", [0.02, 0.1037, 0.9, 1.0])
def test_frequency_and_wave_agree_with_least_squares(frequency):
    values = draw_noise(0.3, 5) + 2.0 * np.sin(2 * np.pi * frequency * TIME + 0.4)
    trials = frequency + np.linspace(-1, 1, 21) / np.ptp(TIME)
    waves = []
    for trial in trials:
        columns = np.stack([np.cos(2 * np.pi * trial * TIME), np.sin(2 * np.pi * trial * TIME)], axis=1)
        waves.append(columns @ np.linalg.lstsq(columns, values, rcond=None)[0])
    best = int(np.argmax(np.sum(np.square(waves), axis=1)))
    assert refine_frequency(values, TIME, frequency) == pytest.approx(trials[best], rel=1e-12)
    assert np.abs(_fit_wave(values, TIME, trials[best]) - waves[best]).max() < 1e-10


def test_a_wave_of_variable_amplitude_has_several_lines():
    noise = draw_noise(0.0, 2)
    wave = (1 + 0.8 * np.cos(2 * np.pi * 0.02 * TIME)) * 2.0 * np.sin(2 * np.pi * 0.1037 * TIME)
    assert np.std(remove_spectral_lines(noise + wave, ROWS, TIME)) < 1.1


def test_only_the_rows_in_use_change():
    values = draw_noise(0.0, 3) + 3 * np.sin(2 * np.pi * 0.1 * TIME)
    rows = ROWS[: N // 2]
    cleaned = remove_spectral_lines(values, rows, TIME)
    assert np.std(cleaned[rows]) < 1.2
    assert np.array_equal(cleaned[N // 2 :], values[N // 2 :])


def test_power_is_relative_to_the_noise_around_it():
    frequencies, power = compute_relative_power(draw_noise(0.9, 4), TIME)
    assert np.median(power) == pytest.approx(np.log(2), rel=0.1)
    # Correlated noise is slow; without the local mean its slow part would look like lines.
    assert power.max() < np.log(1e4 * power.size)
    assert frequencies[0] == pytest.approx(10 / 750, rel=0.01)


def test_short_recordings_stay():
    short = np.sin(np.arange(50.0))
    assert remove_spectral_lines(short, np.arange(50), np.arange(50.0)) is short or np.array_equal(
        remove_spectral_lines(short, np.arange(50), np.arange(50.0)), short
    )
