"""Protocols of the menu stay within the limits of the rig, and have the number of rows of one program."""

import numpy as np
import pytest

from pamjax.diagnosis.next_experiment.protocols import PROTOCOL_MENU
from pamjax.diagnosis.next_experiment.rig import MAX_PROTOCOL_ROWS, RigLimits, sample_path
from pamjax.model.parameters import list_parameters
from tests.agreement import ROUNDING, agree

RIG = RigLimits(0.2357, 650e3, 0.28, 1.2e-3, 0.5, 3.0, 5e-5, 500.0, 2e-5, 4500.0, True, 2600.0)
MOVING = [p for p in PROTOCOL_MENU if p.build_corners]


def test_menu_is_complete():
    assert [p.id for p in PROTOCOL_MENU] == [f"X{k}" for k in range(1, 15)]


@pytest.mark.parametrize("protocol", MOVING, ids=lambda p: p.id)
def test_protocol_stays_within_the_limits_of_the_rig(protocol):
    schedule = protocol.build_schedule(RIG, 100.0)
    assert 50 < schedule.time.size <= MAX_PROTOCOL_ROWS
    assert schedule.time[0] == 100.0
    assert np.all(np.diff(schedule.time) > 0)
    assert 0 <= schedule.pressure.min() <= schedule.pressure.max() <= RIG.max_pressure * (1 + ROUNDING)
    assert np.all(1 - schedule.length / RIG.rest_length <= RIG.max_contraction * (1 + ROUNDING))
    assert np.all(schedule.length <= RIG.rest_length * (1 + ROUNDING))
    seconds = schedule.time[-1] - schedule.time[0]
    assert protocol.compute_minutes(RIG) == pytest.approx(protocol.operator_minutes + seconds / 60, abs=0.1)
    assert len(protocol.describe(RIG)) > 20


@pytest.mark.parametrize(
    "protocol", [p for p in PROTOCOL_MENU if p.get_direct_readings(RIG)], ids=lambda p: p.id
)
def test_direct_reading_is_a_parameter_of_the_model(protocol):
    known = set(list_parameters())
    assert set(protocol.get_direct_readings(RIG)) <= known
    assert all(sd != 0 for sd in protocol.get_direct_readings(RIG).values())


def test_path_is_linear_between_its_corners():
    path = sample_path([(0, 0.0, 0.2, 1), (10, 1e5, 0.2, 1), (5, 1e5, 0.19, 2)], 1.0, True)
    agree(path.pressure, 1e4 * np.minimum(path.time, 10), ROUNDING)
    agree(path.length, 0.2 - 0.002 * np.maximum(path.time - 10, 0), ROUNDING)
    assert list(path.cycle) == [1] * 11 + [2] * 5


def test_fast_protocol_is_ten_times_as_fast():
    (fast,) = (p for p in PROTOCOL_MENU if p.id == "X4")
    schedule = fast.build_schedule(RIG)
    assert schedule is not None
    speed = np.abs(np.diff(schedule.length)) / np.diff(schedule.time)
    assert speed.max() == pytest.approx(10 * RIG.speed, rel=0.01)
