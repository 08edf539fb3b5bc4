"""Advice on long recordings."""

import numpy as np
import pytest

from pamjax.records.long_recording import MANY_ROWS, advise_reduction
from pamjax.records.recording import Recording


def build_recording(n, time=None):
    return Recording(
        time=time,
        pressure=np.full(n, 1e5),
        length=np.full(n, 0.2),
        force=np.zeros(n),
        diameter=np.full(n, np.nan),
        cycle=np.ones(n, dtype=int),
        row=np.arange(n) + 2,
    )


def test_long_recording_gets_the_duration_of_medians():
    # Every third sample of 20 Hz: 6,580 rows become 2,193.
    first, second = advise_reduction(build_recording(6580, 0.05 * np.arange(6580)))
    assert first == "A diagnosis of 6,580 rows can take several minutes."
    assert '`median = "0.15 s"`' in second
    assert second.endswith("writes at most about 2,500 rows.")


@pytest.mark.parametrize(
    "recording",
    [build_recording(MANY_ROWS, np.arange(MANY_ROWS)), build_recording(MANY_ROWS + 1)],
    ids=["short", "without time"],
)
def test_no_advice(recording):
    assert advise_reduction(recording) == []
