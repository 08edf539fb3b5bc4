"""A mechanism whose effect differs from its textbook equation."""

import numpy as np
import pytest

from pamjax import DiagnosisSettings, diagnose
from pamjax.diagnosis.form_errors.columns import compute_effect
from tests.diagnosis.bank import (
    BankRecording,
    diagnose_bank,
    list_certain_errors,
    replace_recording,
    simulate_bank,
)

pytestmark = pytest.mark.slow

#: Size of the difference, as a share of the effect at the ends of the stroke.
SHARE = 0.2


def define_rubber(size):
    """Return a recording with rubber of some noise standard deviations."""
    return BankRecording(1, only="bladder_elasticity", smallest=size, largest=size)


def change_form(definition):
    """Return the recording with a rubber that is stiffer at both ends of the stroke than its equation."""
    diagnosis, case = diagnose_bank(definition), simulate_bank(definition).case
    values, rubber = diagnosis.model.estimate.values, diagnosis.model.mechanisms[0]
    effect = compute_effect(diagnosis.problem, values, rubber)
    length = case.recording.length
    x = 2 * (length - length.min()) / np.ptp(length) - 1
    return replace_recording(case, force=case.recording.force + SHARE * (1.5 * x**2 - 0.5) * effect[0])


@pytest.mark.parametrize("size", [12.0, 20.0])
def test_a_form_error_adds_no_name(size):
    """The larger the effect, the more significant is its difference from the equation."""
    definition = define_rubber(size)
    diagnosis = diagnose(change_form(definition))
    (mechanism,) = diagnosis.named_mechanisms
    assert mechanism.id == "bladder_elasticity"
    assert not diagnosis.unexplained
    # The rms of the second Legendre polynomial is √(1/5), if the rows are uniform in length.
    assert mechanism.form_error == pytest.approx(SHARE / 5**0.5, rel=0.3)
    assert diagnose_bank(definition).named_mechanisms[0].form_error < 0.02


def test_a_large_form_error_adds_no_certain_name():
    """In a short recording, a pressure offset can take the place of a form error of 10 %."""
    diagnosis = diagnose(change_form(define_rubber(30.0)))
    assert list_certain_errors(diagnosis, ["bladder_elasticity"]) == []
    assert diagnosis.named_mechanisms[0].id == "bladder_elasticity"


def test_without_form_errors_a_wrong_name_is_added():
    exact = diagnose(change_form(define_rubber(20.0)), settings=DiagnosisSettings(max_form_share=0.0))
    ids = {mechanism.id for mechanism in exact.named_mechanisms}
    assert ids > {"bladder_elasticity"}
