"""What a case says of its recording reaches the model."""

from dataclasses import replace

import numpy as np

from pamjax.infer.fit import joint_space
from pamjax.infer.member import member
from tests.infer.made import made


def history_of(case):
    at, (rename,) = joint_space([case], "elastic", ())
    return member(case, "elastic", at, rename).history


def test_memory_goes_on_or_begins_anew_as_is_stated_for_each_recording():
    case = made("elastic")
    late = case.recording.time + 600.0 * (np.arange(case.recording.n) >= 100)
    case = replace(case, recording=replace(case.recording, time=late))
    carried, anew = history_of(case), history_of(replace(case, gaps="anew", before="settled"))
    assert np.flatnonzero(carried.restart).tolist() == [0]
    assert np.flatnonzero(anew.restart).tolist() == [0, 100]
    assert not carried.settled
    assert anew.settled
