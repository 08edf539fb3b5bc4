"""Texts of a diagnosis for its parameters."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pamjax.diagnosis.result import build_parameter_estimate, format_named_estimate
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.parameter import Meaning


def _told(value, *, low=0.0, high=1.0, scale="linear", neutral=None):
    """Return the text of a refitted parameter."""
    meaning = Meaning("1", "", 0.0, 1.0, scale, "made up", "here", neutral)
    found: Any = SimpleNamespace(
        settings=DEFAULT_SETTINGS,
        low=np.array([low]),
        high=np.array([high]),
        is_logarithmic=np.array([scale == "log"]),
        meanings=(meaning,),
    )
    model: Any = SimpleNamespace(
        estimate=SimpleNamespace(free=(0,), values=np.array([value])), sd=lambda k: 0.01
    )
    return format_named_estimate("coefficient", build_parameter_estimate(found, model, 0))


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (_told(0.5), False),
        (_told(0.9999), True),
        (_told(1e-5), True),
        (_told(1e-5, neutral=0.0), False),  # nothing there is no limit
        (_told(0.9999, neutral=0.0), True),
        (_told(0.3999, high=0.4), True),  # of this recording, whatever is possible elsewhere
        (_told(1.0001e-6, low=1e-6, scale="log"), True),
        (_told(1e-3, low=1e-6, scale="log"), False),  # linearly it would be at the lower end
    ],
)
def test_parameter_at_its_limit_is_marked(said, expected):
    assert said.endswith(", at its limit") is expected
