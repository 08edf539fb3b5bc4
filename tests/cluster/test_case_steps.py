"""Files of the stages of a case."""

import dataclasses

import pytest

from pamjax.baselines.comparison import ComparisonSplit
from pamjax.cluster.case_steps import check_model, run_diagnose, run_validate
from pamjax.errors import BadInput
from pamjax.fleet.plan import ReferenceModel
from tests.view.made_up import diagnosis


@pytest.mark.parametrize("is_isotonic", [False, True])
def test_isotonic_test_has_a_diagnosis_without_comparison(tmp_path, monkeypatch, is_isotonic):
    result = diagnosis()
    case = result.problem.case
    recording = dataclasses.replace(case.recording, measures_length=is_isotonic)
    case = result.problem.case = dataclasses.replace(case, recording=recording)
    comparison = "pamjax.baselines.comparison"
    monkeypatch.setattr("pamjax.diagnosis.run.diagnose", lambda case, seed: result)
    monkeypatch.setattr("pamjax.diagnosis.result.save_diagnosis", lambda diagnosis, out: None)
    monkeypatch.setattr(f"{comparison}._predict_without_rows", lambda *_: (None, None))
    split = ComparisonSplit(
        "held out", "all", result.held_out_errors.held_out_mask, {"baseline": {"force": 1.0}}, {}
    )
    monkeypatch.setattr(f"{comparison}._evaluate_split", lambda *_: split)
    run_diagnose(case, tmp_path, {"seed": 0, "report": False})
    assert (tmp_path / "gain.json").exists() != is_isotonic


def test_changed_copy_of_the_model_ends_the_run(tmp_path):
    model = tmp_path / "model.json"
    model.write_text("{}")
    settings = {"model": model, "checksum": "0", "case": None}
    with pytest.raises(OSError, match="another program changed the copy of the model"):
        run_validate(diagnosis().problem.case, tmp_path, settings)
    assert not (tmp_path / "validation.json").exists()


def test_wrong_model_is_refused_before_the_first_case(tmp_path):
    model = tmp_path / "model.json"
    for content in (b"{}", b"no JSON", b"[]"):
        model.write_bytes(content)
        with pytest.raises(BadInput, match=r"model\.json"):
            check_model(ReferenceModel(model, None, content))
