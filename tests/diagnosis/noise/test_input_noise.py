"""Noise of what was set, passed on by a memory: the χ² it leaves is known in closed form for a delay."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.noise.input_noise import MAX_CHI2_CREDIT_SHARE, compute_input_noise_chi2
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.model.muscle import MuscleReading
from tests.agreement import ROUNDING, agree

ROWS, NOISE, STIFF, SD = 400, 0.3, 5.0, 2.0


class Set(eqx.Module):
    """What was set."""

    pressure: jax.Array
    length: jax.Array


class Spring(eqx.Module):
    """A bare muscle that is a spring."""

    rows: Set

    def build_muscle(self, values):
        return lambda pressure, length: MuscleReading(STIFF * length, length, length, length, length, length)


@dataclasses.dataclass(frozen=True)
class Delayed:
    """A problem whose force is late by a share of a sample, interpolated in a straight line."""

    dataset: Spring
    reduced_dataset: Spring
    case: SimpleNamespace
    meanings: tuple = (SimpleNamespace(neutral=0.0),)
    n: int = ROWS

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
def test_a_delay_between_samples_leaves_what_averaging_two_leaves(late):
    # w² + (1 − w)² of the variance is left: a half at half a sample, all of it at a whole one.
    share = late**2 + (1 - late) ** 2 - 1
    whole = ROWS * (STIFF * NOISE / SD) ** 2
    agree(
        compute_input_noise_chi2(spring(), weights().whiten, np.array([late])),
        whole * share,
        to=ROUNDING,
        scale=whole,
    )


def test_without_a_memory_or_noise_of_what_was_set_nothing_is_passed_on():
    assert compute_input_noise_chi2(spring(), weights().whiten, np.array([0.0])) == 0.0
    assert compute_input_noise_chi2(spring(noise=None), weights().whiten, np.array([0.5])) == 0.0


def test_under_correlated_weights_the_mean_over_noise_comes_out():
    found, white = spring(), weights(correlation=0.7)
    rng, values = np.random.default_rng(3), np.array([0.5])
    noise = NOISE * STIFF * rng.standard_normal((4000, ROWS))
    force = np.stack([noise, np.zeros_like(noise)], axis=1)
    late = 0.5 * (force + np.roll(force, 1, axis=2))
    each = np.sum(white.whiten(late) ** 2, axis=1) - np.sum(white.whiten(force) ** 2, axis=1)
    # Far neighbours are left in the four draws, by chance: a few percent.
    assert compute_input_noise_chi2(found, white.whiten, values) == pytest.approx(each.mean(), rel=0.1)
    # Able to fail: weights that knew no correlation would say much less.
    assert abs(compute_input_noise_chi2(found, weights().whiten, values)) < 0.8 * abs(each.mean())


def test_a_model_that_makes_very_much_of_noise_is_not_forgiven_all_of_it():
    # Early by a sample, in a straight line: four times the variance more, on four hundred samples.
    share = (2.0**2 + 1.0 - 1) * (STIFF * NOISE / SD) ** 2
    assert share > MAX_CHI2_CREDIT_SHARE
    assert (
        compute_input_noise_chi2(spring(), weights().whiten, np.array([-1.0])) == MAX_CHI2_CREDIT_SHARE * ROWS
    )
