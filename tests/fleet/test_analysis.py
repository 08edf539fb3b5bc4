"""Answers about an invented fleet: spread, benches, drift, mechanisms, and what is unexplained."""

import json

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="needs the extra pamjax[fleet]")

from pamjax.fleet.analysis import analyse_fleet
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
    assert list_findings(answers) == ["No outlier, no difference between rigs and no drift."]


def test_identical_cases_count_once(tmp_path):
    values = draw(12)
    values[5] = values[4]
    alone = answer(tmp_path / "alone", values[:5] + values[6:], names=[f"c{k}" for k in range(11)])
    mechanisms = [["pressure_gain"] if k in (4, 5) else [] for k in range(12)]
    answers = answer(tmp_path / "copied", values, copies={5: 4}, mechanisms=mechanisms)
    assert answers.copies == (("case-04", "case-05"),)
    assert list_findings(answers)[-1] == (
        "case-04 and case-05 have identical inputs and count as one recording."
    )
    (counted,), (expected,) = answers.distributions, alone.distributions
    assert counted.pooled.mean == pytest.approx(expected.pooled.mean)
    assert counted.pooled.between_sd == pytest.approx(expected.pooled.between_sd)
    (frequency,) = answers.mechanisms
    assert (frequency.count, frequency.total) == (1, 11)


def test_fleet_without_a_comparison_says_so(tmp_path):
    assert list_findings(answer(tmp_path, draw(2))) == [
        "No specimens were compared: fewer than 3 of one type have an estimate of the same parameter."
    ]


def test_bench_with_a_wrong_gauge_is_named(tmp_path):
    values, benches = draw(24), ["north", "south"] * 12
    values[1::2] = [value + 8 for value in values[1::2]]
    mechanisms = [["pressure_gain"] if bench == "south" else [] for bench in benches]
    answers = answer(tmp_path, values, benches=benches, mechanisms=mechanisms)
    findings = list_findings(answers)
    assert findings[0].startswith(
        "pressure_gain is identified in 12 of 12 recordings of made on rig south,"
        " and in 0 of 12 of the others"
    )
    assert any("lower on rig north by" in line for line in findings)
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
        "thread.modulus is at its limit in 8 of 8 recordings of made on rig south, and in 0 of 8"
    )
    (distribution,) = answers.distributions
    assert distribution.estimates.cases == tuple((f"case-{k:02d}",) for k in range(0, 16, 2))


def test_outlier_and_drift_are_named(tmp_path):
    values = draw(24)
    values[5] += 40
    findings = list_findings(answer(tmp_path / "a", values))
    assert findings[0].startswith("case-05 is an outlier in thread.modulus of made:")
    drifting = [value + 0.8 * k for k, value in enumerate(draw(24))]
    (line,) = list_findings(answer(tmp_path / "b", drifting))
    assert "increases with date by" in line
    # 0.8 GPa a week.
    (distribution,) = answer(tmp_path / "b", drifting).distributions
    assert distribution.drift.value == pytest.approx(0.8 * 365.25 / 7, abs=4 * distribution.drift.sd)


def test_later_recordings_on_another_bench_are_no_drift(tmp_path):
    """Dates and benches are not separable here, and the difference is reported once."""
    values = [value + 12.0 * (k >= 12) for k, value in enumerate(draw(24))]
    answers = answer(tmp_path, values, benches=["north"] * 12 + ["south"] * 12)
    (line,) = list_findings(answers)
    assert "is lower on rig north by" in line


def test_drift_within_each_bench_is_named(tmp_path):
    values = [value + 0.8 * k for k, value in enumerate(draw(24))]
    (line,) = list_findings(answer(tmp_path, values, benches=["north", "south"] * 12))
    assert "increases with date by" in line


def test_prior_that_all_specimens_share_is_no_information(tmp_path):
    """Posteriors that equal the common prior are no distribution over specimens."""
    assert answer(tmp_path, [100.0] * 8, sd=20.0).distributions == ()


def test_common_prior_is_taken_out_of_each_estimate(tmp_path):
    (distribution,) = answer(tmp_path, draw(12), sd=10.0).distributions
    assert distribution.shares_prior
    assert distribution.pooled.sd == pytest.approx(np.full(12, (1 / 100 - 1 / 400) ** -0.5))


def test_prior_of_one_specimen_alone_stays(tmp_path):
    """One other prior does not leave the common one in the estimates of all others."""
    priors = [(100.0, 20.0)] * 11 + [(90.0, 25.0)]
    (distribution,) = answer(tmp_path, draw(12), sd=10.0, prior=priors).distributions
    expected = [(1 / 100 - 1 / 400) ** -0.5] * 11 + [10.0]
    assert distribution.shares_prior
    assert distribution.pooled.sd == pytest.approx(np.array(expected))


def test_each_of_two_shared_priors_is_taken_out(tmp_path):
    priors = [(100.0, 20.0), (90.0, 25.0)] * 6
    (distribution,) = answer(tmp_path, draw(12), sd=10.0, prior=priors).distributions
    expected = [(1 / 100 - 1 / 400) ** -0.5, (1 / 100 - 1 / 625) ** -0.5] * 6
    assert distribution.pooled.sd == pytest.approx(np.array(expected))


def test_own_prior_of_a_specimen_with_two_recordings_counts_once(tmp_path):
    priors = [(100.0 + k // 2, 20.0) for k in range(12)]
    serials = [f"A-{k // 2}" for k in range(12)]
    (distribution,) = answer(tmp_path, draw(12), sd=10.0, prior=priors, serials=serials).distributions
    assert not distribution.shares_prior
    assert distribution.pooled.sd == pytest.approx(np.full(6, (2 / 100 - 1 / 400) ** -0.5))


def test_recordings_of_one_serial_number_are_one_specimen(tmp_path):
    """Six recordings each of four specimens are no 24 specimens, of which two would prove a bench."""
    values = [90.0 + (4.0 if k // 6 < 2 else 0.0) + 0.1 * (k % 6) for k in range(24)]
    serials, benches = [f"A-{k // 6}" for k in range(24)], ["north"] * 12 + ["south"] * 12
    answers = answer(tmp_path / "a", values, serials=serials, benches=benches)
    (distribution,) = answers.distributions
    assert len(distribution.pooled.estimate) == 4
    assert distribution.estimates.cases[1] == tuple(f"case-{k:02d}" for k in range(6, 12))
    assert distribution.pooled.sd == pytest.approx(np.full(4, 0.5 / np.sqrt(6)), rel=1e-3)
    assert distribution.pooled.estimate == pytest.approx([94.25, 94.25, 90.25, 90.25], abs=0.02)
    assert list_findings(answers) == ["No outlier, no difference between rigs and no drift."]
    # Negative control: 24 serial numbers.
    (line,) = list_findings(answer(tmp_path / "b", values, benches=benches))
    assert "is higher on rig north by" in line


def test_equal_serial_numbers_of_two_types_are_two_specimens(tmp_path):
    serials, types = [f"A-{k // 2}" for k in range(8)], ["short", "long"] * 4
    counts = [len(d.pooled.sd) for d in answer(tmp_path, draw(8), serials=serials, types=types).distributions]
    assert counts == [4, 4]


def test_specimen_on_two_benches_counts_in_part_for_each(tmp_path):
    """Each specimen is on both benches, one of them once more often: the difference is that of the gauge."""
    values, serials, benches = [], [], []
    for k, level in enumerate(draw(12)):
        for bench in ("north", "south", ("north", "south")[k % 2]):
            values.append(level + (3.0 if bench == "south" else 0.0))
            serials.append(f"A-{k}")
            benches.append(bench)
    (distribution,) = answer(tmp_path, values, serials=serials, benches=benches).distributions
    assert distribution.estimates.benches == (None,) * 12
    assert distribution.estimates.names[3] == "A-3 (3 recordings)"
    slope = distribution.benches["south"]
    assert slope.value == pytest.approx(3.0, abs=3 * slope.sd)
    assert distribution.pooled.estimate[1] == pytest.approx(np.mean(values[3:6]), abs=0.02)


def test_outlier_with_two_recordings_is_named_once(tmp_path):
    values = [value + (40 if k == 5 else 0) for k, value in enumerate(draw(24)) for _ in range(2)]
    serials = [f"A-{k // 2}" for k in range(48)]
    (line,) = list_findings(answer(tmp_path, values, serials=serials))
    assert line.startswith("A-5 (2 recordings) is an outlier in thread.modulus of made:")


def test_drift_without_dates_is_per_serial_number(tmp_path):
    values = [value + 0.8 * k for k, value in enumerate(draw(24))]
    fleet = open_fleet(write_made_store(tmp_path, values))
    fleet.cases["date"] = None
    (line,) = list_findings(analyse_fleet(fleet))
    assert "increases with serial number by" in line
    assert "per serial number (p =" in line


def test_mechanisms_are_compared_within_a_type(tmp_path):
    """Bench north has all muscles of one type; the other type lacks the mechanism on every bench."""
    types, benches = ["long"] * 12 + ["short"] * 12, ["north"] * 12 + ["south"] * 12
    mechanisms = [["braid_friction"]] * 12 + [[]] * 12
    answers = answer(tmp_path, draw(24), benches=benches, mechanisms=mechanisms, types=types)
    (frequency,) = answers.mechanisms
    assert (frequency.type, frequency.count, frequency.total) == ("long", 12, 12)
    assert frequency.by_bench == {"north": (12, 12)}
    assert frequency.deviating_benches == ()
    assert answer(tmp_path / "b", draw(24), benches=benches, mechanisms=mechanisms).mechanisms[
        0
    ].deviating_benches == ("north",)


def test_limits_are_compared_within_a_type(tmp_path):
    types, benches = ["long"] * 12 + ["short"] * 12, ["north"] * 12 + ["south"] * 12
    answers = answer(tmp_path, draw(24), benches=benches, types=types, limits=range(12))
    (frequency,) = answers.limits
    assert (frequency.type, frequency.count, frequency.total, frequency.p_values) == ("long", 12, 12, {})


def test_numbers_of_a_diagnosis_are_not_pooled_with_those_of_fits(tmp_path):
    """A diagnosis does not state the priors of its numbers."""
    store = write_made_store(tmp_path, draw(6), mechanisms=[[]] * 6)
    number = {"thread.modulus": {"value": 200.0, "sd": 0.1, "unit": "GPa"}}
    for file in store.glob("cases/*/diagnose/diagnosis.json"):
        document = json.loads(file.read_text())
        document["baseline"]["parameters"] = number
        file.write_text(json.dumps(document))
    fleet = open_fleet(store)
    assert set(fleet.numbers["source"]) == {"fit", "diagnose"}
    (distribution,) = analyse_fleet(fleet).distributions
    assert distribution.pooled.estimate.max() < 110
    assert len(distribution.pooled.estimate) == 6


def test_outliers_are_corrected_for_the_number_of_distributions(tmp_path):
    """A deviation that is an outlier of one number is none among five numbers."""
    values = draw(24, seed=3)
    values[5] = 90.0 + 9.0
    store = write_made_store(tmp_path, values)
    (distribution,) = analyse_fleet(open_fleet(store)).distributions
    assert np.flatnonzero(distribution.pooled.outliers).tolist() == [5]
    for k, file in enumerate(sorted(store.glob("cases/*/fit/fit.json"))):
        document = json.loads(file.read_text())
        number = document["parameters"]["thread.modulus"]
        for name in "abcd":
            document["parameters"][name] = number | {"value": 90.0 + k % 5}
        file.write_text(json.dumps(document))
    *_, distribution = analyse_fleet(open_fleet(store)).distributions
    assert distribution.name == "thread.modulus"
    assert 0.01 < 24 * distribution.pooled.p_value[5] < 0.05
    assert not distribution.pooled.outliers.any()


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
