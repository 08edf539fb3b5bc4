"""Every test: the checkout's own `tests` package, double precision, the same random examples each time."""

import sys
from pathlib import Path

from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

# No deadline: the first example of a jitted function compiles it.
settings.register_profile(
    "pamjax",
    max_examples=50,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("pamjax")
