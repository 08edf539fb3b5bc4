"""Ratio of estimated to stated noise."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.noise.noise_ratios import (
    compute_noise_ratios,
    format_noise_notes,
    list_unstated_inputs,
)
from tests.diagnosis.bank import replace_readings, simulate_without_noise

#: Force noise, N, in a recording of 438 rows: its ratio is estimated to some 4 %.
FORCE_SD = 3.0


def build_problem(factor, with_swing=False):
    """Return readings whose force noise is the stated noise times a factor."""
    problem, rng = simulate_without_noise(), np.random.default_rng(3)
    force = problem.measured[0] + factor * FORCE_SD * rng.standard_normal(problem.n)
    if with_swing:
        # Ten standard deviations, and smooth from sample to sample.
        force = force + 10 * FORCE_SD * np.sin(2 * np.pi * np.arange(problem.n) / problem.n)
    muscle_toml = problem.case.muscle_toml
    sensors = replace(muscle_toml.sensors, force=FORCE_SD, pressure=0.0, length=0.0)
    case = replace(problem.case, muscle_toml=replace(muscle_toml, sensors=sensors))
    readings = np.stack([force, np.full(problem.n, np.nan)])
    return replace(replace_readings(problem, readings), case=case)


@pytest.mark.slow
@pytest.mark.parametrize("with_swing", [False, True])
@pytest.mark.parametrize("factor", [0.7, 1.0, 1.4])
def test_ratio_is_that_of_the_noise_in_spite_of_a_smooth_misfit(factor, with_swing):
    problem = build_problem(factor, with_swing)
    ratios = compute_noise_ratios(problem, problem.neutral)
    assert ratios["force"] == pytest.approx(factor, rel=0.1)


def test_note_names_the_channel_and_the_factor():
    assert format_noise_notes({"force": 1.1, "diameter": None}, 1.15) == []
    (note,) = format_noise_notes({"force": 1.4, "diameter": 0.95}, 1.15)
    assert "force is 1.40 times" in note
    assert "[sensors]" in note


def test_note_names_unstated_inputs_as_a_possible_cause():
    ratios = {"force": 1.4, "diameter": 0.5}
    more, less = format_noise_notes(ratios, 1.15, ["pressure", "length"])
    assert more.endswith("The noise of pressure and length adds to it, and is not stated there.")
    assert less.endswith("check `[sensors]`.")


def test_inputs_without_a_stated_noise_are_listed():
    case = build_problem(1.0).case
    assert list_unstated_inputs(case) == []
    sensors = replace(case.muscle_toml.sensors, length=None)
    muscle_toml = replace(case.muscle_toml, sensors=sensors)
    assert list_unstated_inputs(replace(case, muscle_toml=muscle_toml)) == ["length"]


def test_ratio_of_a_sensor_without_stated_noise_is_undefined():
    problem = build_problem(1.0)
    muscle_toml = problem.case.muscle_toml
    unstated = replace(muscle_toml, sensors=replace(muscle_toml.sensors, force=None))
    problem = replace(problem, case=replace(problem.case, muscle_toml=unstated))
    assert compute_noise_ratios(problem, problem.neutral) == {"force": None}
