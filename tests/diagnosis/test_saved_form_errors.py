"""A model.json with form errors predicts recordings as the diagnosis does."""

import json

import numpy as np
import pytest

from pamjax.diagnosis.case_prediction import predict_case
from pamjax.diagnosis.form_errors.fit import add_form_errors
from pamjax.diagnosis.form_errors.prediction import predict_with_uncertainty
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model, switch_on_candidate
from pamjax.diagnosis.saved_form_errors import build_saved_form_errors
from pamjax.diagnosis.saved_model import build_model_document
from pamjax.diagnosis.validate import validate
from pamjax.infer.fitting.load import load_muscle
from pamjax.infer.form_errors.form_model_file import FORM_MODEL_KEY
from tests.agreement import SOLVED, agree
from tests.infer.deviating import MECHANISM, build_case

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fits():
    """Return the problem, its fit with contact pressure, and the same fit with form errors."""
    problem = build_library_problem(build_case(0.3))
    candidate = next(c for c in build_candidates(problem) if c.id == MECHANISM)
    start = switch_on_candidate(problem, problem.neutral, candidate, np.full(len(candidate.amplitudes), 2e4))
    fit = fit_model(problem, np.ones(problem.n, dtype=bool), (candidate,), start)
    return problem, fit, add_form_errors(problem, fit)


@pytest.fixture(scope="module")
def saved(fits, tmp_path_factory):
    """Return the model.json of this fit."""
    problem, fit, form_error_fit = fits
    path = tmp_path_factory.mktemp("model") / "model.json"
    document = build_model_document(problem, fit, build_saved_form_errors(problem, form_error_fit))
    path.write_text(json.dumps(document, allow_nan=False))
    return path


def test_rows_of_the_diagnosis_have_its_prediction_and_its_sd(fits, saved):
    problem, _, form_error_fit = fits
    expected, recording = predict_with_uncertainty(problem, form_error_fit), problem.case.recording
    prediction = predict_case(load_muscle(saved), problem.case, recording.pressure, recording.length)
    agree(prediction.values[0], expected.values[0], SOLVED)
    assert np.abs(prediction.values[0] - prediction.textbook[0]).max() > 20.0
    agree(prediction.sd[0], expected.sd[0], 1e-5)


def test_another_recording_is_predicted_at_least_twice_as_well(saved):
    other, document = build_case(0.3, 1, "other"), json.loads(saved.read_text())
    del document["cases"]["made"][FORM_MODEL_KEY]
    textbook = saved.parent / "textbook.json"
    textbook.write_text(json.dumps(document))
    errors = [validate(file, other).rmse["force"] for file in (saved, textbook)]
    assert 2 * errors[0] < errors[1]
    # The noise has a standard deviation of 2 N.
    assert errors[0] < 2.5


def test_fit_without_form_errors_saves_none(fits):
    problem, fit, _ = fits
    assert build_saved_form_errors(problem, fit) is None
    assert FORM_MODEL_KEY not in build_model_document(problem, fit)["cases"]["made"]
