"""Diagnosis of several recordings in one call."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.batch import diagnose_all
from pamjax.errors import BadInput
from tests.diagnosis.bank import (
    BankRecording,
    build_plan_problem,
    check_identified,
    replace_recording,
    simulate_bank,
)


def build_case(name):
    """Return a case without readings, which a diagnosis refuses."""
    case = build_plan_problem().case
    blank = np.full(case.recording.n, np.nan)
    return replace_recording(replace(case, name=name), force=blank, diameter=blank)


@pytest.mark.parametrize("workers", [1, 2])
def test_each_case_has_its_own_error(workers):
    names = ["first", "second", "third"]
    results = list(diagnose_all([build_case(name) for name in names], workers=workers))
    assert sorted(case.name for case, _ in results) == names
    assert all(isinstance(error, BadInput) for _, error in results)


def test_no_case_gives_no_result():
    assert list(diagnose_all([])) == []


@pytest.mark.slow
def test_an_invalid_case_does_not_stop_the_others():
    gain = simulate_bank(BankRecording(1, only="force_gain")).case
    results = {case.name: result for case, result in diagnose_all([build_case("blank"), gain], workers=2)}
    assert isinstance(results.pop("blank"), BadInput)
    (diagnosis,) = results.values()
    check_identified(diagnosis, ["force_gain"])


def test_interruption_does_not_wait_for_other_recordings(monkeypatch):
    """A diagnosis that waits for an event stands for a slow diagnosis."""
    let_go, slow_done = threading.Event(), threading.Event()

    def diagnose(case, **_):
        if case.name == "slow":
            let_go.wait(30)
            slow_done.set()
        return case.name

    monkeypatch.setattr("pamjax.diagnosis.batch.diagnose", diagnose)
    results = diagnose_all([build_case("slow"), build_case("quick")], workers=2)
    assert next(results)[1] == "quick"
    results.close()
    waited = slow_done.is_set()
    let_go.set()
    assert not waited
