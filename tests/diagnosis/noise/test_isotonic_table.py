"""Unstated noise of a measured length, in a table of free contractions without time."""

import numpy as np

from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.records.case import read_case

MUSCLE = """\
[muscle]
rest_length = "443 mm"
diameter = {value = "15 mm", sd = "3 mm"}
braid_angle = {value = "62 deg", sd = "5 deg"}

[test]
measured = "length"
load = "0 N"
"""


def test_misfit_of_the_baseline_is_no_noise(tmp_path):
    """A smooth contraction of 100 mm, with noise of 1 mm, at pressures that occur once each."""
    pressure = np.arange(0.0, 600.0, 25.0)
    noise = np.random.default_rng(0).normal(0.0, 1.0, pressure.size)
    length = 443 - 100 * (1 - np.exp(-((pressure / 250) ** 1.5))) + noise
    rows = "".join(f"{p},{x:.2f}\n" for p, x in zip(pressure, length, strict=True))
    (tmp_path / "recording.csv").write_text("pressure [kPa],length [mm]\n" + rows)
    (tmp_path / "muscle.toml").write_text(MUSCLE)
    problem = build_library_problem(read_case(tmp_path))
    estimated = estimate_noise(problem, problem.neutral, np.ones(problem.n, dtype=bool))
    channel = estimated.by_channel[0]
    # Curvature counts as noise, so the estimate is above 1 mm; the baseline misses the lengths by 50 mm.
    assert 0.5e-3 < np.median(channel.sd) < 6e-3
    assert np.sqrt(np.nanmean((problem.measured[0] - problem.predict(problem.neutral)[0]) ** 2)) > 30e-3
