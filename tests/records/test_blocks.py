"""Blocks of a recording are complete, follow its protocol, and are each held out once."""

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.blocks import Blocks, assign_length_levels, find_blocks, split_folds
from pamjax.records.levels import assign_levels, find_levels
from pamjax.records.recording import Recording
from tests.records.conftest import strokes


def recorded(**columns):
    return Recording.from_arrays(**{"force": np.ones(len(columns["pressure"])), **columns})


def isometric(lengths=(0.2, 0.19, 0.18), noise=0.0):
    """Return ramps of pressure up and down at several lengths."""
    sweep = 5e4 + 4e5 * (1 - np.abs(np.linspace(-1, 1, 200)))
    n = 200 * len(lengths)
    length = np.repeat(lengths, 200) + noise * np.random.default_rng(0).standard_normal(n)
    time = 0.1 * np.arange(n) + 30.0 * (np.arange(n) // 200)
    return recorded(time=time, pressure=np.tile(sweep, len(lengths)), length=length)


def holds(pairs, samples=100, transition=6):
    """Return holds at (pressure, length), with a few samples between them."""
    points = []
    for before, now in zip([pairs[0], *pairs[:-1]], pairs, strict=True):
        points += [np.linspace(before, now, transition + 2)[1:-1], np.tile(np.array(now), (samples, 1))]
    pressure, length = np.concatenate(points).T
    return recorded(time=0.4 * np.arange(len(pressure)), pressure=pressure, length=length)


def test_isobars_are_blocks():
    blocks = find_blocks(Recording.from_arrays(**strokes(noise=1.0, cycles=2)))
    assert blocks.kind == "isobars"
    assert blocks.names == ("isobar 100 kPa", "isobar 200 kPa", "isobar 300 kPa")
    assert blocks.label.tolist() == np.repeat([0, 1, 2], 240).tolist()


def test_repeated_isobar_is_the_same_block():
    blocks = find_blocks(Recording.from_arrays(**strokes(levels=(3e5, 1e5, 2e5, 3e5), noise=1.0)))
    assert blocks.label[[0, 120, 240, 360]].tolist() == [2, 0, 1, 2]


def test_samples_between_isobars_belong_to_no_block():
    columns = strokes(noise=1.0)
    columns["pressure"][118:120] = [140e3, 160e3]
    label = find_blocks(Recording.from_arrays(**columns)).label
    assert np.flatnonzero(label < 0).tolist() == [118, 119]


@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_fixed_lengths_are_blocks(noise):
    recording = isometric(noise=noise)
    blocks = find_blocks(recording)
    assert blocks.kind == "lengths"
    assert blocks.names == ("length 180 mm", "length 190 mm", "length 200 mm")
    assert blocks.label.tolist() == np.repeat([2, 1, 0], 200).tolist()
    assert assign_length_levels(recording).tolist() == blocks.label.tolist()


def test_fixed_lengths_with_settled_pressures_are_blocks():
    """A valve staircase rests at the lowest and highest pressure: each pressure occurs at each length."""
    pressure = np.tile(np.repeat([1e5, 6e5, 1e5], 100), 3)
    length = np.repeat([0.2, 0.19, 0.18], 300)
    blocks = find_blocks(recorded(time=0.1 * np.arange(900), pressure=pressure, length=length))
    assert (blocks.kind, len(blocks)) == ("lengths", 3)


def test_isobars_with_settled_lengths_are_blocks():
    pressure = np.repeat([1e5, 2e5, 3e5], 300)
    length = np.tile(np.repeat([0.2, 0.19, 0.18], 100), 3)
    blocks = find_blocks(recorded(time=0.1 * np.arange(900), pressure=pressure, length=length))
    assert (blocks.kind, len(blocks)) == ("isobars", 3)


def test_block_of_a_hold_includes_the_move_towards_it():
    pairs = [(4e5, 0.20), (4e5, 0.18), (2e5, 0.18), (2e5, 0.16), (6e5, 0.19), (6e5, 0.17)]
    blocks = find_blocks(holds(pairs))
    assert blocks.kind == "holds"
    assert blocks.names == tuple(f"hold {i}" for i in range(1, 7))
    expected = np.repeat(np.arange(6), 106)
    # The first samples of a transition are near the previous hold; the last ones belong to the next hold.
    early = np.arange(636) % 106 < 3
    assert (blocks.label == expected)[~early].all()
    assert (blocks.label >= 0).all()


def test_cycles_are_blocks_if_isobars_are_too_few():
    blocks = find_blocks(Recording.from_arrays(**strokes(levels=(1e5, 2e5), cycles=2, noise=1.0)))
    assert blocks.kind == "cycles"
    assert blocks.names == ("run 1, cycle 1", "run 1, cycle 2", "run 2, cycle 1", "run 2, cycle 2")


def test_cycles_keep_their_numbers_and_zero_means_none():
    columns = strokes(levels=(2e5,), cycles=4, noise=1.0)
    columns["cycle"] = columns["cycle"] - 1
    blocks = find_blocks(Recording.from_arrays(**columns))
    assert blocks.names == ("cycle 1", "cycle 2", "cycle 3")
    assert (blocks.label[:120] == -1).all()


def test_each_row_of_a_short_table_is_a_block():
    blocks = find_blocks(
        Recording.from_arrays(pressure=np.arange(1, 9) * 1e5, length=0.2, diameter=np.full(8, 0.02))
    )
    assert (blocks.kind, len(blocks), blocks.names[0]) == ("rows", 8, "row 2")


def test_a_static_map_is_blocked_by_isobars():
    pressure, length = np.meshgrid([1e5, 2e5, 3e5, 4e5], np.linspace(0.15, 0.2, 9), indexing="ij")
    blocks = find_blocks(recorded(pressure=pressure.ravel(), length=length.ravel()))
    assert (blocks.kind, len(blocks)) == ("isobars", 4)


def test_recording_without_structure_is_cut_into_equal_parts():
    random = np.random.default_rng(3)
    pressure = 3e5 + np.cumsum(random.standard_normal(1000)) * 3e3
    length = 0.18 + np.cumsum(random.standard_normal(1000)) * 1e-4
    blocks = find_blocks(recorded(time=np.arange(1000.0), pressure=pressure, length=length))
    assert (blocks.kind, len(blocks), blocks.names[0]) == ("parts", 10, "rows 2 to 101")


def test_unusable_rows_belong_to_no_block():
    columns = strokes()
    columns["pressure"][:120] = np.nan
    columns["length"][130] = np.nan
    blocks = find_blocks(
        Recording.from_arrays(**strokes(levels=(1e5, 1e5, 2e5, 3e5, 4e5))).select(np.arange(600) > 0)
    )
    assert len(blocks) == 4
    label = find_blocks(Recording.from_arrays(**columns)).label
    assert (label[:120] == -1).all()
    assert label[130] == -1


def test_setting_needs_several_samples_and_a_stroke_has_none():
    random = np.random.default_rng(0)
    assert len(find_levels(random.uniform(0.1, 0.2, 5000))) == 0
    assert len(find_levels(random.uniform(0.1, 0.2, 60))) == 0
    assert len(find_levels(0.18 + 0.02 * np.sin(np.linspace(0, 60, 5000)))) == 0
    repeated_strokes = np.tile(np.r_[0:20, 20:0:-1] * 1e-3 + 0.16, 30)
    assert len(find_levels(repeated_strokes)) == 21
    assert len(find_levels(repeated_strokes, is_time_series=True)) == 0
    assert find_levels(np.full(50, np.nan)).size == 0
    levels = find_levels(np.repeat([1.0, 2.0, 4.0], 40) + 0.01 * random.standard_normal(120))
    assert levels == pytest.approx([1.0, 2.0, 4.0], abs=0.01)
    assert assign_levels(np.array([1.01, 1.5, 3.9, np.nan]), levels).tolist() == [0, -1, 2, -1]


@pytest.mark.parametrize("block_count", [2, 3, 5, 6, 7, 10, 23])
@pytest.mark.parametrize("seed", [0, 1])
def test_each_block_is_held_out_once_and_completely(block_count, seed):
    label = np.repeat(np.arange(block_count), 7)
    label[3] = -1
    blocks = Blocks(label, tuple(map(str, range(block_count))), "holds")
    held_out = split_folds(blocks, k=5, seed=seed)
    assert len(held_out) == min(5, block_count)
    assert (np.sum(held_out, axis=0) == (label >= 0)).all()
    for mask in held_out:
        held_blocks = np.unique(label[mask])
        assert mask.sum() == np.isin(label, held_blocks).sum()
        # A fold never has two of k neighbouring blocks.
        assert len(np.unique(held_blocks // 5)) == len(held_blocks)
    again = split_folds(blocks, k=5, seed=seed)
    assert all((a == b).all() for a, b in zip(held_out, again, strict=True))


def test_one_block_cannot_be_held_out():
    with pytest.raises(BadInput) as error:
        split_folds(Blocks(np.zeros(9, dtype=int), ("row 2",), "rows"))
    assert (
        str(error.value)
        == "cross-validation needs at least two blocks; got 1. Record at another pressure or length."
    )


def test_a_stroke_has_one_setting():
    recording = Recording.from_arrays(**strokes())
    assert set(assign_length_levels(recording).tolist()) == {0}


def test_real_cases_have_blocks(real_case):
    recording = real_case.recording
    blocks = find_blocks(recording)
    assert blocks.kind in ("isobars", "lengths", "holds")
    assert 3 <= len(blocks) <= 20
    assert (blocks.label >= 0).mean() > 0.98
    if real_case.name.startswith("hose"):
        assert blocks.kind == "lengths"
        assert assign_length_levels(recording).max() + 1 == len(blocks)
