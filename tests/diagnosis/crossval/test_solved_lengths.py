"""Predicted lengths of an isotonic test that solve the balance, and unchanged predictions of forces."""

import numpy as np
import pytest

from pamjax.diagnosis.crossval.solved_lengths import predict_solved
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.records.case import read_case
from tests.agreement import agree
from tests.diagnosis.bank import simulate_without_noise

LENGTHS = np.array([200.0, 190.0, 180.0, 175.0, 170.0, 165.0])  # mm, at 0, 100, ... 500 kPa
MUSCLE = """\
[muscle]
rest_length = "200 mm"
diameter = {value = "20 mm", sd = "1 mm"}
braid_angle = {value = "65 deg", sd = "1 deg"}

[test]
measured = "length"
load = "0 N"

[sensors]
length = "1 mm"

[baseline]
model = "inelastic"
"""


def build_problem(folder, lengths=LENGTHS):
    rows = "".join(f"{100 * k},{length}\n" for k, length in enumerate(lengths))
    (folder / "recording.csv").write_text("pressure [kPa],length [mm]\n" + rows)
    (folder / "muscle.toml").write_text(MUSCLE)
    return build_library_problem(read_case(folder))


@pytest.mark.slow
def test_bare_braid_without_load_contracts_fully(tmp_path):
    """Its length is B/√3 at every pressure: the volume is largest at an angle of 35.26°."""
    problem, inflated = build_problem(tmp_path), slice(1, None)
    full = 0.2 / np.sin(np.radians(65.0)) / np.sqrt(3)
    solved = predict_solved(problem, problem.neutral)[0, inflated]
    agree(solved, full, 1e-4)
    # One step from the measured lengths misses it by millimetres.
    assert np.abs(problem.predict(problem.neutral)[0, inflated] - full).max() > 2e-3


def test_solved_length_is_independent_of_the_measured_one(tmp_path):
    solved, single = [], []
    for lengths in (LENGTHS, LENGTHS - 4.0):
        problem = build_problem(tmp_path, lengths)
        solved.append(predict_solved(problem, problem.neutral)[:, 1:])
        single.append(problem.predict(problem.neutral)[:, 1:])
    agree(solved[1], solved[0], 1e-5)
    assert np.abs(single[1][0] - single[0][0]).max() > 5e-4


def test_measured_forces_are_predicted_as_in_a_fit():
    problem = simulate_without_noise()
    assert np.array_equal(predict_solved(problem, problem.neutral), problem.predict(problem.neutral))
