"""Diagnose small recordings: with injected mechanisms, with effects outside the library, with noise only.

A mechanism that acts alone has an effect of three noise standard deviations, the smallest of the simulation
study. The noise of neighbouring samples has a correlation of 0.5.
"""

from dataclasses import replace

import numpy as np
import pytest

from pamjax import DiagnosisSettings, diagnose
from pamjax.model.registry import MECHANISMS
from tests.diagnosis.bank import (
    UNMODELLED_FORCES,
    BankRecording,
    check_identified,
    check_no_misfit,
    check_unexplained,
    diagnose_bank,
    simulate_bank,
)

pytestmark = pytest.mark.slow

#: The most mechanisms that one recording may leave indistinguishable from an injected one.
MAX_TIES = 2

#: Recordings with several mechanisms by a name for the test.
SEVERAL = {
    "zero_and_stretch": BankRecording(2, seed=0, smallest=4.0, largest=25.0),
    "diameter_zero_and_lag": BankRecording(2, seed=1, smallest=4.0, largest=25.0),
    "taper_and_relaxation": BankRecording(2, seed=3, smallest=4.0, largest=25.0),
    "drift_and_locking": BankRecording(2, seed=4, smallest=4.0, largest=25.0),
    "gain_and_locking": BankRecording(2, seed=7, smallest=4.0, largest=25.0),
    "damping_and_contact_and_gain": BankRecording(3, seed=5, smallest=4.0, largest=25.0),
}


#: Template that each effect outside the library resembles.
LIKENESSES = {"obstacle": "stop", "zero_step": "zero_step", "ripple": "length_ripple", "bending": "buckling"}

#: Recordings with settings under which a stepwise diagnosis loses a mechanism.
TOO_STRICT = {
    "detection": (BankRecording(1, only="pressure_gain"), {"detection_p_value": 1e-30}),
    "inclusion": (BankRecording(1, only="force_drift"), {"false_inclusion_probability": 1e-300}),
    "number_of_mechanisms": (SEVERAL["gain_and_locking"], {"max_mechanisms": 1}),
}


@pytest.mark.parametrize("id", [kind.id for kind in MECHANISMS])
def test_an_injected_mechanism_is_named(id):
    diagnosis = diagnose_bank(BankRecording(1, only=id))
    check_identified(diagnosis, [id])
    (mechanism,) = diagnosis.named_mechanisms
    assert len(mechanism.indistinguishable) <= MAX_TIES


@pytest.mark.parametrize("name", SEVERAL)
def test_mechanisms_that_act_together_are_named(name):
    check_identified(diagnose_bank(SEVERAL[name]), simulate_bank(SEVERAL[name]).effect_ids)


@pytest.mark.parametrize("name", UNMODELLED_FORCES)
def test_an_effect_outside_the_library_is_unexplained(name):
    check_unexplained(diagnose_bank(BankRecording(seed=0, unmodelled=name)))


@pytest.mark.parametrize("name", LIKENESSES)
def test_an_effect_outside_the_library_is_described(name):
    likeness, *_ = diagnose_bank(BankRecording(seed=0, unmodelled=name)).likenesses
    assert likeness.id == LIKENESSES[name]
    assert likeness.probability > 0.5


def test_no_mechanism_imitates_bending():
    """The onset of bending in pressure is smooth in the template, and has a corner here."""
    assert diagnose_bank(BankRecording(seed=0, unmodelled="bending")).named_mechanisms == ()


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9, 0.97])
def test_noise_alone_is_no_misfit(correlation):
    check_no_misfit(diagnose_bank(BankRecording(seed=0, correlation=correlation)))


@pytest.mark.parametrize("ratio", [0.75, 2.0])
def test_a_noisier_or_quieter_sensor_is_no_misfit(ratio):
    case = simulate_bank(BankRecording(seed=0, correlation=0.0)).case
    sensors = replace(case.muscle_toml.sensors, force=case.muscle_toml.sensors.force / ratio)
    misstated = replace(case, muscle_toml=replace(case.muscle_toml, sensors=sensors))
    diagnosis = diagnose(misstated)
    check_no_misfit(diagnosis)
    # Noise of pressure is a part of the force noise, so that the ratio is closer to one.
    assert 1 < abs(np.log(ratio)) / abs(np.log(diagnosis.noise_ratios["force"])) < 4
    assert any("times the stated noise" in note for note in diagnosis.notes)


@pytest.mark.parametrize("rule", TOO_STRICT)
def test_a_rule_that_loses_a_mechanism_fails_the_check(rule):
    definition, changes = TOO_STRICT[rule]
    ground_truth = simulate_bank(definition)
    settings = DiagnosisSettings(**changes)
    diagnosis = diagnose(ground_truth.case, settings=settings)
    with pytest.raises(AssertionError):
        check_identified(diagnosis, ground_truth.effect_ids)


def test_the_check_rejects_a_diagnosis_that_loses_a_mechanism():
    definition = SEVERAL["gain_and_locking"]
    diagnosis, injected = diagnose_bank(definition), simulate_bank(definition).effect_ids
    for kept in diagnosis.named_mechanisms:
        lost = replace(diagnosis, selection=replace(diagnosis.selection, named_mechanisms=(kept,)))
        with pytest.raises(AssertionError):
            check_identified(lost, injected)


def test_the_check_rejects_a_certain_error_and_a_mechanism_of_low_probability():
    definition = BankRecording(1, only="force_offset")
    diagnosis = diagnose_bank(definition)
    with pytest.raises(AssertionError):
        check_identified(diagnosis, ["braid_friction"])
    (mechanism,) = diagnosis.named_mechanisms
    unlikely = replace(
        diagnosis,
        selection=replace(diagnosis.selection, named_mechanisms=(replace(mechanism, probability=0.4),)),
    )
    with pytest.raises(AssertionError):
        check_identified(unlikely, ["force_offset"])
