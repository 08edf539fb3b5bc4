"""Benchmarks store their figures with command, machine and versions."""

import json
import os

import pytest

from tests.benchmarks.command import run_command
from tests.benchmarks.keep import arguments, keep


def test_stored_file_has_figures_command_machine_and_versions(tmp_path):
    file = tmp_path / "new" / "one.json"
    keep(file, {"prediction [ms]": 23.45678, "ratio": (1.0, 0.91234, 2), "recordings": 3})
    kept = json.loads(file.read_text("utf-8"))
    assert kept["figures"] == {"prediction [ms]": 23.46, "ratio": [1.0, 0.9123, 2], "recordings": 3}
    assert kept["command"].startswith("python")
    assert kept["machine"]["cores"] >= kept["machine"]["cores used"] >= 1
    assert {"python", "jax", "numpy", "pamjax"} <= set(kept["versions"])
    assert len(kept["date"].split("-")) == 3


def test_without_a_file_name_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keep(None, {"prediction [ms]": 1.0})
    assert not list(tmp_path.iterdir())


def test_json_option_is_removed_from_the_arguments(tmp_path):
    file = tmp_path / "bench.json"
    assert arguments(["5000", "--json", str(file)]) == (["5000"], file)
    assert arguments(["--json", str(file), "5000"]) == (["5000"], file)
    assert arguments(["5000"]) == (["5000"], None)
    with pytest.raises(SystemExit, match="needs the name of a file"):
        arguments(["--json"])


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs wait4 of POSIX")
def test_cost_of_a_command_is_measured_and_its_failure_stops_the_benchmark(tmp_path):
    ballast = bytearray(b"1" * 400_000_000)  # memory of the process that measures, not of the command
    cost = run_command(["--version"], str(tmp_path))
    assert 0 < cost.processor < 2 * cost.clock + 1
    # A process of Python needs more than 5 MB; the unit would be wrong by a factor of 1024.
    assert 5 < cost.memory < len(ballast) / 1e6
    assert set(cost.list_figures("x")) == {"x, clock [s]", "x, processor [s]", "x, peak memory [MB]"}
    with pytest.raises(SystemExit, match="pamjax check failed with exit code 2"):
        run_command(["check", tmp_path / "nothing"], str(tmp_path))
