"""A small effect beside a large one, whose form error masks it."""

import pytest

from pamjax import diagnose
from pamjax.benchmark.bank_trial import draw_task_recording
from pamjax.benchmark.other_forms.case_files import build_bank_case
from pamjax.benchmark.trial import TrialTask
from pamjax.diagnosis.select import selection
from tests.diagnosis.bank import BankRecording, replace_recording, simulate_bank

pytestmark = pytest.mark.slow

#: A large loss of pressure at the bladder.
LARGE = BankRecording(1, seed=5, only="contact_pressure", smallest=30.0, largest=30.0)

#: Error of the load cell that a form error of the pressure loss can mask.
GAIN = 0.012


@pytest.fixture(scope="module")
def case():
    case = simulate_bank(LARGE).case
    return replace_recording(case, force=case.recording.force * (1 + GAIN))


def test_a_masked_gain_is_named(case):
    diagnosis = diagnose(case)
    first, second = diagnosis.named_mechanisms
    assert first.id == "contact_pressure"
    assert {"force_gain", "pressure_gain"} == {second.id, *second.indistinguishable}
    assert 0.5 < second.probability <= 0.75
    assert any(
        note.startswith("A form error of another mechanism") and second.id in note for note in diagnosis.notes
    )


def test_without_the_step_the_gain_becomes_a_form_error(case, monkeypatch):
    monkeypatch.setattr(selection, "add_masked_effects", lambda search, fit: fit)
    (mechanism,) = diagnose(case).named_mechanisms
    assert mechanism.id == "contact_pressure"
    assert mechanism.form_error > 0.05


def test_softening_of_another_form_gives_no_sensor_zero():
    """The difference between a mechanism with memory and its equation resembles a zero of the pressure."""
    task = TrialTask("all", "single", 0.9, 9, seed=97, bank="other-forms")
    recording = draw_task_recording(task)
    assert [effect.id for effect in recording.effects] == ["mullins_softening"]
    diagnosis = diagnose(build_bank_case(recording, "softening"))
    assert [mechanism.id for mechanism in diagnosis.named_mechanisms] == ["mullins_softening"]
    assert diagnosis.named_mechanisms[0].form_error > 0.05
