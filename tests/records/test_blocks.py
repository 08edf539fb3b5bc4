"""Blocks are whole, found in whatever protocol, and held out each exactly once."""

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.blocks import Blocks, find_blocks, find_length_settings, split_folds
from pamjax.records.levels import assign_levels, find_levels
from pamjax.records.recording import Recording
from tests.records.conftest import strokes


def recorded(**columns):
    return Recording.from_arrays(**{"force": np.ones(len(columns["pressure"])), **columns})


def isometric(lengths=(0.2, 0.19, 0.18), noise=0.0):
    """Pressure climbs and falls at one length after the other."""
    sweep = 5e4 + 4e5 * (1 - np.abs(np.linspace(-1, 1, 200)))
    n = 200 * len(lengths)
    length = np.repeat(lengths, 200) + noise * np.random.default_rng(0).standard_normal(n)
    time = 0.1 * np.arange(n) + 30.0 * (np.arange(n) // 200)
    return recorded(time=time, pressure=np.tile(sweep, len(lengths)), length=length)


def held(pairs, samples=100, way=6):
    """Holds at (pressure, length) with a few samples on the way from one to the next."""
    points = []
    for before, now in zip([pairs[0], *pairs[:-1]], pairs, strict=True):
        points += [np.linspace(before, now, way + 2)[1:-1], np.tile(np.array(now), (samples, 1))]
    pressure, length = np.concatenate(points).T
    return recorded(time=0.4 * np.arange(len(pressure)), pressure=pressure, length=length)


def test_isobars():
    found = find_blocks(Recording.from_arrays(**strokes(noise=1.0, cycles=2)))
    assert found.kind == "isobars"
    assert found.names == ("isobar 100 kPa", "isobar 200 kPa", "isobar 300 kPa")
    assert found.label.tolist() == np.repeat([0, 1, 2], 240).tolist()


def test_an_isobar_that_comes_back_is_the_same_block():
    found = find_blocks(Recording.from_arrays(**strokes(levels=(3e5, 1e5, 2e5, 3e5), noise=1.0)))
    assert found.label[[0, 120, 240, 360]].tolist() == [2, 0, 1, 2]


def test_samples_on_the_way_between_isobars_belong_to_none():
    columns = strokes(noise=1.0)
    columns["pressure"][118:120] = [140e3, 160e3]
    label = find_blocks(Recording.from_arrays(**columns)).label
    assert np.flatnonzero(label < 0).tolist() == [118, 119]


@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_lengths(noise):
    recording = isometric(noise=noise)
    found = find_blocks(recording)
    assert found.kind == "lengths"
    assert found.names == ("length 180 mm", "length 190 mm", "length 200 mm")
    assert found.label.tolist() == np.repeat([2, 1, 0], 200).tolist()
    assert find_length_settings(recording).tolist() == found.label.tolist()


def test_lengths_where_pressure_settles_too():
    """A valve staircase rests at both ends of the pressure: each pressure was met at each length."""
    pressure = np.tile(np.repeat([1e5, 6e5, 1e5], 100), 3)
    length = np.repeat([0.2, 0.19, 0.18], 300)
    found = find_blocks(recorded(time=0.1 * np.arange(900), pressure=pressure, length=length))
    assert (found.kind, len(found)) == ("lengths", 3)


def test_isobars_where_length_settles_too():
    pressure = np.repeat([1e5, 2e5, 3e5], 300)
    length = np.tile(np.repeat([0.2, 0.19, 0.18], 100), 3)
    found = find_blocks(recorded(time=0.1 * np.arange(900), pressure=pressure, length=length))
    assert (found.kind, len(found)) == ("isobars", 3)


def test_holds_own_the_move_towards_them():
    pairs = [(4e5, 0.20), (4e5, 0.18), (2e5, 0.18), (2e5, 0.16), (6e5, 0.19), (6e5, 0.17)]
    found = find_blocks(held(pairs))
    assert found.kind == "holds"
    assert found.names == tuple(f"hold {i}" for i in range(1, 7))
    expected = np.repeat(np.arange(6), 106)
    # The first samples of a move lie near the hold it leaves; its last ones belong to the hold it reaches.
    early = np.arange(636) % 106 < 3
    assert (found.label == expected)[~early].all()
    assert (found.label >= 0).all()


def test_too_few_isobars_fall_back_on_cycles():
    found = find_blocks(Recording.from_arrays(**strokes(levels=(1e5, 2e5), cycles=2, noise=1.0)))
    assert found.kind == "cycles"
    assert found.names == ("run 1, cycle 1", "run 1, cycle 2", "run 2, cycle 1", "run 2, cycle 2")


def test_cycles_keep_their_numbers_and_zero_is_none():
    columns = strokes(levels=(2e5,), cycles=4, noise=1.0)
    columns["cycle"] = columns["cycle"] - 1
    found = find_blocks(Recording.from_arrays(**columns))
    assert found.names == ("cycle 1", "cycle 2", "cycle 3")
    assert (found.label[:120] == -1).all()


def test_a_short_table_has_a_block_a_row():
    found = find_blocks(
        Recording.from_arrays(pressure=np.arange(1, 9) * 1e5, length=0.2, diameter=np.full(8, 0.02))
    )
    assert (found.kind, len(found), found.names[0]) == ("rows", 8, "row 2")


def test_a_static_map_is_blocked_by_isobars():
    pressure, length = np.meshgrid([1e5, 2e5, 3e5, 4e5], np.linspace(0.15, 0.2, 9), indexing="ij")
    found = find_blocks(recorded(pressure=pressure.ravel(), length=length.ravel()))
    assert (found.kind, len(found)) == ("isobars", 4)


def test_what_has_no_structure_is_cut_into_stretches():
    random = np.random.default_rng(3)
    pressure = 3e5 + np.cumsum(random.standard_normal(1000)) * 3e3
    length = 0.18 + np.cumsum(random.standard_normal(1000)) * 1e-4
    found = find_blocks(recorded(time=np.arange(1000.0), pressure=pressure, length=length))
    assert (found.kind, len(found), found.names[0]) == ("rows", 10, "rows 2 to 101")


def test_unusable_rows_belong_to_no_block():
    columns = strokes()
    columns["pressure"][:120] = np.nan
    columns["length"][130] = np.nan
    found = find_blocks(
        Recording.from_arrays(**strokes(levels=(1e5, 1e5, 2e5, 3e5, 4e5))).select(np.arange(600) > 0)
    )
    assert len(found) == 4
    label = find_blocks(Recording.from_arrays(**columns)).label
    assert (label[:120] == -1).all()
    assert label[130] == -1


def test_a_level_needs_samples_and_a_stroke_is_none():
    random = np.random.default_rng(0)
    assert len(find_levels(random.uniform(0.1, 0.2, 5000))) == 0
    assert len(find_levels(random.uniform(0.1, 0.2, 60))) == 0
    assert len(find_levels(0.18 + 0.02 * np.sin(np.linspace(0, 60, 5000)))) == 0
    same_each_time = np.tile(np.r_[0:20, 20:0:-1] * 1e-3 + 0.16, 30)
    assert len(find_levels(same_each_time)) == 21
    assert len(find_levels(same_each_time, ordered=True)) == 0
    assert find_levels(np.full(50, np.nan)).size == 0
    levels = find_levels(np.repeat([1.0, 2.0, 4.0], 40) + 0.01 * random.standard_normal(120))
    assert levels == pytest.approx([1.0, 2.0, 4.0], abs=0.01)
    assert assign_levels(np.array([1.01, 1.5, 3.9, np.nan]), levels).tolist() == [0, -1, 2, -1]


@pytest.mark.parametrize("many", [2, 3, 5, 6, 7, 10, 23])
@pytest.mark.parametrize("seed", [0, 1])
def test_each_block_is_held_out_once_and_whole(many, seed):
    label = np.repeat(np.arange(many), 7)
    label[3] = -1
    found = Blocks(label, tuple(map(str, range(many))), "holds")
    held_out = split_folds(found, k=5, seed=seed)
    assert len(held_out) == min(5, many)
    assert (np.sum(held_out, axis=0) == (label >= 0)).all()
    for mask in held_out:
        whole = np.unique(label[mask])
        assert mask.sum() == np.isin(label, whole).sum()
        # Spread: a fold never takes two of k neighbouring blocks.
        assert len(np.unique(whole // 5)) == len(whole)
    again = split_folds(found, k=5, seed=seed)
    assert all((a == b).all() for a, b in zip(held_out, again, strict=True))


def test_one_block_cannot_be_held_out():
    with pytest.raises(BadInput) as told:
        split_folds(Blocks(np.zeros(9, dtype=int), ("row 2",), "rows"))
    assert str(told.value) == "holding out needs two blocks; got 1. Record another pressure or length."


def test_a_stroke_has_one_setting():
    recording = Recording.from_arrays(**strokes())
    assert set(find_length_settings(recording).tolist()) == {0}


def test_real_cases_fall_into_blocks(real_case):
    recording = real_case.recording
    found = find_blocks(recording)
    assert found.kind in ("isobars", "lengths", "holds")
    assert 3 <= len(found) <= 20
    assert (found.label >= 0).mean() > 0.98
    if real_case.name.startswith("hose"):
        assert found.kind == "lengths"
        assert find_length_settings(recording).max() + 1 == len(found)
