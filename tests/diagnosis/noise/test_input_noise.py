"""Input noise that a memory smooths: the remaining χ² is known in closed form for a delay."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2, compute_input_noise_chi2_and_gradient
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.model.muscle import MuscleReading
from pamjax.model.parameters import find_meaning
from pamjax.parameter import Meaning
from pamjax.records.case import Case
from tests.agreement import ROUNDING, agree
from tests.diagnosis.bank import build_plan_problem, simulate_without_noise
from tests.diagnosis.plain_fits import build_noise

ROWS, NOISE, STIFF, SD = 400, 0.3, 5.0, 2.0

#: Simulated recordings of the muscle.
DRAWS = 30


class Set(eqx.Module):
    """Settings of an artificial recording."""

    pressure: jax.Array
    length: jax.Array


class Spring(eqx.Module):
    """A bare muscle with the force of a spring."""

    rows: Set

    def without_filters(self):
        return self

    def build_muscle(self, values):
        return lambda pressure, length: MuscleReading(STIFF * length, length, length, length, length, length)


@dataclasses.dataclass(frozen=True, eq=False)
class Delayed:
    """A problem with a closed form: its force is delayed by a fraction of a sample, by interpolation."""

    dataset: Spring
    case: Case
    meanings: tuple[Meaning, ...] = (find_meaning("channel_lag.lag"),)
    names: tuple[str, ...] = ("channel_lag.lag",)
    n: int = ROWS
    settings: DiagnosisSettings = DEFAULT_SETTINGS
    samples: None = None

    def find_active_mechanisms(self, values):
        return {"channel_lag"} if values[0] else set()

    def predict(self, values):
        force = STIFF * np.asarray(self.dataset.rows.length)
        late = (1 - values[0]) * force + values[0] * np.roll(force, 1)
        return np.stack([late, np.zeros(ROWS)])

    def predict_with_jacobian(self, values, places):
        force = STIFF * np.asarray(self.dataset.rows.length)
        slope = np.stack([np.roll(force, 1) - force, np.zeros(ROWS)])
        return self.predict(values), np.broadcast_to(slope, (len(places), 2, ROWS))


def build_case(length_sd: float | None) -> Case:
    """Return a recording with time, and with this stated noise of its length, m."""
    case = build_plan_problem().case
    sensors = dataclasses.replace(case.muscle_toml.sensors, pressure=None, length=length_sd)
    return dataclasses.replace(case, muscle_toml=dataclasses.replace(case.muscle_toml, sensors=sensors))


def spring(noise: float | None = NOISE) -> Any:
    bare = Spring(Set(jnp.ones(ROWS), jnp.sin(jnp.linspace(0, 6, ROWS))))
    return Delayed(bare, build_case(noise))


def weights(correlation=0.0):
    return build_noise(Ar1Noise(np.full(ROWS, SD), 0.5, correlation, True))


@pytest.mark.parametrize("late", [0.2, 0.5, 1.0])
def test_fractional_delay_averages_noise_of_two_samples(late):
    # The remaining variance is w² + (1 − w)²: a half at half a sample, all of it at a full sample.
    share = late**2 + (1 - late) ** 2 - 1
    whole = ROWS * (STIFF * NOISE / SD) ** 2
    agree(
        compute_input_noise_chi2(spring(), weights().whiten, np.array([late])),
        whole * share,
        to=ROUNDING,
        scale=whole,
    )


@pytest.mark.parametrize("late", [0.2, 0.5, 0.8])
def test_gradient_of_a_fractional_delay_is_its_closed_form(late):
    whole = ROWS * (STIFF * NOISE / SD) ** 2
    _, gradient = compute_input_noise_chi2_and_gradient(spring(), weights().whiten, np.array([late]), (0,))
    agree(gradient, [whole * (4 * late - 2)], to=ROUNDING, scale=whole)


def test_gradient_is_zero_for_a_muscle_without_memory():
    problem = dataclasses.replace(spring(), names=("muscle.turns",))
    _, gradient = compute_input_noise_chi2_and_gradient(problem, weights().whiten, np.array([0.2]), (0,))
    assert gradient == [0.0]


def test_no_input_noise_without_memory_or_noise_of_settings():
    assert compute_input_noise_chi2(spring(), weights().whiten, np.array([0.0])) == 0.0
    assert compute_input_noise_chi2(spring(noise=None), weights().whiten, np.array([0.5])) == 0.0


def test_correlated_weights_agree_with_the_mean_over_simulations():
    problem, white = spring(), weights(correlation=0.7)
    rng, values = np.random.default_rng(3), np.array([0.5])
    noise = NOISE * STIFF * rng.standard_normal((4000, ROWS))
    force = np.stack([noise, np.zeros_like(noise)], axis=1)
    late = 0.5 * (force + np.roll(force, 1, axis=2))
    each = np.sum(white.whiten(late) ** 2, axis=1) - np.sum(white.whiten(force) ** 2, axis=1)
    # Random correlations of distant samples in the four draws: a few percent.
    assert compute_input_noise_chi2(problem, white.whiten, values) == pytest.approx(each.mean(), rel=0.1)
    # Negative control: weights without correlation give a much smaller value.
    assert abs(compute_input_noise_chi2(problem, weights().whiten, values)) < 0.8 * abs(each.mean())


def test_correction_for_input_noise_is_limited():
    # Linear extrapolation by one sample: four times the variance more, on four hundred samples.
    share = (2.0**2 + 1.0 - 1) * (STIFF * NOISE / SD) ** 2
    assert share > DEFAULT_SETTINGS.max_input_noise_chi2_share
    assert (
        compute_input_noise_chi2(spring(), weights().whiten, np.array([-1.0]))
        == DEFAULT_SETTINGS.max_input_noise_chi2_share * ROWS
    )


@pytest.mark.slow
def test_lag_of_a_muscle_agrees_with_the_mean_over_simulations():
    """A lag of half a sample averages the noise of two settings; only the force was read."""
    problem, rng = simulate_without_noise(), np.random.default_rng(1)
    recording = problem.case.recording
    values = problem.neutral.copy()
    values[problem.index("channel_lag.lag")] = 0.5 * np.median(np.diff(recording.time))
    noise = build_noise(Ar1Noise(np.full(problem.n, 3.0), 1.0, 0.0, True))
    predictions = [problem.predict(x) for x in (values, problem.neutral)]
    differences = []
    for _ in range(DRAWS):
        pressure = recording.pressure + 500.0 * rng.standard_normal(problem.n)
        length = recording.length + 2e-5 * rng.standard_normal(problem.n)
        noisy = dataclasses.replace(recording, pressure=pressure, length=length)
        perturbed = build_library_problem(dataclasses.replace(problem.case, recording=noisy))
        with_lag, without = (
            np.nansum(noise.whiten(perturbed.predict(x) - prediction) ** 2)
            for x, prediction in zip((values, problem.neutral), predictions, strict=True)
        )
        differences.append(with_lag - without)
    expected = np.mean(differences)
    assert compute_input_noise_chi2(problem, noise.whiten, values) == pytest.approx(expected, rel=0.15)
    # The mean over the draws is known better than this, and the lag averages.
    assert np.std(differences) / np.sqrt(DRAWS) < 0.05 * abs(expected)
    assert expected < 0
