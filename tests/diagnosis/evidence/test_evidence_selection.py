"""Choice by evidence on small simulated recordings."""

import json
from dataclasses import replace

import pytest

import pamjax
from pamjax.errors import BadInput
from tests.diagnosis.bank import (
    BankRecording,
    check_identified,
    check_no_mismatch,
    check_unexplained,
    diagnose_bank,
    simulate_bank,
)


def test_an_unknown_method_is_refused_with_the_nearest_name():
    with pytest.raises(BadInput, match="evidence"):
        pamjax.diagnose("no_folder", method="evidense")  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("id", ["thread_crimp", "end_taper", "thread_slip", "rig_compliance", "force_drift"])
def test_an_injected_mechanism_is_named_by_evidence(id):
    diagnosis = diagnose_bank(BankRecording(1, only=id), "evidence")
    check_identified(diagnosis, [id])
    assert json.loads(json.dumps(diagnosis.as_dict()))["missing_physics"][0]["id"] == id


@pytest.mark.slow
def test_an_effect_outside_the_library_is_unexplained_by_evidence():
    diagnosis = diagnose_bank(BankRecording(seed=0, unmodelled="ripple"), "evidence")
    check_unexplained(diagnosis)
    assert diagnosis.named_mechanisms == ()


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_noise_alone_is_no_mismatch_even_if_it_is_larger_than_stated(factor):
    case = simulate_bank(BankRecording(seed=0)).case
    sensors = case.entry.sensors
    understated = replace(
        sensors,
        force=sensors.force / factor,
        pressure=sensors.pressure / factor,
        length=sensors.length / factor,
    )
    diagnosis = pamjax.diagnose(
        replace(case, entry=replace(case.entry, sensors=understated)), method="evidence"
    )
    check_no_mismatch(diagnosis)
