"""What a diagnosis says of its numbers."""

import pytest

from pamjax.parameter import Meaning
from pamjax.study.diagnosis import Number, told


def _number(value, *, low=0.0, high=1.0, scale="linear", neutral=None):
    return Number(value, 0.01, Meaning("1", "", low, high, scale, "made up", "here", neutral))


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (_number(0.5), False),
        (_number(0.9999), True),
        (_number(1e-5), True),
        (_number(1e-5, neutral=0.0), False),  # nothing there is no limit
        (_number(1.0001e-6, low=1e-6, scale="log"), True),
        (_number(1e-3, low=1e-6, scale="log"), False),  # linearly it would be at the lower end
    ],
)
def test_a_number_driven_to_an_end_of_its_range_says_so(number, expected):
    assert number.at_limit is expected
    assert told("coefficient", number).endswith(", at a limit of what is possible") is expected
