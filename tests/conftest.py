"""Settings of all tests: import path, fixed random examples, and one cache of compiled programs."""

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
    """Set one cache folder for all workers and their child processes, never that of the user."""
    if "PAMJAX_CACHE_DIR" not in os.environ:
        folder = os.environ["PAMJAX_CACHE_DIR"] = tempfile.mkdtemp(prefix="pamjax-tests-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


@pytest.fixture(scope="session", autouse=True)
def kept_programs():
    """Share compiled programs between tests."""
    from pamjax.compile.jax_cache import keep_compiled

    keep_compiled()


@pytest.fixture(autouse=True, scope="module")
def room_for_programs():
    """Clear compiled programs before the process exceeds the limit of 65,530 memory mappings."""
    yield
    mapped = Path("/proc/self/maps")
    if mapped.exists() and len(mapped.read_bytes().splitlines()) > 30_000:
        import jax

        jax.clear_caches()


@pytest.fixture
def interruptible():
    """Let Ctrl-C interrupt as in a terminal; background processes ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
