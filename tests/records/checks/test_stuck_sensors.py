"""Detection of a sensor that stays constant while the muscle moves."""

import dataclasses

import numpy as np
import pytest

from pamjax.records.checks.stuck_sensors import find_stuck_sensors
from pamjax.records.recording import Recording


@pytest.fixture
def recording():
    """Return four strokes at one pressure, with the force of the muscle."""
    n = 200
    length = 0.2 - 0.02 * (1 - np.cos(np.linspace(0, 8 * np.pi, n)))
    noise = np.random.default_rng(0).standard_normal((2, n))
    return Recording(
        time=0.1 * np.arange(n),
        pressure=3e5 + 100 * noise[0],
        length=length,
        force=4000 * (length - 0.15) + noise[1],
        diameter=np.full(n, np.nan),
        cycle=np.ones(n, dtype=int),
        row=np.arange(n) + 2,
    )


def _force(recording, change):
    force = recording.force.copy()
    change(force)
    return dataclasses.replace(recording, force=force)


def test_working_sensor_is_not_reported(recording):
    assert find_stuck_sensors(recording, "recording.csv") == []


def test_constant_force_is_reported(recording):
    def constant(force):
        force[:] = 120.0

    (warning,) = find_stuck_sensors(_force(recording, constant), "recording.csv")
    assert warning.startswith(
        "`force` is constant at 120 N in rows 2 to 201 of recording.csv, while the muscle moves."
    )


def test_saturated_load_cell_is_reported(recording):
    limit = np.nanmedian(recording.force)
    (warning,) = find_stuck_sensors(
        _force(recording, lambda force: np.minimum(force, limit, out=force)), "recording.csv"
    )
    assert warning.startswith("`force` is constant at ")
    assert "at its limit" in warning


def test_slack_and_resting_muscles_are_not_reported(recording):
    def slack(force):
        force[: recording.n // 2] = 0.0

    assert find_stuck_sensors(_force(recording, slack), "recording.csv") == []
    resting = dataclasses.replace(
        recording, pressure=np.full(recording.n, 1e5), length=np.full(recording.n, 0.2)
    )
    assert find_stuck_sensors(_force(resting, lambda force: force.fill(120.0)), "recording.csv") == []


def test_constant_diameter_is_reported_only_if_the_length_changes(recording):
    pressed = dataclasses.replace(
        recording, pressure=np.linspace(1e5, 5e5, recording.n), diameter=np.full(recording.n, 0.0202)
    )
    (warning,) = find_stuck_sensors(pressed, "recording.csv")
    assert warning.startswith("`diameter` is constant at 20.2 mm")
    assert (
        find_stuck_sensors(dataclasses.replace(pressed, length=np.full(recording.n, 0.2)), "recording.csv")
        == []
    )
