"""The protocols of an isotonic rig need no load cell, and their lengths are those of the muscle."""

import numpy as np
import pytest

from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.next_experiment import experiment as experiment_module
from pamjax.diagnosis.next_experiment.experiment import evaluate_protocols, propose_experiments
from pamjax.diagnosis.next_experiment.isotonic_protocols import ISOTONIC_MENU
from pamjax.diagnosis.next_experiment.protocols import PROTOCOL_MENU
from pamjax.diagnosis.next_experiment.rig import MAX_PROTOCOL_ROWS, RigLimits
from pamjax.diagnosis.next_experiment.testbed import SimulatedTestbed
from pamjax.diagnosis.select.rivals import NamedMechanism
from pamjax.planning.compare_pair import compare_pair
from tests.infer.fitting.test_isotonic_fit import RUBBER, build_case, simulate_recording

RIG = RigLimits(
    rest_length=0.2,
    max_pressure=6e5,
    max_contraction=0.2,
    speed=1e-3,
    step=1.0,
    force_noise=0.0,
    diameter_noise=1e-4,
    pressure_noise=500.0,
    length_noise=1e-4,
    max_force=50.0,
    has_camera=False,
    duration=300.0,
    load=5.0,
    pressure_speed=1e4,
)


def test_menu_has_different_ids():
    ids = [protocol.id for protocol in ISOTONIC_MENU]
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize("protocol", ISOTONIC_MENU, ids=lambda p: p.id)
def test_protocol_needs_neither_load_cell_nor_set_length(protocol):
    sentence = protocol.describe(RIG)
    assert not any(word in sentence for word in ("load cell", "stroke", "one length", "fixed rest length"))
    assert not any(name.startswith("force_") for name in protocol.get_direct_readings(RIG))
    schedule = protocol.build_schedule(RIG, 100.0)
    if schedule is None:
        return
    assert schedule.load is not None
    assert set(np.unique(schedule.load)) <= {5.0, 50.0}
    assert np.isnan(schedule.length).all()
    assert schedule.time[0] == 100.0
    assert schedule.time.size <= MAX_PROTOCOL_ROWS
    assert 0 <= schedule.pressure.min() < schedule.pressure.max() <= RIG.max_pressure


def test_rig_with_a_load_cell_has_schedules_of_length():
    isometric_rig = RigLimits(**{**vars(RIG), "load": None})
    schedules = [p.build_schedule(isometric_rig) for p in PROTOCOL_MENU]
    assert all(s.load is None and np.isfinite(s.length).all() for s in schedules if s is not None)


@pytest.mark.slow
def test_isotonic_rig_measures_length_and_distinguishes_rubber_from_a_lost_pressure(monkeypatch):
    problem = build_library_problem(build_case(simulate_recording(RUBBER), length="0.1 mm"))
    comparison = compare_pair(problem, "bladder_elasticity", "contact_pressure")
    testbed = SimulatedTestbed.from_fit(problem, comparison.fits[0])
    rig = testbed.rig
    assert (rig.load, rig.length_noise, rig.force_noise) == (pytest.approx(15.0, abs=15.0), 1e-4, 0.0)
    loaded = next(p for p in ISOTONIC_MENU if p.id == "I9").build_schedule(rig, testbed.start_time)
    assert loaded is not None
    planned = testbed.simulate_at(loaded, comparison.fits[0].estimate.values)
    assert planned.case.recording.measures_length
    # At the highest pressure, a load makes the muscle longer than without one.
    free = next(p for p in ISOTONIC_MENU if p.id == "I3").build_schedule(rig, testbed.start_time)
    assert free is not None
    lengths = [
        testbed.simulate_at(schedule, comparison.fits[0].estimate.values).case.recording
        for schedule in (free, loaded)
    ]
    shortest = [recording.length[np.argmax(recording.pressure)] for recording in lengths]
    assert 0.6 < shortest[0] / 0.2 < shortest[1] / 0.2 < 1.0
    evaluated = []

    def evaluate_and_keep(*arguments):
        evaluated.extend(evaluate_protocols(*arguments))
        return evaluated

    monkeypatch.setattr(experiment_module, "evaluate_protocols", evaluate_and_keep)
    # A diagnosis proposes a protocol for mechanisms that this recording does not distinguish.
    rubber = NamedMechanism("bladder_elasticity", 0.9, ("contact_pressure",), 30.0)
    (experiment,) = propose_experiments(lambda: testbed, problem, comparison.fits[0], [rubber])
    powers = {each.id: each.power for each in evaluated}
    assert set(powers) == {protocol.id for protocol in ISOTONIC_MENU}
    assert max(powers["I2"], powers["I3"], powers["I9"]) > 0.9
    assert powers["X12"] == pytest.approx(0.05)
    assert experiment.separates == ("bladder_elasticity", "contact_pressure")
    assert experiment.id in powers
    assert experiment.power > 0.9
    assert not propose_experiments(lambda: testbed, problem, comparison.fits[0], [])
