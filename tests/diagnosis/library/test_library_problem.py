"""The problem of a recording and every mechanism: its padded rows."""

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.diagnosis.library.library_problem import build_library_problem
from tests.diagnosis.bank import build_setup


@pytest.mark.slow
def test_padding_does_not_move_the_muscle_between_two_passes():
    """A program pads a recording with its last sample, and a settled muscle passes through the padding."""
    envelope = inject_effects(0, np.random.default_rng(5), setup=build_setup())
    problem, last = build_library_problem(envelope.case), envelope.case.recording.n - 1
    rows = problem.dataset.rows
    assert rows.pressure.size > last + 1
    for values in (rows.pressure, rows.length):
        assert np.all(values[last:] == values[last])
