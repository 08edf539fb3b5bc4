"""Errors in variables: without a correction, an estimated lag is biased to half a sample."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.diagnosis.noise.input_noise import compute_input_noise_chi2
from pamjax.diagnosis.refit.errors_in_variables import correct_input_noise_bias, estimate_input_noise_bias
from pamjax.diagnosis.refit.least_squares import fit_parameters
from tests.diagnosis.noise.test_input_noise import (
    NOISE,
    ROWS,
    SD,
    STIFF,
    Delayed,
    Set,
    Spring,
    build_case,
    weights,
)

LATE, MANY = 0.12, 40


@dataclasses.dataclass(frozen=True, eq=False)
class Measured(Delayed):
    """The delayed spring as a recording with noise of length and force."""

    measured: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((2, ROWS)))
    is_logarithmic: np.ndarray = dataclasses.field(default_factory=lambda: np.array([False]))
    is_baseline: np.ndarray = dataclasses.field(default_factory=lambda: np.array([False]))
    low: np.ndarray = dataclasses.field(default_factory=lambda: np.array([0.0]))
    high: np.ndarray = dataclasses.field(default_factory=lambda: np.array([1.0]))
    prior_sd: np.ndarray = dataclasses.field(default_factory=lambda: np.array([np.inf]))
    start: np.ndarray = dataclasses.field(default_factory=lambda: np.array([0.0]))


def recording(seed: int) -> Measured:
    rng = np.random.default_rng(seed)
    # A stroke that is steep enough to show a lag: a few sd of noise per sample.
    true = 3.0 * np.sin(np.linspace(0, 20 * np.pi, ROWS))
    late = (1 - LATE) * true + LATE * np.roll(true, 1)
    written = Spring(Set(jnp.ones(ROWS), jnp.asarray(true + NOISE * rng.standard_normal(ROWS))))
    problem = Measured(written, build_case(NOISE))
    return dataclasses.replace(
        problem, measured=np.stack([STIFF * late + SD * rng.standard_normal(ROWS), np.zeros(ROWS)])
    )


@pytest.mark.slow
@pytest.mark.parametrize("own", [False, True])
def test_lag_is_estimated_without_bias(own):
    # For parameters of the library, and for baseline parameters, which start away from their limits.
    raw, freed = [], []
    for seed in range(MANY):
        problem = dataclasses.replace(recording(seed), is_baseline=np.array([own]))
        at = fit_parameters(problem, weights(), [0], np.array([0.5]))
        end, of_noise = correct_input_noise_bias(problem, weights(), at)
        assert end.chi2_with_priors - of_noise <= at.chi2_with_priors - compute_input_noise_chi2(
            problem, weights().whiten, at.values
        )
        raw.append(at.values[0])
        freed.append(end.values[0])
    error = np.std(freed) / np.sqrt(MANY)
    assert abs(np.mean(freed) - LATE) < 3 * error
    # Negative control: the uncorrected minimum is strongly biased towards one half.
    assert np.mean(raw) - LATE > 5 * error


def test_model_without_input_noise_is_not_corrected():
    problem = recording(0)
    still = dataclasses.replace(problem, case=build_case(None))
    at = fit_parameters(still, weights(), [0], np.array([0.5]))
    assert correct_input_noise_bias(still, weights(), at) == (at, 0.0)


@pytest.mark.slow
def test_correction_agrees_with_a_second_addition_of_noise():
    raw, pull = [], []
    for seed in range(MANY):
        problem = recording(seed)
        at = fit_parameters(problem, weights(), [0], np.array([0.5]))
        raw.append(at.values[0] - LATE)
        pull.append(
            estimate_input_noise_bias(
                problem, weights(), correct_input_noise_bias(problem, weights(), at)[0]
            )[0]
        )
    assert 0.5 < np.mean(pull) / np.mean(raw) < 2.0
