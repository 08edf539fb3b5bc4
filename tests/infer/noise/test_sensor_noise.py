"""Noise: its autocorrelation time, propagation through the model, and effect on the sd of a fit."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import pamjax.infer.fitting.reweight
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.noise.autocorrelation import estimate_autocorrelation_time
from pamjax.infer.noise.sensor_noise import compute_correlation_time, compute_effective_sd
from pamjax.infer.problem.dataset import build_dataset
from pamjax.model.assembly import assemble
from pamjax.model.muscle import predict
from pamjax.records.simulate import draw_ar1_noise
from tests.agreement import BY_DIFFERENCE, agree
from tests.infer.made import SENSORS, TRUE, made

ONE_RUN = np.arange(20_000) == 0


def worth(lag_one):
    """Return 1 + 2 Σ ρ_k of an exponential correlation."""
    return (1 + lag_one) / (1 - lag_one)


@pytest.mark.parametrize("lag_one", [0.0, 0.5, 0.9])
def test_inflation_of_known_noise(lag_one):
    times = [
        estimate_autocorrelation_time(draw_ar1_noise(np.random.default_rng(k), 20_000, lag_one), ONE_RUN)
        for k in range(8)
    ]
    # Relative scatter of one estimate: sqrt(2 (2 W + 1) / n), with the window W at two inflations.
    scatter = np.sqrt(2 * (4 * worth(lag_one) + 1) / 20_000)
    agree(np.mean(times), worth(lag_one), 4 * scatter / np.sqrt(8))


def test_autocorrelation_time_is_corrected_for_the_fit():
    given_back, not_given = [], []
    for k in range(200):
        noise = draw_ar1_noise(np.random.default_rng(k), 400, 0.9)
        x = np.linspace(-1, 1, 400)
        left = noise - np.polyval(np.polyfit(x, noise, 2), x)
        given_back.append(estimate_autocorrelation_time(left, ONE_RUN[:400], 3))
        not_given.append(estimate_autocorrelation_time(left, ONE_RUN[:400]))
    assert np.mean(given_back) == pytest.approx(19, rel=0.15)
    assert np.mean(not_given) < 0.75 * 19


def test_effective_number_of_rows_is_at_least_one():
    for k in range(50):
        noise = draw_ar1_noise(np.random.default_rng(k), 200, 0.99)
        assert 1 <= estimate_autocorrelation_time(noise, ONE_RUN[:200], 5) <= 200


def test_blank_cells_are_ignored():
    noise = draw_ar1_noise(np.random.default_rng(0), 20_000, 0.9)
    noise[::3] = np.nan
    assert np.isfinite(estimate_autocorrelation_time(noise, ONE_RUN))


def test_correlation_ignores_gaps():
    # The mean increases from run to run; within a run the noise is white.
    rng = np.random.default_rng(1)
    starts = np.arange(4000) % 2 == 0
    steps = np.repeat(rng.choice([-1.0, 1.0], 2000), 2)
    agree(estimate_autocorrelation_time(steps, starts), 3.0, 0.05)
    assert estimate_autocorrelation_time(rng.standard_normal(4000), starts) < 1.2


def test_single_readings_and_short_tables_count_as_independent():
    assert estimate_autocorrelation_time(np.ones(100), np.ones(100, dtype=bool)) == 1.0
    assert estimate_autocorrelation_time(np.ones(29), np.arange(29) == 0) == 1.0


def test_correlation_time_is_recovered():
    case = made()
    there = np.ones(case.recording.n, dtype=bool)
    agree(compute_correlation_time(worth(np.exp(-1 / 7.0)), case.recording, there), 7.0, 1e-9)
    assert compute_correlation_time(1.0, case.recording, there) == 0.0
    assert compute_correlation_time(9.0, dataclasses.replace(case.recording, time=None), there) == 0.0


def test_noise_of_pressure_and_length_is_propagated():
    case = made(off=(0, 0, 0))
    at, (rename,) = build_joint_space([case], "elastic", ())
    dataset = build_dataset(case, "elastic", at, rename)
    sd = compute_effective_sd(dataset, at.to_values(jnp.zeros(at.size)), SENSORS, (2.0, 5e-5))[:, 30]
    muscle = assemble("elastic", {k: jnp.asarray(v) for k, v in TRUE.items()})
    p, x = case.recording.pressure[30], case.recording.length[30]

    def slopes(channel):
        up, down = (getattr(predict(muscle, [p + s], [x]), channel)[0] for s in (10.0, -10.0))
        long, short = (getattr(predict(muscle, [p], [x + s]), channel)[0] for s in (1e-6, -1e-6))
        return (up - down) / 20.0, (long - short) / 2e-6

    for k, (channel, own) in enumerate((("force", 2.0), ("diameter", 5e-5))):
        by_pressure, by_length = slopes(channel)
        agree(sd[k], np.sqrt(own**2 + (700 * by_pressure) ** 2 + (2e-5 * by_length) ** 2), BY_DIFFERENCE)


def widening(lag_one):
    """Return the sd of a fit to correlated noise, relative to a fit to white noise."""
    bench = dataclasses.replace(SENSORS, pressure=None, length=None)
    white, coloured_ = (
        fit(made(bench=bench, sensors=bench, lag_one=r), starts=1, fold_count=2) for r in (0.0, lag_one)
    )
    return np.mean([coloured_.estimates[n].sd / e.sd for n, e in white.estimates.items()])


def test_correlated_noise_increases_the_sd():
    assert widening(0.8) == pytest.approx(np.sqrt(worth(0.8)), rel=0.35)


def test_sd_without_correction_is_too_small(monkeypatch):
    module = pamjax.infer.fitting.reweight
    monkeypatch.setattr(module, "compute_variance_inflation", lambda *_: 1.0)
    whitened = widening(0.8)
    assert whitened > 0.65 * np.sqrt(worth(0.8))
    # Without the filter, the samples count as independent.
    estimate = module.estimate_noise_model

    def ignore_correlation(*arguments):
        noise = estimate(*arguments)
        channels = (c and dataclasses.replace(c, correlation=0.0) for c in noise.by_channel)
        return dataclasses.replace(noise, by_channel=tuple(channels))

    monkeypatch.setattr(module, "estimate_noise_model", ignore_correlation)
    assert widening(0.8) < 0.65 * np.sqrt(worth(0.8))


def test_noise_of_an_unstated_sensor_is_estimated():
    unstated = fit(
        made(sensors=dataclasses.replace(SENSORS, force=None, diameter=None)), starts=1, fold_count=2
    )
    stated = fit(made(), starts=1, fold_count=2)
    for channel, noise in unstated.cases[0].noise.items():
        assert not noise.is_stated
        assert noise.sd == pytest.approx(stated.cases[0].noise[channel].sd, rel=0.2)


def test_misfit_above_the_sensor_noise_counts_as_noise():
    bench = dataclasses.replace(SENSORS, force=20.0, diameter=0.5e-3)
    sure, unsure = fit(made(), starts=1, fold_count=2), fit(made(bench=bench), starts=1, fold_count=2)
    assert unsure.cases[0].noise["diameter"].rms_over_noise == pytest.approx(10, rel=0.2)
    assert "the noise of neighbouring samples is 0.445 mm" in str(unsure)
    assert "check the noise in [sensors]" in str(unsure)
    assert unsure.estimates["thread.modulus"].sd > 4 * sure.estimates["thread.modulus"].sd
