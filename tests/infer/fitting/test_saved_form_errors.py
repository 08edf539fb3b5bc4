"""A fit.json with form errors predicts other recordings with them."""

import json

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.diagnosis.case_prediction import predict_case
from pamjax.diagnosis.validate import validate
from pamjax.errors import BadInput
from pamjax.infer.fitting.io import save
from pamjax.infer.fitting.load import load_muscle
from pamjax.infer.form_errors.form_model_file import FORM_MODEL_KEY
from pamjax.records.case import read_case
from pamjax.records.writing.case_folder import write_case
from tests.agreement import SOLVED, agree
from tests.infer.deviating import MECHANISM, MUSCLE, build_case, fit_case

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Return the fit.json of a muscle whose effect differs by 30 % from its equation."""
    return save(fit_case(0.3, True), tmp_path_factory.mktemp("fit"))[0]


@pytest.fixture(scope="module")
def textbook(saved):
    """Return the same file without the form errors, as an earlier version wrote it."""
    document = json.loads(saved.read_text())
    del document["cases"]["made"][FORM_MODEL_KEY]
    path = saved.parent / "textbook.json"
    path.write_text(json.dumps(document))
    return path


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Return the folder of another recording of this muscle."""
    folder = tmp_path_factory.mktemp("cases") / "other"
    write_case(folder, build_case(0.3, 1, "other").recording, MUSCLE)
    return folder


def test_rows_of_the_fit_have_its_prediction_and_its_sd(saved):
    (case_fit,) = fit_case(0.3, True).cases
    recording = case_fit.case.recording
    prediction = predict_case(load_muscle(saved), case_fit.case, recording.pressure, recording.length)
    agree(prediction.values[0], case_fit.prediction["force"], SOLVED)
    assert np.abs(prediction.values[0] - prediction.textbook[0]).max() > 20.0
    agree(prediction.sd[0], case_fit.prediction_sd["force"], 1e-5)


def test_another_recording_is_predicted_to_its_noise(saved, textbook, other):
    with_form, without = validate(saved, other), validate(textbook, other)
    assert with_form.rmse["force"] < 2.2 < 20.0 < without.rmse["force"]
    assert all(map(with_form.fits_block, with_form.blocks))
    # The noise of the sensor is 2 N.
    assert 0.2 < with_form.model_sd["force"] < 1.0
    agree(with_form.noise["force"], np.hypot(2.0, with_form.model_sd["force"]), 0.01)
    assert "includes form errors of contact_pressure; the noise includes its sd, 0." in str(with_form)


def test_files_of_earlier_versions_have_no_form_errors(textbook, other):
    loaded = load_muscle(textbook)
    assert loaded.form_errors is None
    validation = validate(loaded, other)
    assert (validation.form_errors, validation.model_sd) == ((), {})
    assert validation.noise["force"] == pytest.approx(2.0)
    assert "form error" not in str(validation)


def test_incomplete_form_errors_are_refused(saved, tmp_path):
    document = json.loads(saved.read_text())
    del document["cases"]["made"][FORM_MODEL_KEY]["mechanisms"][MECHANISM]["terms"]
    (tmp_path / "fit.json").write_text(json.dumps(document))
    with pytest.raises(BadInput, match=r"a fit.json must be complete; got no 'terms' in fit\.json"):
        load_muscle(tmp_path / "fit.json")


def test_simulation_has_the_form_errors(saved, textbook, other, tmp_path, capsys):
    protocol = tmp_path / "plan.toml"
    protocol.write_text(
        '[protocol]\nkind = "strokes"\npressures = ["150 kPa", "280 kPa", "430 kPa", "600 kPa"]\n'
        'contractions = [0.17]\nspeed = "5 mm/s"\ncycles = 2\n'
    )
    truth = read_case(other).recording.force
    errors = []
    for file in (saved, textbook):
        out = tmp_path / file.stem
        assert main(["simulate", str(file), str(protocol), "--out", str(out), "--no-noise"]) == 0
        errors.append(np.sqrt(np.mean((read_case(out).recording.force - truth) ** 2)))
    assert errors[0] < 2.2 < 20.0 < errors[1]


def test_inverse_warns_that_form_errors_are_neglected(saved, textbook, capsys):
    warnings = []
    for file in (saved, textbook):
        assert main(["inverse", str(file), "--force", "800 N", "--length", "210 mm"]) == 0
        warnings.append(capsys.readouterr().err)
    assert (
        "pamjax: warning: the command follows the equation of contact_pressure and neglects the form error,"
        " the estimated difference from the equation; a stated ± includes this difference\n" in warnings[0]
    )
    assert "form error" not in warnings[1]
