"""Input noise that a memory smooths: the remaining χ² is known in closed form for a delay."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2
from pamjax.diagnosis.settings import DEFAULT_SETTINGS, DiagnosisSettings
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.model.muscle import MuscleReading
from tests.agreement import ROUNDING, agree

ROWS, NOISE, STIFF, SD = 400, 0.3, 5.0, 2.0


class Set(eqx.Module):
    """Settings of an artificial recording."""

    pressure: jax.Array
    length: jax.Array


class Spring(eqx.Module):
    """A bare muscle with the force of a spring."""

    rows: Set

    def build_muscle(self, values):
        return lambda pressure, length: MuscleReading(STIFF * length, length, length, length, length, length)


@dataclasses.dataclass(frozen=True)
class Delayed:
    """A problem whose force is delayed by a fraction of a sample, with linear interpolation."""

    dataset: Spring
    reduced_dataset: Spring
    case: SimpleNamespace
    meanings: tuple = (SimpleNamespace(neutral=0.0),)
    n: int = ROWS
    settings: DiagnosisSettings = DEFAULT_SETTINGS

    def active(self, values):
        return {"channel_lag"} if values[0] else set()

    def predict(self, values):
        force = STIFF * np.asarray(self.dataset.rows.length)
        late = (1 - values[0]) * force + values[0] * np.roll(force, 1)
        return np.stack([late, np.zeros(ROWS)])


def spring(noise: float | None = NOISE) -> Any:
    bare = Spring(Set(jnp.ones(ROWS), jnp.sin(jnp.linspace(0, 6, ROWS))))
    sensors = SimpleNamespace(pressure=None, length=noise, length_per_setting=False)
    case = SimpleNamespace(entry=SimpleNamespace(sensors=sensors), recording=SimpleNamespace(has_time=True))
    return Delayed(bare, bare, case)


def weights(correlation=0.0):
    colours = (Ar1Noise(np.full(ROWS, SD), 0.5, correlation, True), None)
    return NoiseModel(
        colours, (np.arange(ROWS), np.arange(0)), (np.array([[0, ROWS]]), np.zeros((0, 2), int))
    )


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


def test_no_input_noise_without_memory_or_noise_of_settings():
    assert compute_input_noise_chi2(spring(), weights().whiten, np.array([0.0])) == 0.0
    assert compute_input_noise_chi2(spring(noise=None), weights().whiten, np.array([0.5])) == 0.0


def test_correlated_weights_agree_with_the_mean_over_simulations():
    found, white = spring(), weights(correlation=0.7)
    rng, values = np.random.default_rng(3), np.array([0.5])
    noise = NOISE * STIFF * rng.standard_normal((4000, ROWS))
    force = np.stack([noise, np.zeros_like(noise)], axis=1)
    late = 0.5 * (force + np.roll(force, 1, axis=2))
    each = np.sum(white.whiten(late) ** 2, axis=1) - np.sum(white.whiten(force) ** 2, axis=1)
    # Random correlations of distant samples in the four draws: a few percent.
    assert compute_input_noise_chi2(found, white.whiten, values) == pytest.approx(each.mean(), rel=0.1)
    # Negative control: weights without correlation give a much smaller value.
    assert abs(compute_input_noise_chi2(found, weights().whiten, values)) < 0.8 * abs(each.mean())


def test_correction_for_input_noise_is_limited():
    # Linear extrapolation by one sample: four times the variance more, on four hundred samples.
    share = (2.0**2 + 1.0 - 1) * (STIFF * NOISE / SD) ** 2
    assert share > DEFAULT_SETTINGS.max_input_noise_chi2_share
    assert (
        compute_input_noise_chi2(spring(), weights().whiten, np.array([-1.0]))
        == DEFAULT_SETTINGS.max_input_noise_chi2_share * ROWS
    )
