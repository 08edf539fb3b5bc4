"""Fits of simulated muscles whose mechanism differs from its equation."""

import json

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.io import build_fit_document, build_xarray_dataset
from tests.agreement import ROUNDING, agree
from tests.infer.deviating import MECHANISM, STRENGTH, build_case, fit_case
from tests.infer.made import TRUE


def compute_worst_deviation(fitted):
    """Return the largest error of the muscle's parameters, sd."""
    true = TRUE | STRENGTH
    return max(abs(e.value - true[n]) / e.sd for n, e in fitted.estimates.items() if n in true and e.sd)


@pytest.mark.slow
def test_interval_contains_the_truth_only_with_a_form_error():
    without, with_form = fit_case(0.3, False), fit_case(0.3, True)
    assert compute_worst_deviation(without) > 4.0
    assert compute_worst_deviation(with_form) < 2.0
    name = "contact_pressure.threshold"
    assert with_form.estimates[name].sd > without.estimates[name].sd


@pytest.mark.slow
def test_form_error_reduces_the_held_out_error():
    errors = [fit_case(0.3, form_error).cases[0].held_out_score.rmse["force"] for form_error in (False, True)]
    # The noise has a standard deviation of 2 N.
    assert errors[1] < 3.0 < 15.0 < errors[0]


@pytest.mark.slow
def test_size_of_the_form_error_is_estimated():
    (case_fit,) = fit_case(0.3, True).cases
    part = case_fit.form_errors[MECHANISM]
    assert part.share == pytest.approx(0.3)
    # The amplitude absorbs what is proportional to the effect.
    assert part.ratio == pytest.approx(0.28, abs=0.05)
    assert part.form_rms[0] == pytest.approx(part.ratio * part.effect_rms[0], rel=1e-6)
    deviation = case_fit.prediction["force"] - case_fit.case.recording.force
    assert np.sqrt(np.mean(deviation**2)) < 2.2
    assert 0.2 < np.mean(case_fit.prediction_sd["force"]) < 1.0


@pytest.mark.slow
def test_exact_equation_has_no_form_error():
    without, with_form = fit_case(0.0, False), fit_case(0.0, True)
    assert with_form.cases[0].form_errors[MECHANISM].share == 0.0
    for name, e in without.estimates.items():
        agree(with_form.estimates[name].value, e.value, 1e-5)
        agree(with_form.estimates[name].sd, e.sd, 1e-4)
    assert "form error of contact_pressure: none, textbook part 149 N" in str(with_form)


@pytest.mark.slow
def test_note_and_files_have_both_parts():
    fitted = fit_case(0.3, True)
    assert "form error of contact_pressure: 26% (rms 38" in str(fitted)
    (case_entry,) = json.loads(json.dumps(build_fit_document(fitted), allow_nan=False))["cases"].values()
    entry_of_form = case_entry["form_errors"][MECHANISM]
    assert entry_of_form["share"] == pytest.approx(0.3)
    assert set(entry_of_form["rms"]) == {"force"}
    rows = build_xarray_dataset(fitted.cases[0])
    part = fitted.cases[0].form_errors[MECHANISM]
    agree(rows["force_form_error"].values, part.form[0], ROUNDING)
    (without,) = build_fit_document(fit_case(0.3, False))["cases"].values()
    assert without["form_errors"] == {}


@pytest.mark.parametrize(
    ("mechanisms", "loss", "message"),
    [
        ([], "square", r'got no mechanism. Include one, for example `mechanisms=\["braid_friction"\]`'),
        (["force_offset"], "square", "equation may be inexact; got force_offset"),
        (["contact_pressure"], "soft", "a form error needs a likelihood; got a soft loss"),
    ],
)
def test_form_error_without_a_form_is_refused(mechanisms, loss, message):
    with pytest.raises(BadInput, match=message):
        fit(build_case(0.0), mechanisms=mechanisms, loss=loss, form_error=True)
