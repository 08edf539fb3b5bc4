"""Stability of the hoses' diagnoses: the treatments keep the readings, and the summary counts names."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.records.case import read_case
from tests.fits.scripts import FITS, import_scripts

SIMULATED = FITS / "portland_hose" / "simulated" / "hose-10mm-132"


@pytest.fixture(scope="module")
def scripts():
    """Yield the modules of the treatments, of the arithmetic and of the tables."""
    with import_scripts("portland_hose", "treatments", "name_stability", "stability") as modules:
        yield modules


@pytest.fixture(scope="module")
def case():
    return read_case(SIMULATED)


def list_readings(recording, columns=("pressure", "length", "force", "cycle")):
    """Return the sorted rows of a recording."""
    table = np.stack([getattr(recording, column) for column in columns], axis=1)
    return table[np.lexsort(table.T)]


def count_tests(recording):
    """Return the number of tests of each length."""
    return {
        float(length): len(set(recording.cycle[recording.length == length]))
        for length in np.unique(recording.length)
    }


def test_each_treatment_has_its_own_files(scripts):
    treatments = scripts[0]
    ids = [treatment.id for treatment in treatments.TREATMENTS]
    assert len(set(ids)) == len(ids) == 7
    assert treatments.REFERENCE.samples == 6
    assert treatments.REFERENCE.change is None


def test_medians_have_the_stated_number_of_samples(scripts, case):
    tests = [np.sum(case.recording.cycle == number) for number in np.unique(case.recording.cycle)]
    samples = {"medians-6": 6, "medians-20": 20, "medians-2": 2, "noise": 6, "zero": 6, "order": 6}
    for treatment in scripts[0].TREATMENTS:
        if treatment.id in samples:
            assert treatment.samples == samples[treatment.id]
            rows = treatment.apply(case).recording.n
            assert rows == sum(-(-n // samples[treatment.id]) for n in tests), treatment.id


def test_only_the_noise_of_force_is_removed(scripts, case):
    changed = scripts[0].remove_force_noise(case)
    assert changed.recording is case.recording
    sensors = case.muscle_toml.sensors
    assert sensors.force is not None
    assert changed.muscle_toml.sensors.force is None
    assert replace(changed.muscle_toml, sensors=sensors) == case.muscle_toml


def test_a_zero_error_is_subtracted(scripts, case):
    """A zero error of 7 N adds to the mean of the slack rows, and does not change the result."""
    treatments = scripts[0]
    recording = replace(case.recording, force=case.recording.force + 7.0)
    shifted = replace(case, recording=recording)
    zero = treatments.compute_force_zero(case)
    assert abs(zero) < 4 * case.muscle_toml.sensors.force
    assert treatments.compute_force_zero(shifted) == pytest.approx(zero + 7.0)
    results = [treatments.subtract_force_zero(each).recording for each in (case, shifted)]
    np.testing.assert_allclose(results[0].force, results[1].force, atol=1e-9)
    np.testing.assert_allclose(results[0].force, case.recording.force - zero)
    np.testing.assert_array_equal(results[0].pressure, case.recording.pressure)


def test_the_zero_uses_slack_rows_only(scripts, case):
    """Forces at rest length or at high pressure do not change it; a force of one slack row does."""
    treatments = scripts[0]
    recording = case.recording
    slack = (recording.length < 0.98 * 0.132) & (recording.pressure <= 0.1 * recording.pressure.max())
    loaded = replace(recording, force=np.where(slack, recording.force, 1e3))
    zero = treatments.compute_force_zero(case)
    assert treatments.compute_force_zero(replace(case, recording=loaded)) == pytest.approx(zero)
    first = np.arange(recording.n) == np.flatnonzero(slack)[0]
    changed = replace(recording, force=recording.force + np.where(first, 1.0, 0.0))
    expected = zero + 1 / slack.sum()
    assert treatments.compute_force_zero(replace(case, recording=changed)) == pytest.approx(expected)


def test_every_second_test_of_each_length_remains(scripts, case):
    remaining = scripts[0].keep_every_second_test(case).recording
    assert count_tests(case.recording) == dict.fromkeys(np.unique(case.recording.length).tolist(), 3)
    assert count_tests(remaining) == dict.fromkeys(np.unique(case.recording.length).tolist(), 2)
    kept = np.isin(case.recording.cycle, [1, 3, 4, 6, 7, 9, 10, 12])
    np.testing.assert_array_equal(remaining.time, case.recording.time[kept])
    np.testing.assert_array_equal(remaining.force, case.recording.force[kept])


def test_reverse_order_keeps_tests_and_readings(scripts, case):
    # Pauses of different durations.
    time = case.recording.time + 0.1 * case.recording.cycle**2
    case = replace(case, recording=replace(case.recording, time=time))
    recording = scripts[0].reverse_lengths(case).recording
    np.testing.assert_array_equal(list_readings(recording), list_readings(case.recording))
    starts = np.flatnonzero(np.r_[True, np.diff(recording.cycle) != 0])
    assert recording.cycle[starts].tolist() == [10, 11, 12, 7, 8, 9, 4, 5, 6, 1, 2, 3]
    assert (np.diff(recording.time) > 0).all()
    assert np.ptp(recording.time) == pytest.approx(np.ptp(case.recording.time))
    for number in (1, 5, 12):
        times = [each.time[each.cycle == number] for each in (recording, case.recording)]
        np.testing.assert_allclose(*(np.diff(time) for time in times), atol=1e-9)
    np.testing.assert_allclose(
        np.diff(recording.time)[starts[1:] - 1],
        np.diff(case.recording.time)[np.flatnonzero(np.diff(case.recording.cycle))],
    )


def test_a_wrong_length_is_recovered(case):
    """The force is made linear in length: 20 N/mm times a share that increases with pressure.

    A prediction for a length 0.5 mm too short has too low a force. Noise remains without it.
    """
    recording = case.recording
    slope = 2e4 * recording.pressure / 6e5
    lengths = np.unique(recording.length)
    force = 400.0 * recording.pressure / 6e5 + slope * (recording.length - 0.132)
    case = replace(case, recording=replace(recording, force=force))
    rows = recording.length == lengths[2]
    noise = np.where(np.arange(recording.n) % 2, 1.0, -1.0)
    with import_scripts("portland_hose", "held_out_length") as (script,):
        result = script.fit_length_error(case, force - 0.5e-3 * slope + noise, rows)
        exact = script.fit_length_error(case, force + noise, rows)
    assert result.length_error == pytest.approx(0.5e-3, rel=0.05)
    assert result.slope == pytest.approx(np.sqrt(np.mean(slope[rows] ** 2)), rel=0.05)
    assert result.remaining_rms == pytest.approx(1.0, abs=0.05)
    assert result.rms > 5
    assert abs(exact.length_error) < 0.02e-3
    assert exact.remaining_rms == pytest.approx(exact.rms, rel=0.01)


def make_result(module, *names, error=10.0, unexplained=False):
    """Return made-up numbers of a diagnosis with some names; a name is an id, or an id and its ties."""
    named = tuple(
        module.Name(name, 0.9) if isinstance(name, str) else module.Name(name[0], 0.9, name[1:])
        for name in names
    )
    return module.TreatedResult(named, unexplained, 0.1, "", 100, "1 of 4", error, 12.0, 50.0, 8.0, 1.0, 60.0)


def test_names_are_the_same_if_one_is_tied_with_the_other(scripts):
    stability = scripts[1]
    crimp, slip = stability.Name("crimp", 0.9, ("slip",)), stability.Name("slip", 0.8)
    assert stability.is_same(crimp, slip)
    assert stability.is_same(slip, crimp)
    assert stability.is_same(slip, stability.Name("slip", 0.6))
    assert not stability.is_same(stability.Name("crimp", 0.9), slip)
    # A common tie is not sufficient.
    assert not stability.is_same(stability.Name("a", 0.9, ("c",)), stability.Name("b", 0.9, ("c",)))


def test_best_rival_has_the_lowest_bic_of_all_names(scripts):
    stability, script = scripts[1:]
    names = (
        stability.Name("crimp", 0.9, rivals={"slip": 3.0, "offset": 40.0}),
        stability.Name("creep", 0.8, rivals={"drift": -20.4}),
        stability.Name("rubber", 0.7),
    )
    assert stability.find_best_rival(names) == ("drift", -20.4)
    assert stability.find_best_rival(names[::2]) == ("slip", 3.0)
    assert stability.find_best_rival(names[2:]) is None
    assert script.format_best_rival(names) == "`drift` -20"


def test_change_counts_names_that_stay_go_and_come(scripts):
    stability = scripts[1]
    reference = make_result(stability, "rubber", ("crimp", "slip"), "creep")
    change = stability.compare_results(
        reference, make_result(stability, "slip", "rubber", "drift", error=5.0)
    )
    assert change.kept == ("rubber", "crimp")
    assert change.identical == ("rubber",)
    assert change.lost == ("creep",)
    assert change.new == ("drift",)
    assert change.error_ratio == 0.5
    assert change.changes_names
    same = stability.compare_results(reference, make_result(stability, "creep", "slip", "rubber"))
    assert not same.changes_names
    assert same.kept == ("rubber", "crimp", "creep")


def test_summary_adds_changes(scripts):
    stability = scripts[1]
    reference = make_result(stability, "rubber", "creep")
    others = [
        make_result(stability, "rubber", "creep", error=5.0),
        make_result(stability, "rubber", "drift", "slip", error=40.0),
        make_result(stability, error=20.0),
    ]
    changes = [stability.compare_results(reference, other) for other in others]
    summary = stability.summarise_changes(changes)
    assert (summary.diagnoses, summary.same) == (3, 1)
    assert (summary.kept, summary.identical, summary.named, summary.new) == (3, 3, 6, 2)
    assert summary.ratios == pytest.approx((0.5, 4 ** (1 / 3), 4.0))


def test_results_that_exist_are_not_repeated(scripts, tmp_path, monkeypatch, capsys):
    """A missing diagnosis is made once; the tables have all of them."""
    treatments, stability, script = scripts
    made = []

    def pretend(folder, treatment, out):
        made.append(treatment.id)
        return write_result(script, out, make_result(stability, "rubber"))

    write_result(script, tmp_path / "hose-a" / "noise", make_result(stability, ("slip", "rubber"), "drift"))
    monkeypatch.setattr(script, "diagnose_treated", pretend)
    arguments = ["cases", "--only", "hose-a", "--out", str(tmp_path)]
    script.main([*arguments, "--treatments", "order,noise"])
    assert made == ["order"]
    script.main([*arguments, "--table"])
    assert made == ["order"]
    for _ in range(2):
        script.main(arguments)
    assert sorted(made) == sorted(
        treatment.id for treatment in treatments.TREATMENTS if treatment.id != "noise"
    )
    table = (tmp_path / "stability.md").read_text(encoding="utf-8")
    assert table in capsys.readouterr().out
    names = "`slip` 0.90 (= rubber), `drift` 0.90"
    assert (
        f"| a | noise of force not stated | 100 | {names} | – | no | 1e-01 | 1.00 | 10 | 12 | 8 | 60 |"
        in table
    )
    assert "| all | 5 of 6 | 6 of 6 (5) | 1 | 1.00, 1.00, 1.00 |" in table


def write_result(script, folder, result):
    """Write made-up numbers where the script writes those of a diagnosis."""
    folder.mkdir(parents=True)
    text = script.json.dumps(result.as_dict())
    (folder / script.RESULT_FILE).write_text(text, encoding="utf-8")
    return result
