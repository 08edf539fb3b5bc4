"""Detection of readings that repeat the end of a sensor's range."""

import dataclasses

import numpy as np
import pytest

from pamjax.records.checks.clipped_sensors import find_clipped_sensors
from pamjax.records.recording import Recording

N = 600


@pytest.fixture
def recording():
    """Return six strokes at a noisy pressure, with the force of the muscle; readings as printed."""
    length = 0.2 - 0.02 * (1 - np.cos(np.linspace(0, 12 * np.pi, N)))
    noise = np.random.default_rng(0).standard_normal((3, N))
    return Recording(
        time=0.1 * np.arange(N),
        pressure=np.round(3e5 + 500 * noise[0], -2),
        length=length,
        force=np.round(4000 * (length - 0.15) + noise[1], 1),
        diameter=np.round(0.03 - 0.1 * (length - 0.18) + 2e-5 * noise[2], 5),
        cycle=np.ones(N, dtype=int),
        row=np.arange(N) + 2,
    )


def _clip(recording, name, low=-np.inf, high=np.inf):
    return dataclasses.replace(recording, **{name: np.clip(getattr(recording, name), low, high)})


def test_working_sensors_are_not_reported(recording):
    assert find_clipped_sensors(recording, "recording.csv") == []


def test_clipped_force_is_reported_with_its_rows(recording):
    clipped = _clip(recording, "force", high=190.2)
    (warning,) = find_clipped_sensors(clipped, "recording.csv")
    count = int(np.sum(clipped.force == 190.2))
    assert warning.startswith(
        f"`force` is exactly its largest value, 190.2 N, in {count} rows of recording.csv; the longest"
        " sequence is rows "
    )
    assert warning.endswith("If the sensor was at the end of its range, clear these cells.")
    assert count > 60


@pytest.mark.parametrize("limits", [{"low": 0.0295}, {"high": 0.0305}])
def test_both_ends_of_a_diameter_are_reported(limits, recording):
    (warning,) = find_clipped_sensors(_clip(recording, "diameter", **limits), "recording.csv")
    assert ("largest" in warning) == ("high" in limits)


def test_clipped_diameter_of_few_rows_is_reported(recording):
    diameter = np.where(np.arange(N) % 4 == 0, recording.diameter, np.nan)
    clipped = _clip(dataclasses.replace(recording, diameter=diameter), "diameter", high=0.0308)
    assert len(find_clipped_sensors(clipped, "recording.csv")) == 1


def test_pressure_is_reported_only_if_it_has_noise(recording):
    ramp = 1e5 + 2e5 * (1 - np.cos(np.linspace(0, 12 * np.pi, N)))
    noisy = np.round(ramp + 2000 * np.random.default_rng(1).standard_normal(N), -2)
    clipped = _clip(dataclasses.replace(recording, pressure=noisy), "pressure", high=4.5e5)
    (warning,) = find_clipped_sensors(clipped, "recording.csv")
    assert warning.startswith("`pressure` is exactly its largest value, 450 kPa")
    # A regulator holds the same set value at the end of each ramp.
    held = _clip(dataclasses.replace(recording, pressure=ramp), "pressure", high=4.5e5)
    assert find_clipped_sensors(held, "recording.csv") == []


@pytest.mark.parametrize("levels", [5, 20, 100])
@pytest.mark.parametrize("rounded", [np.round, np.floor])
def test_coarse_and_smooth_readings_are_not_reported(levels, rounded, recording):
    for name in ("force", "length"):
        smooth = 4000 * (recording.length - 0.15) if name == "force" else recording.length
        step = np.ptp(smooth) / levels
        coarse = dataclasses.replace(recording, **{name: rounded(smooth / step) * step})
        assert find_clipped_sensors(coarse, "recording.csv") == []


def test_held_muscle_without_noise_is_not_reported(recording):
    ramp = np.clip(np.linspace(0, 4e5, N), 0, 3e5)
    held = dataclasses.replace(
        recording, pressure=ramp, length=np.full(N, 0.2), force=1e-3 * ramp, diameter=np.full(N, np.nan)
    )
    assert find_clipped_sensors(held, "recording.csv") == []


def test_slack_muscle_with_a_zero_error_is_not_reported(recording):
    slack = _clip(dataclasses.replace(recording, force=recording.force - 100), "force", low=0.3)
    assert find_clipped_sensors(slack, "recording.csv") == []


def test_set_force_of_an_isotonic_test_is_not_reported(recording):
    clipped = _clip(recording, "force", high=190.2)
    isotonic = dataclasses.replace(clipped, measures_length=True)
    assert find_clipped_sensors(isotonic, "recording.csv") == []
