"""Variance of a prediction at the turns of a recording."""

import inspect

import numpy as np
import pytest

from pamjax.benchmark.bank_trial import run_bank_trial
from pamjax.benchmark.inject_effect import inject_effects
from pamjax.benchmark.trial import TrialTask
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.noise.turn_variance import estimate_turn_variance
from pamjax.model.registry import MECHANISMS
from pamjax.records.turns import find_turns
from tests.diagnosis.bank import build_setup

DAMPING = 2e4


@pytest.fixture(scope="module")
def problem():
    case = inject_effects(0, np.random.default_rng(5), setup=build_setup()).case
    return build_library_problem(case)


def switch_on(problem, **parameters):
    values = problem.neutral.copy()
    for name, value in parameters.items():
        values[problem.index(name.replace("__", "."))] = value
    return values


@pytest.mark.parametrize("kind", MECHANISMS)
def test_mechanisms_with_a_rate_say_so(kind):
    assert kind.uses_rate == (".rate(" in inspect.getsource(kind))


def test_without_a_rate_there_is_no_variance(problem):
    assert estimate_turn_variance(problem, problem.neutral) is None
    assert estimate_turn_variance(problem, switch_on(problem, force_offset__offset=5.0)) is None
    assert estimate_turn_variance(problem, switch_on(problem, channel_lag__lag=0.5)) is None


@pytest.mark.slow
def test_damping_has_half_of_the_difference_between_both_speeds(problem):
    values = switch_on(problem, viscous_damping__coefficient=DAMPING, viscous_damping__pressed=0.0)
    variance = estimate_turn_variance(problem, values)
    recording = problem.case.recording
    turns = np.flatnonzero(find_turns(recording))
    speed = np.diff(recording.length) / np.diff(recording.time)
    # With a power of one the force is proportional to the speed.
    expected = DAMPING / 2 * np.abs(speed[turns - 1] - speed[turns])
    assert np.sqrt(variance[0, turns]) == pytest.approx(expected, rel=0.03)
    assert np.all(variance[:, ~find_turns(recording)] == 0)
    assert expected.min() > 5.0


@pytest.mark.slow
def test_a_delay_adds_no_variance(problem):
    damping = {"viscous_damping__coefficient": DAMPING}
    alone = estimate_turn_variance(problem, switch_on(problem, **damping))
    delayed = estimate_turn_variance(problem, switch_on(problem, **damping, channel_lag__lag=0.5))
    assert np.array_equal(alone, delayed)


@pytest.mark.slow
def test_a_turn_is_a_run_of_its_own(problem):
    training = np.ones(problem.n, dtype=bool)
    plain = estimate_noise(problem, problem.neutral, training)
    noise = estimate_noise(problem, switch_on(problem, viscous_damping__coefficient=DAMPING), training)
    turns = np.flatnonzero(find_turns(problem.case.recording))
    rows, runs = noise.rows[0], noise.runs[0]
    alone = rows[runs[runs[:, 1] - runs[:, 0] == 1, 0]]
    assert set(turns) <= set(alone)
    assert len(plain.runs[0]) < len(runs)
    sd = noise.by_channel[0].sd
    assert np.all(sd[turns] > 2 * np.median(sd))
    # The reported noise is that of the other samples.
    assert noise.compute_rms_sd(0) < 1.1 * np.median(sd)


@pytest.mark.slow
def test_an_unknown_speed_at_a_turn_is_no_delay():
    """The simulator rounds the turns of the flow. Without the variance, `channel_lag` is named too."""
    trial = run_bank_trial(TrialTask("all", "single", 0.5, 9, seed=59, bank="other-forms"))
    assert trial.concealed == ("pressure_drop",)
    assert trial.named == ("pressure_drop",)
