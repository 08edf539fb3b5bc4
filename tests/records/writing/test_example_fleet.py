"""The example of a fleet: valid cases, a wrong gauge on one rig, and nothing is overwritten."""

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.fleet.plan import read_plan
from pamjax.records.case import read_case
from pamjax.records.writing.example_fleet import GAUGE_ERRORS, SPECIMENS_PER_RIG, write_example_fleet

#: Stated length, thread length (m) and turns of the specimens.
LENGTH, THREAD, TURNS = 0.2, 0.214, 1.2


@pytest.fixture(scope="module")
def fleet_file(tmp_path_factory):
    """Return the FLEET.toml of the example."""
    return write_example_fleet(tmp_path_factory.mktemp("new") / "fleet")


def test_each_rig_has_its_recordings(fleet_file):
    plan = read_plan([fleet_file])
    benches = [case.specimen.bench for case in plan.cases]
    assert {bench: benches.count(bench) for bench in benches} == dict.fromkeys(
        GAUGE_ERRORS, SPECIMENS_PER_RIG
    )
    assert len({case.checksum for case in plan.cases}) == len(plan.cases)
    for case in plan.cases:
        assert read_case(case.folder).warnings == ()


def test_the_gauge_error_changes_the_force_as_in_the_closed_form(fleet_file):
    """At rest length, F = P (3 L² − B²) / (4π N²), nearly also with elastic threads at the same load."""

    def average_first_force(rig):
        folders = sorted((fleet_file.parent / rig).iterdir())
        return np.mean([read_case(folder).recording.force[0] for folder in folders])

    by_pressure = (3 * LENGTH**2 - THREAD**2) / (4 * np.pi * TURNS**2)
    expected = (GAUGE_ERRORS["north"] - GAUGE_ERRORS["south"]) * by_pressure
    # The two means differ by manufacture and noise by about 2 N.
    assert average_first_force("south") - average_first_force("north") == pytest.approx(expected, abs=6.0)
    assert abs(expected) > 40.0


def test_the_example_is_the_same_again(fleet_file, tmp_path):
    again = write_example_fleet(tmp_path / "again").parent
    for file in sorted(fleet_file.parent.rglob("*.csv")):
        assert (again / file.relative_to(fleet_file.parent)).read_bytes() == file.read_bytes()


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine.csv").write_text("mine")
    with pytest.raises(BadInput, match="a new fleet needs an empty folder"):
        write_example_fleet(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]
