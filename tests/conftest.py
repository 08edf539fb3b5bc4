"""Every test: the checkout's own `tests`, the same random examples each time, one cache of programs."""

import os
import shutil
import signal
import sys
import tempfile
from pathlib import Path

import pytest
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


def pytest_configure(config):
    """All workers, and all that they start, keep what they compile in one folder; never in the user's own."""
    if "PAMJAX_CACHE_DIR" not in os.environ:
        folder = os.environ["PAMJAX_CACHE_DIR"] = tempfile.mkdtemp(prefix="pamjax-tests-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


@pytest.fixture(scope="session", autouse=True)
def kept_programs():
    """What one test compiled, no other compiles."""
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()


@pytest.fixture(autouse=True, scope="module")
def room_for_programs():
    """Compiled programs go before there are too many: a process of more than 65,530 mappings dies."""
    yield
    mapped = Path("/proc/self/maps")
    if mapped.exists() and len(mapped.read_bytes().splitlines()) > 30_000:
        import jax

        jax.clear_caches()


@pytest.fixture
def interruptible():
    """Ctrl-C as in a terminal: what is started in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
