"""Answers about an invented fleet: spread, benches, drift, mechanisms, and what is unexplained."""

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="needs the extra pamjax[fleet]")

from pamjax.fleet.answers import analyse_fleet
from pamjax.fleet.fleet import open_fleet
from pamjax.fleet.summary import list_findings
from tests.fleet.made_store import write_made_store


def draw(count, spread=2.0, seed=0):
    return (90.0 + spread * np.random.default_rng(seed).normal(size=count)).tolist()


def answer(folder, values, **entries):
    return analyse_fleet(open_fleet(write_made_store(folder, values, **entries)))


def test_quiet_fleet_has_no_finding(tmp_path):
    answers = answer(tmp_path, draw(24), benches=["north", "south"] * 12)
    (distribution,) = answers.distributions
    assert (distribution.type, distribution.name, distribution.unit) == ("made", "thread.modulus", "GPa")
    low, high = distribution.pooled.between_interval
    assert low < 2.0 < high
    assert list_findings(answers) == ["No bench, specimen or date stands out."]


def test_bench_with_a_wrong_gauge_is_named(tmp_path):
    values, benches = draw(24), ["north", "south"] * 12
    values[1::2] = [value + 8 for value in values[1::2]]
    mechanisms = [["pressure_gain"] if bench == "south" else [] for bench in benches]
    answers = answer(tmp_path, values, benches=benches, mechanisms=mechanisms)
    findings = list_findings(answers)
    assert findings[0].startswith(
        "pressure_gain is identified in 12 of 12 recordings of bench south, and in 0 of 12 of the others"
    )
    assert any("lower on bench north by" in line for line in findings)
    (frequency,) = answers.mechanisms
    assert frequency.by_bench == {"north": (0, 12), "south": (12, 12)}
    # Exact interval for 12 of 24 (Clopper and Pearson).
    assert frequency.interval == pytest.approx((0.2912, 0.7088), abs=1e-4)


def test_mechanism_on_all_benches_names_no_bench(tmp_path):
    mechanisms = [["braid_friction"], ["braid_friction"], []] * 6
    answers = answer(tmp_path, draw(18), benches=["north", "south"] * 9, mechanisms=mechanisms)
    (frequency,) = answers.mechanisms
    assert frequency.count == 12
    assert frequency.deviating_benches == ()


def test_number_at_its_limit_on_one_bench_is_named(tmp_path):
    """A specimen at a limit has no usable estimate, but a bench with only such specimens is a finding."""
    answers = answer(tmp_path, draw(16), benches=["north", "south"] * 8, limits=range(1, 16, 2))
    (line,) = list_findings(answers)
    assert line.startswith(
        "thread.modulus is at its limit in 8 of 8 recordings of bench south, and in 0 of 8"
    )
    (distribution,) = answers.distributions
    assert len(distribution.cases) == 8


def test_outlier_and_drift_are_named(tmp_path):
    values = draw(24)
    values[5] += 40
    findings = list_findings(answer(tmp_path / "a", values))
    assert findings[0].startswith("case-05 stands out in thread.modulus of made:")
    drifting = [value + 0.8 * k for k, value in enumerate(draw(24))]
    (line,) = list_findings(answer(tmp_path / "b", drifting))
    assert "increases with date by" in line
    # 0.8 GPa a week.
    (distribution,) = answer(tmp_path / "b", drifting).distributions
    assert distribution.drift.value == pytest.approx(0.8 * 365.25 / 7, abs=4 * distribution.drift.sd)


def test_prior_that_all_specimens_share_is_no_information(tmp_path):
    """Posteriors that equal the common prior are no distribution over specimens."""
    assert answer(tmp_path, [100.0] * 8, sd=20.0).distributions == ()


def test_common_prior_is_taken_out_of_each_estimate(tmp_path):
    (distribution,) = answer(tmp_path, draw(12), sd=10.0).distributions
    assert distribution.shares_prior
    assert distribution.pooled.sd == pytest.approx(np.full(12, (1 / 100 - 1 / 400) ** -0.5))


def test_common_unexplained_region_is_named(tmp_path):
    mechanisms = [["unexplained"] if k < 5 else [] for k in range(12)]
    answers = answer(tmp_path, draw(12), mechanisms=mechanisms)
    summary = answers.unexplained
    assert (summary.count, summary.total, summary.likenesses) == (5, 12, {"eccentric_mount": 5})
    assert summary.region.cases == 5
    assert summary.region.pressure == pytest.approx((100, 300), abs=5)
    assert any("5 of them have it in force (lengthening)" in line for line in list_findings(answers))


def test_empty_fleet_has_answers(tmp_path):
    answers = answer(tmp_path, [])
    assert (answers.distributions, answers.mechanisms, answers.unexplained.count) == ((), (), 0)
