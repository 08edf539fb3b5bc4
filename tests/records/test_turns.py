"""Samples at which pressure or length changes its speed."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.records.recording import Recording
from pamjax.records.turns import find_turns


def make_stroke(length, time=None, noise=0.0):
    """Return a recording at a constant pressure with a length in mm, one sample a second."""
    length = np.asarray(length, dtype=float)
    time = np.arange(length.size, dtype=float) if time is None else time
    length = length + noise * np.random.default_rng(0).standard_normal(length.size)
    pressure = 3e5 + 100 * np.random.default_rng(1).standard_normal(length.size)
    return Recording.from_arrays(time=time, pressure=pressure, length=1e-3 * length)


def make_triangle(position, rows=61):
    """Return a length, mm, that decreases until a position and then increases by one per sample."""
    return 200 + np.abs(np.arange(rows) - position)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_turn_of_a_stroke_is_found(noise):
    assert list(np.flatnonzero(find_turns(make_stroke(make_triangle(30), noise=noise)))) == [30]


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_both_samples_around_a_turn_between_them_are_found(noise):
    assert list(np.flatnonzero(find_turns(make_stroke(make_triangle(30.5), noise=noise)))) == [30, 31]


def test_the_ends_of_a_pause_are_found():
    length = 200 + np.concatenate([np.arange(20), np.full(20, 19), np.arange(19, 40)])
    assert list(np.flatnonzero(find_turns(make_stroke(length, noise=0.02)))) == [19, 40]


def test_a_smooth_stroke_has_no_turn():
    assert not find_turns(make_stroke(200 + 20 * np.sin(np.linspace(0, 12, 200)), noise=0.02)).any()


def test_the_noise_of_a_hold_is_no_turn():
    assert not find_turns(make_stroke(np.full(300, 200.0), noise=0.5)).any()


def test_a_longer_step_of_the_clock_is_no_turn():
    time = np.cumsum(np.where(np.arange(61) == 30, 3.0, 1.0))
    assert not find_turns(make_stroke(200 + time, time)).any()


def test_a_recording_that_changes_its_speed_everywhere_has_no_stroke():
    length = 200 + np.cumsum(np.where(np.arange(200) % 8 == 0, 1.0, 0.0))
    assert not find_turns(make_stroke(length)).any()


def test_a_static_table_and_a_short_recording_have_no_turn():
    static = Recording.from_arrays(pressure=np.full(9, 1e5), length=1e-3 * make_triangle(4, 9))
    assert not find_turns(static).any()
    assert not find_turns(make_stroke([200, 199])).any()


def test_a_new_run_is_no_turn():
    time = np.concatenate([np.arange(30.0), 500 + np.arange(30.0)])
    length = 200 + np.concatenate([np.arange(30.0), np.arange(30.0, 0.0, -1)])
    recording = make_stroke(length, time)
    assert recording.is_run_start[30]
    assert not find_turns(recording).any()


def test_a_missing_cell_is_no_turn():
    recording = make_stroke(make_triangle(30))
    length = recording.length.copy()
    length[10] = np.nan
    assert list(np.flatnonzero(find_turns(replace(recording, length=length)))) == [30]


def test_a_measured_length_does_not_select_its_own_samples():
    stroke = make_stroke(make_triangle(30))
    pressure = 3e5 + 1e3 * np.abs(np.arange(61.0) - 20)
    isotonic = Recording.from_arrays(
        time=stroke.time, pressure=pressure, length=stroke.length, force=np.full(61, 50.0),
        measures_length=True,
    )  # fmt: skip
    assert list(np.flatnonzero(find_turns(isotonic))) == [20]
