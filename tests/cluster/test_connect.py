"""Connections: missing packages, memory sizes, and clusters that do not fit."""

import importlib.util
import os
import re
import subprocess
import sys

import pytest

from pamjax.cluster import connect
from pamjax.errors import BadInput


def test_missing_packages_are_named_with_the_command_that_installs_them(monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "distributed" else find_spec(name)
    )
    message = (
        "`pamjax fleet` needs 1 more package: distributed. Run `pip install -e '.[fleet]'` in the folder of"
        " the pamjax repository."
    )
    with pytest.raises(BadInput, match=re.escape(message)):
        connect.check_packages()


def test_memory_sizes():
    pytest.importorskip("dask", reason="needs the extra pamjax[fleet]")
    assert connect.parse_memory("1.5 GB") == 1_500_000_000
    for text in ("much", "4", "-1 GB", "", "0 GB"):
        with pytest.raises(BadInput, match="`--memory` must be a size with a unit"):
            connect.parse_memory(text)


def test_workers_of_another_version_are_refused(tmp_path):
    class FakeClient:
        def __init__(self, **changes):
            self.changes = changes

        def run(self, function, store):
            versions, sees_store = function(store)
            return {"tcp://w:1": (versions | self.changes, sees_store)}

    connect._check_workers(FakeClient(), tmp_path)
    with pytest.raises(BadInput, match="every worker must have the jax of this process"):
        connect._check_workers(FakeClient(jax="0.1"), tmp_path)
    with pytest.raises(BadInput, match=r"every worker must see the folder .*; got tcp://w:1, which does not"):
        connect._check_workers(FakeClient(), tmp_path / "away")


def test_scheduler_that_does_not_answer_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra pamjax[fleet]")
    monkeypatch.setattr(connect, "CONNECT_TIMEOUT", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense"):
        with (
            pytest.raises(BadInput, match="`--scheduler` must be the address of a Dask scheduler"),
            connect.connect_to_scheduler(address, tmp_path),
        ):
            pass


PRINT_PLATFORM = """
import os
from pamjax.cluster.connect import start_cluster
if __name__ == "__main__":
    with start_cluster(workers=1) as client:
        print(*client.run(os.getenv, "JAX_PLATFORMS").values())
"""


@pytest.mark.slow
@pytest.mark.parametrize(("chosen", "platform"), [(None, "cpu"), ("cuda", "cuda")])
def test_workers_use_the_cpu_unless_the_user_chose_a_platform(chosen, platform, tmp_path):
    pytest.importorskip("distributed", reason="needs the extra pamjax[fleet]")
    variables = {k: v for k, v in os.environ.items() if k not in ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")}
    variables |= {"JAX_PLATFORMS": chosen} if chosen else {}
    # In a process of its own: compilations of earlier tests can delay the start of a cluster.
    (tmp_path / "script.py").write_text(PRINT_PLATFORM)
    command = [sys.executable, str(tmp_path / "script.py")]
    process = subprocess.run(command, env=variables, capture_output=True, text=True, check=True)
    assert process.stdout.split() == [platform]
