"""Diagnosis of several recordings in one call."""

import threading
from types import SimpleNamespace

from pamjax.diagnosis.batch import diagnose_all


def test_interruption_does_not_wait_for_other_recordings(monkeypatch):
    let_go, slow_done = threading.Event(), threading.Event()

    def diagnose(case, **_):
        if case.name == "slow":
            let_go.wait(30)
            slow_done.set()
        return case.name

    monkeypatch.setattr("pamjax.diagnosis.batch.diagnose", diagnose)
    answers = diagnose_all([SimpleNamespace(name="slow"), SimpleNamespace(name="quick")], workers=2)
    assert next(answers)[1] == "quick"
    answers.close()
    waited = slow_done.is_set()
    let_go.set()
    assert not waited
