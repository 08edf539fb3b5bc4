"""A mechanism whose effect differs from its textbook equation."""

import numpy as np
import pytest

from pamjax import DiagnosisSettings, diagnose
from pamjax.diagnosis.form_errors.columns import compute_effect_of
from tests.diagnosis.bank import BankRecording, diagnose_bank, replace_recording, simulate_bank

pytestmark = pytest.mark.slow

RUBBER = BankRecording(1, only="bladder_elasticity", smallest=12.0, largest=12.0)

#: Size of the difference, as a share of the effect at the ends of the stroke.
SIZE = 0.2


@pytest.fixture(scope="module")
def rubber_in_another_form():
    """Return a recording whose rubber is stiffer at both ends of the stroke than its equation."""
    diagnosis, case = diagnose_bank(RUBBER), simulate_bank(RUBBER).case
    effect = compute_effect_of(
        diagnosis.problem, diagnosis.model.estimate.values, diagnosis.model.mechanisms[0]
    )
    length = case.recording.length
    x = 2 * (length - length.min()) / np.ptp(length) - 1
    return replace_recording(case, force=case.recording.force + SIZE * (1.5 * x**2 - 0.5) * effect[0])


def test_a_form_error_adds_no_name(rubber_in_another_form):
    (mechanism,) = diagnose(rubber_in_another_form).named_mechanisms
    assert mechanism.id == "bladder_elasticity"
    # The rms of the second Legendre polynomial is √(1/5), if the rows are uniform in length.
    assert mechanism.form_error == pytest.approx(SIZE / 5**0.5, rel=0.3)
    assert diagnose_bank(RUBBER).named_mechanisms[0].form_error < 0.02


def test_without_form_errors_a_wrong_name_is_added(rubber_in_another_form):
    exact = diagnose(rubber_in_another_form, settings=DiagnosisSettings(max_form_share=0.0))
    ids = {mechanism.id for mechanism in exact.named_mechanisms}
    assert ids > {"bladder_elasticity"}
