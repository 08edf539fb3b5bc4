"""Complete diagnoses: concealed effects are named, false alarms are avoided, and the files agree."""

import json
import pickle
from functools import cache

import numpy as np
import pandas as pd
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.crossval.held_out_errors import select_held_out_rows
from pamjax.diagnosis.detect.locate import _compute_weighted_range, _find_direction
from pamjax.diagnosis.detect.residual_test import is_residual_large, is_residual_significant
from pamjax.diagnosis.detect.significance import Significance
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.result import save_diagnosis
from pamjax.diagnosis.run import diagnose
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.records.blocks import Blocks
from tests.diagnosis.bank import build_setup


def test_region_contains_the_middle_of_the_weight():
    values = np.linspace(0, 1, 1001)
    low, high = _compute_weighted_range(
        DEFAULT_SETTINGS, values, np.where((values > 0.2) & (values < 0.6), 1.0, 0.0)
    )
    assert (low, high) == (pytest.approx(0.22, abs=0.01), pytest.approx(0.58, abs=0.01))


@pytest.mark.parametrize(
    ("short", "long", "still", "word"),
    [(1, 1, 0, "both"), (1, 0.1, 0, "shortening"), (0.1, 1, 0, "lengthening"), (1, 0, 5, "both")],
)
def test_direction_counts_above_fifteen_percent(short, long, still, word):
    assert (
        _find_direction(DEFAULT_SETTINGS, np.array([-1, 1, 0]), np.array([short, long, still], float)) == word
    )


@pytest.mark.parametrize(("many", "out"), [(1, 0), (2, 0), (3, 1), (4, 1), (6, 1), (10, 2)])
def test_complete_blocks_inside_the_range_are_held_out(many, out):
    blocks = Blocks(np.repeat(np.arange(many), 7), tuple(f"b{k}" for k in range(many)), "isobars")
    rows = select_held_out_rows(blocks)
    labels = set(blocks.label[rows].tolist())
    assert len(labels) == out
    assert not labels & {0, many - 1}
    assert rows.sum() == 7 * out


@pytest.mark.slow
def test_padding_does_not_move_the_muscle_between_two_passes():
    """A program pads a recording with its last sample, and a settled muscle passes through the padding."""
    envelope = inject_effects(0, np.random.default_rng(5), setup=build_setup())
    problem, last = build_library_problem(envelope.case), envelope.case.recording.n - 1
    rows = problem.dataset.rows
    assert rows.pressure.size > last + 1
    for values in (rows.pressure, rows.length):
        assert np.all(values[last:] == values[last])


@pytest.mark.parametrize(("square", "left"), [(1.05, False), (1.5, True)])
def test_misfit_below_the_form_error_is_not_unexplained(square, left):
    faint = Significance(p_value=1e-9, largest_deviation=8.0, direction_count=100, mean_square=square)
    assert is_residual_significant(faint, faint, DEFAULT_SETTINGS) is left


@pytest.mark.parametrize("p_value", [0.1, 1e-9])
def test_large_misfit_within_noise_is_not_significant(p_value):
    mismatch = Significance(p_value=1e-300, largest_deviation=50.0, direction_count=100, mean_square=5.3)
    rest = Significance(p_value=p_value, largest_deviation=4.0, direction_count=100, mean_square=1.3)
    assert is_residual_large(mismatch, rest, DEFAULT_SETTINGS)
    assert is_residual_significant(mismatch, rest, DEFAULT_SETTINGS) is (p_value < 0.01)


@cache
def verdict(kind):
    """Return the diagnosis of a simulated recording, which shares the compiled program of `bank.py`."""
    many = {"nothing": 0, "friction": 1}[kind]
    rng = np.random.default_rng({"nothing": 5, "friction": 0}[kind])
    only = "braid_friction" if many else None
    envelope = inject_effects(many, rng, setup=build_setup(), only=only, smallest=6.0, largest=6.0)
    return envelope, diagnose(envelope.case)


@pytest.mark.slow
def test_recording_without_an_effect_gives_no_name():
    _, diagnosis = verdict("nothing")
    assert not diagnosis.is_detected
    assert diagnosis.named_mechanisms == ()
    assert not diagnosis.unexplained


@pytest.mark.slow
def test_concealed_friction_is_named_and_its_loop_explained(tmp_path):
    envelope, diagnosis = verdict("friction")
    assert envelope.effect_sizes[0] == pytest.approx(6.0, rel=0.2)
    assert [name.id for name in diagnosis.named_mechanisms] == ["braid_friction"]
    assert diagnosis.named_mechanisms[0].probability > 0.9
    noise = build_reference_setup().muscle_toml.sensors.force
    assert diagnosis.held_out_errors.baseline_rmse["force"] > 3 * noise
    assert diagnosis.held_out_errors.model_rmse["force"] < 1.4 * noise
    save_diagnosis(diagnosis, tmp_path)
    document = json.loads((tmp_path / "diagnosis.json").read_text())
    assert document["missing_physics"][0]["id"] == "braid_friction"
    rows = pd.read_csv(tmp_path / "prediction.csv")
    held = rows["held_out"] == 1
    misfit = envelope.case.recording.force[held] - rows["force_after [N]"][held]
    stated = document["improvement"]["held_out"]["force"]["rmse_after"]
    assert np.sqrt(np.mean(misfit**2)) == pytest.approx(stated, rel=1e-3)


@pytest.mark.slow
def test_saved_improved_model_gives_the_same_prediction(tmp_path):
    from pamjax.diagnosis.validate import validate
    from pamjax.infer.fitting.load import load_muscle

    envelope, diagnosis = verdict("friction")
    save_diagnosis(diagnosis, tmp_path)
    document = json.loads((tmp_path / "model.json").read_text())
    name = envelope.case.name
    toml = '[muscle]\nrest_length = "235.7 mm"\nthread_length = "251.2 mm"\nturns = 1.09\n'
    document["cases"][name]["muscle_toml"] = toml
    (tmp_path / "model.json").write_text(json.dumps(document))
    # Its probability is stated, as in the result.
    estimate = diagnosis.parameters["braid_friction"]["coefficient"]
    saved_estimate = document["parameters"]["braid_friction.coefficient"]
    assert (saved_estimate["value"], saved_estimate["sd"]) == pytest.approx((estimate.value, estimate.sd))
    place = document["correlation"]["names"].index("braid_friction.coefficient")
    assert document["correlation"]["matrix"][place][place] == 1.0
    judged = validate(load_muscle(tmp_path / "model.json"), envelope.case)
    assert judged.rmse["force"] < 1.3 * build_reference_setup().muscle_toml.sensors.force
    assert not judged.extrapolations


@pytest.mark.slow
def test_diagnosis_pickles_and_draws_all_figures():
    _, diagnosis = verdict("friction")
    copy = pickle.loads(pickle.dumps(diagnosis))
    assert str(copy) == str(diagnosis)
    assert copy.as_dict() == diagnosis.as_dict()
    assert [name for name in copy.list_figures() if copy.plot(name).axes] == diagnosis.list_figures()


def test_simulated_protocol_has_blocks_to_hold_out():
    from pamjax.records.blocks import find_blocks

    assert select_held_out_rows(find_blocks(build_reference_setup().plan)).any()
