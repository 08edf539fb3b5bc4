"""A sensor that stands still while the muscle is moved is told, by its rows."""

import dataclasses

import numpy as np
import pytest

from pamjax.records.checks.stuck_sensors import find_stuck_sensors
from pamjax.records.recording import Recording


@pytest.fixture
def recording():
    """Four strokes at one pressure, and a force that follows."""
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


def test_a_sensor_that_follows_is_not_told(recording):
    assert find_stuck_sensors(recording, "recording.csv") == []


def test_a_weight_written_down_is_told(recording):
    def constant(force):
        force[:] = 120.0

    (said,) = find_stuck_sensors(_force(recording, constant), "recording.csv")
    assert said.startswith("`force` reads 120 N in rows 2 to 201 of recording.csv")


def test_a_load_cell_at_the_end_of_its_range_is_told(recording):
    half = np.nanmedian(recording.force)
    (said,) = find_stuck_sensors(
        _force(recording, lambda force: np.minimum(force, half, out=force)), "recording.csv"
    )
    assert said.startswith("`force` reads ")
    assert "at its limit" in said


def test_slack_and_a_muscle_at_rest_are_no_fault(recording):
    def slack(force):
        force[: recording.n // 2] = 0.0

    assert find_stuck_sensors(_force(recording, slack), "recording.csv") == []
    still = dataclasses.replace(
        recording, pressure=np.full(recording.n, 1e5), length=np.full(recording.n, 0.2)
    )
    assert find_stuck_sensors(_force(still, lambda force: force.fill(120.0)), "recording.csv") == []


def test_a_diameter_that_only_pressure_would_move_is_no_fault(recording):
    pressed = dataclasses.replace(
        recording, pressure=np.linspace(1e5, 5e5, recording.n), diameter=np.full(recording.n, 0.0202)
    )
    (said,) = find_stuck_sensors(pressed, "recording.csv")
    assert said.startswith("`diameter` reads 20.2 mm")
    assert (
        find_stuck_sensors(dataclasses.replace(pressed, length=np.full(recording.n, 0.2)), "recording.csv")
        == []
    )
