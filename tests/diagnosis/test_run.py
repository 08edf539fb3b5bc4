"""Complete diagnoses: concealed effects are named, false alarms are avoided, and the files agree."""

import json
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.result import save_diagnosis
from pamjax.diagnosis.run import diagnose
from tests.diagnosis.bank import build_setup

#: Standard deviation of the force sensor, N.
FORCE_NOISE = build_reference_setup().muscle_toml.sensors.force


@cache
def diagnose_kind(kind):
    """Return the diagnosis of a simulated recording, which shares the compiled program of `bank.py`."""
    many = {"nothing": 0, "friction": 1}[kind]
    rng = np.random.default_rng({"nothing": 5, "friction": 0}[kind])
    only = "braid_friction" if many else None
    envelope = inject_effects(many, rng, setup=build_setup(), only=only, smallest=6.0, largest=6.0)
    return envelope, diagnose(envelope.case)


@pytest.mark.slow
def test_recording_without_an_effect_gives_no_name():
    _, diagnosis = diagnose_kind("nothing")
    assert not diagnosis.is_detected
    assert diagnosis.named_mechanisms == ()
    assert not diagnosis.unexplained
    assert diagnosis.as_dict()["unexplained"]["reason"] == ""


@pytest.mark.slow
def test_misfit_of_held_out_rows_alone_is_unexplained():
    """A block with a wrong zero of force, which no search has seen, is reported, and gives no name."""
    ground_truth, diagnosis = diagnose_kind("nothing")
    recording = ground_truth.case.recording
    held_out = diagnosis.held_out_errors.held_out_mask
    shifted = replace(recording, force=recording.force + 10 * FORCE_NOISE * held_out)
    diagnosis = diagnose(replace(ground_truth.case, recording=shifted))
    assert diagnosis.is_detected
    assert diagnosis.unexplained
    assert diagnosis.named_mechanisms == ()
    (region,) = diagnosis.misfit_regions
    assert region.channel == "force"
    # Its likeness is that of the misfit of all rows, not of the training rows.
    assert [likeness.id for likeness in diagnosis.likenesses] == ["single_block"]
    reason = diagnosis.as_dict()["unexplained"]["reason"]
    assert reason == "no mechanism explains the significant misfit of the baseline"


@pytest.mark.slow
def test_concealed_friction_is_named_and_its_loop_explained(tmp_path):
    envelope, diagnosis = diagnose_kind("friction")
    assert envelope.effect_sizes[0] == pytest.approx(6.0, rel=0.2)
    assert [name.id for name in diagnosis.named_mechanisms] == ["braid_friction"]
    assert diagnosis.named_mechanisms[0].probability > 0.9
    assert diagnosis.held_out_errors.baseline_rmse["force"] > 3 * FORCE_NOISE
    assert diagnosis.held_out_errors.model_rmse["force"] < 1.4 * FORCE_NOISE
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

    envelope, diagnosis = diagnose_kind("friction")
    save_diagnosis(diagnosis, tmp_path)
    document = json.loads((tmp_path / "model.json").read_text())
    name = envelope.case.name
    toml = '[muscle]\nrest_length = "235.7 mm"\nthread_length = "251.2 mm"\nturns = 1.09\n'
    document["cases"][name]["muscle_toml"] = toml
    (tmp_path / "model.json").write_text(json.dumps(document))
    # Its probability is stated, as in the result.
    estimate = diagnosis.parameters["braid_friction"]["coefficient"]
    saved_estimate = document["parameters"]["braid_friction.coefficient"]
    # The sd is that of this model alone. The result also has the differences from other models.
    k = diagnosis.model.estimate.free.index(diagnosis.problem.index("braid_friction.coefficient"))
    sd = np.sqrt(diagnosis.model.within_model_covariance[k, k])
    assert (saved_estimate["value"], saved_estimate["sd"]) == pytest.approx((estimate.value, sd))
    assert sd <= estimate.sd
    place = document["correlation"]["names"].index("braid_friction.coefficient")
    assert document["correlation"]["matrix"][place][place] == 1.0
    judged = validate(load_muscle(tmp_path / "model.json"), envelope.case)
    assert judged.rmse["force"] < 1.4 * FORCE_NOISE
    assert not judged.extrapolations


@pytest.mark.slow
def test_diagnosis_pickles_and_draws_all_figures():
    _, diagnosis = diagnose_kind("friction")
    copy = pickle.loads(pickle.dumps(diagnosis))
    assert str(copy) == str(diagnosis)
    assert copy.as_dict() == diagnosis.as_dict()
    assert [name for name in copy.list_figures() if copy.plot(name).axes] == diagnosis.list_figures()
