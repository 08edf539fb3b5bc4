"""Options and rows of a case in its dataset."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pamjax.infer.fitting.joint_space import build_joint_space
from pamjax.infer.problem.dataset import build_dataset
from pamjax.infer.problem.informative_samples import (
    MAX_SLACK_FORCE_SHARE,
    find_informative_samples,
    find_slack_samples,
    has_median_below,
)
from pamjax.infer.problem.priors import collect_mechanism_values, list_free_parameters
from pamjax.model.assembly import list_mechanism_parameters
from pamjax.model.parameters import find_meaning
from pamjax.model.registry import MECHANISMS
from pamjax.records.blocks import find_blocks
from pamjax.records.reading.quantity import MeasuredValue
from pamjax.records.recording import Recording
from tests.infer.made import made


def history_of(case):
    at, (rename,) = build_joint_space([case], "elastic", ())
    return build_dataset(case, "elastic", at, rename).history


def test_memory_continues_or_restarts_as_stated_for_each_recording():
    case = made("elastic")
    late = case.recording.time + 600.0 * (np.arange(case.recording.n) >= 100)
    case = replace(case, recording=replace(case.recording, time=late))
    carried, anew = history_of(case), history_of(replace(case, gaps="anew", before="settled"))
    assert np.flatnonzero(carried.restart).tolist() == [0]
    assert np.flatnonzero(anew.restart).tolist() == [0, 100]
    assert not carried.settled
    assert anew.settled


def test_refinements_of_a_mechanism_are_not_fitted_unless_a_diagnosis_asks():
    case, ids = made("elastic"), [kind.id for kind in MECHANISMS]
    free = {parameter.name for parameter in list_free_parameters(case, "elastic", ids)}
    assert {"force_drift.rate", "braid_locking.width"} <= free
    # The height of the cones is a refinement: beside the net it would be a second, similar amplitude.
    assert {name for name in free if name.startswith("end_taper.")} == {"end_taper.share", "end_taper.radius"}
    stated = collect_mechanism_values(case.muscle_toml, ids)
    for name, (kind, field) in list_mechanism_parameters(ids).items():
        if find_meaning(name).is_refinement:
            assert name not in free
            assert stated[name] == MeasuredValue(float(getattr(kind(), field)))


def test_noise_does_not_bias_the_detection_of_slack_rows():
    """Linear ramps to 300 N at five lengths: rows near the threshold have no bias of their noise."""
    rng = np.random.default_rng(4)
    up = np.tile(np.linspace(-0.05, 1.0, 400), 5)
    noise = rng.normal(0.0, 4.0, up.size)
    recording = Recording.from_arrays(
        pressure=6e5 * np.tile(np.linspace(0.0, 1.0, 400), 5),
        length=np.repeat(0.2357 - 0.009 * np.arange(5), 400),
        force=300.0 * up + noise,
        diameter=np.full(up.size, np.nan),
        time=0.1 * np.arange(up.size),
    )
    case = replace(made(), recording=recording)
    assert find_blocks(recording).kind == "lengths"
    beside = np.abs(300.0 * up - MAX_SLACK_FORCE_SHARE * 300.0) < 8.0
    kept = find_informative_samples(case, "force") & beside
    by_itself = (recording.force >= MAX_SLACK_FORCE_SHARE * np.max(recording.force)) & beside
    off, naive = (np.mean(noise[rows]) / (4.0 / np.sqrt(rows.sum())) for rows in (kept, by_itself))
    assert naive > 3.0
    assert abs(off) < 2.0


def test_sample_far_below_its_neighbours_is_slack():
    """A hose becomes taut suddenly: the sample before is among samples with a force."""
    force = np.tile(np.r_[np.zeros(30), np.full(70, 600.0)], 5)
    recording = Recording.from_arrays(
        pressure=6e5 * np.tile(np.linspace(0.0, 1.0, 100), 5),
        length=np.repeat(0.2357 - 0.009 * np.arange(5), 100),
        force=np.where(np.arange(500) % 100 == 32, 0.0, force),
        diameter=np.full(500, np.nan),
        time=0.1 * np.arange(500),
    )
    case = replace(made(), recording=recording)
    assert case.muscle_toml.sensors.force
    assert find_slack_samples(case)[32::100].all()
    unstated = replace(case.muscle_toml, sensors=replace(case.muscle_toml.sensors, force=None))
    assert not find_slack_samples(replace(case, muscle_toml=unstated))[32::100].any()


def test_diameter_without_pressure_is_ignored():
    """Ramps at fixed lengths start at a pressure within the sensor noise of 1 kPa."""
    up = np.tile(np.linspace(0.0, 1.0, 101), 5)
    recording = Recording.from_arrays(
        pressure=6e5 * up,
        length=np.repeat(0.2357 - 0.009 * np.arange(5), 101),
        force=300.0 * up,
        diameter=np.full(up.size, 0.02),
        time=0.1 * np.arange(up.size),
    )
    muscle_toml = made().muscle_toml
    noisy = replace(muscle_toml, sensors=replace(muscle_toml.sensors, pressure=1e3))
    case = replace(made(), recording=recording, muscle_toml=noisy)
    assert find_blocks(recording).kind == "lengths"
    assert np.array_equal(
        find_informative_samples(case, "diameter"), (recording.pressure > 3e3) & ~find_slack_samples(case)
    )
    assert 0 < (find_slack_samples(case) & (recording.pressure > 3e3)).sum() < 0.1 * recording.n
    strokes = replace(recording, pressure=recording.length, length=recording.pressure)
    assert find_informative_samples(replace(case, recording=strokes), "diameter").all()


def test_offset_of_the_load_cell_is_estimated_from_slack_rows():
    # With a long thread, the force is zero above a contraction of a sixth.
    case = made(true={"muscle.thread_length": 0.34}, thread_length=MeasuredValue(0.3405, 0.8e-3))
    force = np.where(np.isnan(case.recording.force), 0.0, case.recording.force) - 20.0
    case = replace(case, recording=replace(case.recording, force=force))
    at, (rename,) = build_joint_space([case], "elastic", (), ("force_offset",))
    dataset = build_dataset(case, "elastic", at, rename, ("force_offset",))
    values = np.array(at.mean)
    values[at.names.index("force_offset.offset")] = -20.0
    shown = np.asarray(dataset.predict(values).force)
    pushes = np.asarray(
        replace(dataset, rows=replace(dataset.rows, is_slack=dataset.rows.is_slack & False))
        .predict(values)
        .force
    )
    loose = np.asarray(dataset.rows.is_slack) & (pushes < -30.0)
    assert loose.sum() > 20
    # The load cell reads its offset without load: neither a negative force nor zero.
    np.testing.assert_allclose(shown[loose], -20.0)


@pytest.mark.parametrize("width", [1, 2, 4, 7, 15])
def test_median_of_neighbours_is_that_of_pandas(width):
    random = np.random.default_rng(width)
    force = np.where(random.uniform(size=400) < 0.2, np.nan, random.normal(size=400).round(1))
    force[150:250] += 2.0
    medians = pd.Series(force).rolling(width, center=True, min_periods=1).median().to_numpy()
    for threshold in (-0.3, 0.05, 1.0):
        is_below = has_median_below(force, threshold, width)
        np.testing.assert_array_equal(is_below, medians < threshold)
        assert 0 < is_below.sum() < force.size
