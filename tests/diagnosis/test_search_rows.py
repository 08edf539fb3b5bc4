"""Rows of a search: averages of neighbouring rows of a long recording."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax import DiagnosisSettings, diagnose
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import average_rows, build_library_problem
from pamjax.diagnosis.library.recording_scales import RecordingScales
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.model_fit import fit_model, switch_on_candidate
from pamjax.diagnosis.run import _fit_selected_mechanisms
from pamjax.diagnosis.search_rows import DiagnosedRows, choose_search_rows
from pamjax.diagnosis.select.rivals import NamedMechanism, RivalFit
from pamjax.diagnosis.select.selection import Selection
from pamjax.model.muscle import Muscle
from pamjax.model.thread import LinearThread
from pamjax.records.blocks import find_blocks
from pamjax.records.protocol import Protocol
from pamjax.records.recording import Recording
from pamjax.records.row_averages import RowAverages
from pamjax.records.simulate import simulate
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


def choose(recording, max_rows):
    return choose_search_rows(recording, find_blocks(recording).label, max_rows)


@pytest.mark.parametrize(("max_rows", "size"), [(999, 3), (334, 3), (333, 5), (200, 5)])
def test_the_groups_have_an_odd_number_of_rows(max_rows, size):
    averages = choose(build_recording(), max_rows)
    assert averages is not None
    # Groups at the ends of a part, and first rows, differ.
    counts = np.bincount(averages.group)
    assert np.median(counts) == size
    assert averages.averaged_recording.is_run_start.sum() == 2


def test_a_short_recording_and_a_table_are_not_reduced():
    assert choose(build_recording(), 1000) is None
    assert choose(build_recording(has_time=False), 100) is None


def test_a_row_without_pressure_does_not_prevent_averages():
    recording = build_recording()
    pressure = recording.pressure.copy()
    pressure[700] = np.nan
    assert choose(replace(recording, pressure=pressure), 500) is not None


def test_no_length_is_lost():
    # The second length has a few rows only: the averages do not show it as a level.
    length = np.where(np.arange(1000) < 980, 0.2, 0.19)
    averages = choose(build_recording(length=length), 50)
    assert averages is None or {0.2, 0.19} <= set(averages.averaged_recording.length.tolist())


@pytest.fixture(scope="module")
def problems():
    """Return the problem of a recording of 740 rows, and that of averages of three rows."""
    protocol = Protocol(
        kind="strokes",
        pressures=["200 kPa", "500 kPa"],
        contractions=[0.2, 0.27],
        cycles=1,
        speed="1.2 mm/s",
        rate="4 Hz",
    )
    case = simulate_bank(BankRecording()).case
    muscle = Muscle(0.2357, 0.2512, 1.09, LinearThread(4e5))
    recording = simulate(muscle, protocol.build_schedule(0.2357), case.muscle_toml.sensors, seed=5)
    case = replace(case, recording=recording)
    problem = build_library_problem(case)
    averages = RowAverages.from_recording(problem.case.recording, find_blocks(case.recording).label, 3)
    return problem, average_rows(problem, averages), averages


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes", [{}, {"braid_friction.coefficient": 0.1}, {"viscous_damping.coefficient": 2e3}]
)
def test_averages_are_predicted_as_accurately_as_the_samples(problems, changes):
    problem, averaged, averages = problems
    assert averaged.names == problem.names
    assert averaged.n < 0.5 * problem.n
    values = problem.neutral.copy()
    for name, value in changes.items():
        values[problem.index(name)] = value
    of_samples = np.stack([averages.average(channel) for channel in problem.predict(values)])
    sensors = averaged.case.muscle_toml.sensors
    error = (averaged.predict(values) - of_samples) / np.array([[sensors.force], [sensors.diameter]])
    assert np.sqrt(np.mean(error**2)) < 0.3


def test_starting_times_are_those_of_the_samples_unless_means_do_not_show_them(problems):
    problem, averaged, _ = problems
    steps = [RecordingScales.from_problem(p).time_step for p in (problem, averaged)]
    assert steps[1] == pytest.approx(steps[0])
    # Ten times the interval of the means, with the same samples.
    case = averaged.case
    slow_case = replace(case, recording=replace(case.recording, time=10 * case.recording.time))
    interval = 10 * np.median(np.diff(case.recording.time))
    assert interval > 5 * steps[0]
    slow = RecordingScales.from_problem(replace(averaged, case=slow_case))
    assert slow.time_step == pytest.approx(interval / 5)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_averages_have_the_information_and_the_noise_of_the_samples(problems, friction):
    """A large misfit, here a friction that the recording lacks, changes the noise of both in the same way."""
    problem, averaged, _ = problems
    values = problem.neutral.copy()
    values[problem.index("braid_friction.coefficient")] = friction
    noises = [estimate_noise(p, values, np.ones(p.n, dtype=bool)) for p in (problem, averaged)]
    assert noises[1].sample_count == pytest.approx(noises[0].size, rel=0.01)
    # The misfit in standard deviations of the noise has the same sum of squares.
    misfits = [
        np.sum(noise.whiten(p.measured - p.predict(values)) ** 2) - noise.size
        for noise, p in zip(noises, (problem, averaged), strict=True)
    ]
    assert misfits[1] == pytest.approx(misfits[0], rel=0.2)


@pytest.mark.slow
def test_a_search_in_averages_has_the_same_names_and_a_result_for_all_rows():
    definition = BankRecording(1, only="bladder_elasticity", smallest=12.0, largest=12.0)
    case, whole = simulate_bank(definition).case, diagnose_bank(definition)
    fewer = diagnose(case, settings=DiagnosisSettings(max_search_rows=case.recording.n // 2))
    assert [m.id for m in fewer.named_mechanisms] == [m.id for m in whole.named_mechanisms]
    assert fewer.problem.n == fewer.held_out_errors.held_out_mask.size == case.recording.n
    assert np.isfinite(fewer.held_out_errors.model_prediction[0]).all()
    # The final fit uses all rows.
    assert fewer.model.noise.size == np.isfinite(fewer.problem.measured).sum()


@pytest.mark.slow
def test_the_uncertainty_between_models_does_not_depend_on_the_rows_of_the_search():
    """With an offset of the pressure instead of the force, the braid has other dimensions."""
    ground_truth = simulate_bank(BankRecording(1, only="force_offset"))
    problem, blocks = build_library_problem(ground_truth.case), find_blocks(ground_truth.case.recording)
    averages = RowAverages.from_recording(problem.case.recording, blocks.label, 3)
    averaged, training_mask = average_rows(problem, averages), np.ones(problem.n, dtype=bool)
    assert averaged.n < 0.6 * problem.n
    (rival,) = (c for c in build_candidates(problem) if c.id == "pressure_offset")
    rival_values = switch_on_candidate(problem, problem.neutral, rival, np.array([100.0]))
    tie = NamedMechanism(
        "force_offset", 0.9, (rival.id,), 50.0, indistinguishable_fits=(RivalFit(0.5, rival, rival_values),)
    )
    values = np.array([ground_truth.true_values[name] for name in problem.names])
    between, total = [], []
    for search_problem, centres in ((problem, np.arange(problem.n)), (averaged, averages.centres)):
        length = search_problem.case.recording.length
        rows = DiagnosedRows(problem, blocks, training_mask, search_problem, length, centres)
        search_mask = np.ones(search_problem.n, dtype=bool)
        fit = fit_model(search_problem, search_mask, ground_truth.candidates, values)
        search_model, model = _fit_selected_mechanisms(rows, Selection(fit, fit, (tie,)))
        assert search_model.noise.size == np.isfinite(search_problem.measured).sum()
        assert model.noise.size == np.isfinite(problem.measured).sum()
        between.append(np.sqrt(np.diag(model.between_model_covariance)))
        total.append(np.sqrt(np.diag(model.covariance)))
    assert np.max(between[0] / total[0]) > 0.7
    assert between[1] == pytest.approx(between[0], rel=0.15)
    assert total[1] == pytest.approx(total[0], rel=0.15)
