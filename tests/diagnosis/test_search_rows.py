"""Rows of a search: every second, third, … row of each part of a long recording."""

import numpy as np
import pytest

from pamjax import DiagnosisSettings, diagnose
from pamjax.diagnosis.library.library_problem import build_library_problem, select_rows
from pamjax.diagnosis.search_rows import choose_search_rows
from pamjax.records.recording import Recording
from tests.agreement import ROUNDING, agree
from tests.diagnosis.bank import BankRecording, diagnose_bank, simulate_bank


def build_recording(n=1000, length=0.2, has_time=True):
    """Return two tests of n/2 rows with a pause of an hour between them."""
    time = np.arange(float(n)) + np.where(np.arange(n) < n // 2, 0.0, 3600.0)
    return Recording.from_arrays(
        pressure=1e5 * (1 + np.sin(0.01 * time)),
        length=np.broadcast_to(length, n),
        force=np.ones(n),
        time=time if has_time else None,
        cycle=1 + (np.arange(n) >= n // 2),
    )


@pytest.mark.parametrize(("max_rows", "step"), [(1000, 1), (999, 2), (500, 2), (400, 3)])
def test_every_few_rows_of_each_part_are_taken(max_rows, step):
    expected = np.r_[np.arange(0, 500, step), np.arange(500, 1000, step)]
    np.testing.assert_array_equal(choose_search_rows(build_recording(), max_rows), expected)


def test_a_table_is_not_reduced():
    assert choose_search_rows(build_recording(has_time=False), 100).size == 1000


def test_no_length_is_lost():
    # The second length has a few rows only: the rows of a search do not show it as a level.
    length = np.where(np.arange(1000) < 980, 0.2, 0.19)
    rows = choose_search_rows(build_recording(length=length), 50)
    assert {0.2, 0.19} <= set(length[rows].tolist())


@pytest.mark.slow
def test_fewer_rows_have_the_same_parameters_and_predictions():
    problem = build_library_problem(simulate_bank(BankRecording()).case)
    rows = np.arange(0, problem.n, 3)
    reduced = select_rows(problem, rows)
    assert (reduced.n, reduced.names) == (rows.size, problem.names)
    np.testing.assert_array_equal(reduced.measured, problem.measured[:, rows])
    # The baseline has no memory: its force in a row does not depend on other rows.
    agree(reduced.predict(problem.neutral), problem.predict(problem.neutral)[:, rows], ROUNDING, 1.0)


@pytest.mark.slow
def test_a_search_in_fewer_rows_has_the_same_names_and_a_result_for_all_rows():
    definition = BankRecording(1, only="bladder_elasticity", smallest=12.0, largest=12.0)
    case, whole = simulate_bank(definition).case, diagnose_bank(definition)
    fewer = diagnose(case, settings=DiagnosisSettings(max_search_rows=case.recording.n // 2))
    assert [m.id for m in fewer.named_mechanisms] == [m.id for m in whole.named_mechanisms]
    assert fewer.problem.n == fewer.held_out_errors.held_out_mask.size == case.recording.n
    assert np.isfinite(fewer.held_out_errors.model_prediction[0]).all()
    # The final fit uses all rows.
    assert fewer.model.noise.size == np.isfinite(fewer.problem.measured).sum()
