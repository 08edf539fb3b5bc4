"""Candidates that a recording can test."""

import pytest

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.records.case import read_case

MUSCLE = """\
[muscle]
rest_length = "200 mm"
diameter = {value = "20 mm", sd = "1 mm"}
braid_angle = {value = "65 deg", sd = "1 deg"}

[test]
measured = "length"

[sensors]
length = "1 mm"

[baseline]
model = "inelastic"
"""


@pytest.mark.parametrize(("forces", "has_drift"), [((10, 10, 10, 10), False), ((10, 12, 9, 11), True)])
def test_only_a_load_cell_can_drift(tmp_path, forces, has_drift):
    """A constant set force of an isotonic test is a weight."""
    rows = "".join(f"{k},{100 * k},{200 - 5 * k},{force}\n" for k, force in enumerate(forces))
    (tmp_path / "recording.csv").write_text("time [s],pressure [kPa],length [mm],force [N]\n" + rows)
    (tmp_path / "muscle.toml").write_text(MUSCLE)
    ids = {c.id for c in build_candidates(build_library_problem(read_case(tmp_path)))}
    assert ("force_drift" in ids) == has_drift
    assert "force_offset" in ids
