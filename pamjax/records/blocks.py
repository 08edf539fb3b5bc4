"""Blocks of dependent rows; cross-validation holds out whole blocks.

Rows of one loop share their history, noise and level. A fit to half of a loop is not tested by the other
half. The recording itself determines the blocks, for any protocol:

| pressure      | length        | blocks                                                            |
|---------------|---------------|-------------------------------------------------------------------|
| few levels    | strokes       | isobars                                                           |
| moves         | few levels    | lengths                                                           |
| few levels    | few levels    | holds; if all pairs were set, the channel with fewer changes      |
| else          | else          | cycles, or sequences of rows, or single rows                      |

In an isotonic test the length is measured, so it has no levels. The blocks are its loads if there are at
least three, else its cycles, else its isobars.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from pamjax.errors import BadInput
from pamjax.records.levels import assign_levels, find_levels, find_nearest_level
from pamjax.records.recording import Recording
from pamjax.units import format_quantity

#: Minimum number of isobars or lengths: with one held out, the other two still determine a line.
_MIN_BLOCK_COUNT = 3
#: Minimum share of measured pairs for crossed levels; below 1, because a sweep may end early.
_MIN_CROSSED_SHARE = 0.75
#: Minimum number of samples of a hold; a shorter sequence is a transition.
_MIN_HOLD_SAMPLES = 5
#: Maximum number of rows of a table of single readings.
_MAX_SINGLE_READINGS = 40
#: Number of equal parts of a recording without levels or cycles.
_PART_COUNT = 10


@dataclass(frozen=True, eq=False)
class Blocks:
    """The blocks of a recording.

    Attributes:
        label: (n,) index of each row's block; -1 for unusable rows and rows between two levels.
        names: name of each block, as "isobar 138 kPa".
        kind: "isobars", "lengths", "loads", "holds", "cycles", "rows" or "parts" (sequences of rows).
    """

    label: np.ndarray
    names: tuple[str, ...]
    kind: str

    def __len__(self) -> int:
        return len(self.names)

    def build_mask(self, index: int) -> np.ndarray:
        """Return the mask of the rows of one block, (n,) bool."""
        return self.label == index


#: Blocks of each recording in use: a command asks for them about ten times.
_blocks_of_recordings: WeakKeyDictionary[Recording, Blocks] = WeakKeyDictionary()


def find_blocks(recording: Recording) -> Blocks:
    """Return the blocks of a recording."""
    if recording not in _blocks_of_recordings:
        _blocks_of_recordings[recording] = _find_blocks(recording)
    return _blocks_of_recordings[recording]


def _find_blocks(recording: Recording) -> Blocks:
    if recording.measures_length:
        row_blocks = _find_loads(recording) or _find_cycles(recording) or _find_isobars(recording)
        row_blocks = row_blocks or _split_rows(recording)
    else:
        row_blocks = _find_level_blocks(recording) or _find_cycles(recording) or _split_rows(recording)
    return _drop_unusable_rows(row_blocks, recording.usable)


def split_folds(blocks: Blocks, k: int = 5, seed: int = 0) -> list[np.ndarray]:
    """Return the masks of the held-out rows of each fold; each block is in exactly one fold.

    Each fold takes one of every k neighbouring blocks. Hence every fold covers the whole range.

    Args:
        blocks: the blocks, in order of their level or of time.
        k: number of folds, at most the number of blocks.
        seed: seed of the random assignment of blocks to folds.

    Returns:
        list of (n,) bool.

    Raises:
        BadInput: if there are fewer than two blocks.
    """
    block_count = len(blocks)
    if block_count < 2:
        raise BadInput.from_rule(
            "cross-validation needs at least two blocks",
            f"{block_count}",
            remedy="Record at another pressure or length.",
        )
    k = max(2, min(k, block_count))
    random = np.random.default_rng(seed)
    fold_of = np.concatenate([random.permutation(k) for _ in range(0, block_count, k)])[:block_count]
    # The last group may have fewer than k blocks. No fold is empty: the first group has a block for each.
    return [np.isin(blocks.label, np.flatnonzero(fold_of == fold)) for fold in range(k)]


def assign_length_levels(recording: Recording) -> np.ndarray:
    """Return the index of the length level of each row, (n,), for a length error per level.

    A row between two levels gets the nearer one. A recording of strokes has one level, 0. The index is -1
    where the length was not measured.
    """
    levels = find_levels(recording.length, recording.has_time)
    if not len(levels):
        levels = np.array([np.nanmedian(recording.length)])
    return find_nearest_level(recording.length, levels)


def _find_loads(recording: Recording) -> Blocks | None:
    """Return the set forces of an isotonic test; None if they are too few."""
    loads, label = np.unique(recording.force.round(6), return_inverse=True)
    loads = loads[np.isfinite(loads)]
    if not _MIN_BLOCK_COUNT <= loads.size <= recording.n / _MIN_BLOCK_COUNT:
        return None
    label = np.where(np.isfinite(recording.force), label, -1)
    return Blocks(label, tuple(f"load {format_quantity(load, 'N', 4)}" for load in loads), "loads")


def _find_isobars(recording: Recording) -> Blocks | None:
    """Return the pressures of an isotonic test; None if they are too few."""
    pressures = find_levels(recording.pressure, recording.has_time)
    if len(pressures) < _MIN_BLOCK_COUNT:
        return None
    names = _name_levels("isobar", pressures, "kPa")
    return Blocks(assign_levels(recording.pressure, pressures), names, "isobars")


def _find_level_blocks(recording: Recording) -> Blocks | None:
    """Return isobars, lengths or holds; None if the recording has too few levels."""
    pressures = find_levels(recording.pressure, recording.has_time)
    lengths = find_levels(recording.length, recording.has_time)
    isobars = Blocks(
        assign_levels(recording.pressure, pressures), _name_levels("isobar", pressures, "kPa"), "isobars"
    )
    length_blocks = Blocks(
        assign_levels(recording.length, lengths), _name_levels("length", lengths, "mm"), "lengths"
    )
    if (
        recording.has_time
        and min(len(isobars), len(length_blocks)) > 1
        and not _are_crossed(isobars, length_blocks)
    ):
        return _find_holds(isobars.label, length_blocks.label)
    # The channel that changes less often has the levels; the other channel was swept.
    first, second = sorted((isobars, length_blocks), key=lambda candidate: _count_changes(candidate.label))
    return next((candidate for candidate in (first, second) if len(candidate) >= _MIN_BLOCK_COUNT), None)


def _name_levels(kind: str, levels: np.ndarray, unit: str) -> tuple[str, ...]:
    """Return the names of the levels, with enough digits to distinguish them."""
    for digits in (3, 4, 5):
        names = tuple(f"{kind} {format_quantity(level, unit, digits)}" for level in levels)
        if len(set(names)) == len(names):
            break
    return names


def _are_crossed(isobars: Blocks, length_blocks: Blocks) -> bool:
    """Return whether nearly every pair of pressure and length was measured."""
    at_both = (isobars.label >= 0) & (length_blocks.label >= 0)
    measured_pairs = set(
        zip(isobars.label[at_both].tolist(), length_blocks.label[at_both].tolist(), strict=True)
    )
    return len(measured_pairs) >= _MIN_CROSSED_SHARE * len(isobars) * len(length_blocks)


def _count_changes(label: np.ndarray) -> int:
    at_level = label[label >= 0]
    return int(np.count_nonzero(np.diff(at_level)))


def _find_holds(at_pressure: np.ndarray, at_length: np.ndarray) -> Blocks | None:
    """Return the holds of constant pressure and length; the transition before a hold belongs to it."""
    is_settled = (at_pressure >= 0) & (at_length >= 0)
    pair = np.where(is_settled, at_pressure * (at_length.max() + 1) + at_length, -1)
    label = np.empty(len(pair), dtype=int)
    count, first_row, previous_pair = -1, 0, None
    for first, last in _find_constant_runs(pair):
        if pair[first] < 0 or last - first < _MIN_HOLD_SAMPLES:
            continue
        if pair[first] != previous_pair:
            count, previous_pair = count + 1, pair[first]
        label[first_row:last] = count
        first_row = last
    if count + 1 < _MIN_BLOCK_COUNT:
        return None
    label[first_row:] = count
    return Blocks(label, tuple(f"hold {i + 1}" for i in range(count + 1)), "holds")


def _find_cycles(recording: Recording) -> Blocks | None:
    """Return the numbered cycles, divided at jumps of the recording; rows of cycle 0 have no block."""
    if not recording.has_time:
        return None
    run_number = np.cumsum(recording.is_run_start)
    label, names = np.full(recording.n, -1), []
    numbers: list[int] = []
    for first, last in _find_constant_runs(run_number * (recording.cycle.max() + 1) + recording.cycle):
        if recording.cycle[first] > 0:
            label[first:last] = len(names)
            numbers.append(int(recording.cycle[first]))
            names.append(f"run {run_number[first]}, cycle {recording.cycle[first]}")
    if len(names) < 2:
        return None
    if len(set(numbers)) == len(numbers):
        names = [f"cycle {number}" for number in numbers]
    return Blocks(label, tuple(names), "cycles")


def _split_rows(recording: Recording) -> Blocks:
    """Return the single rows of a short recording, or equal parts of a long one."""
    n = recording.n
    if n <= _MAX_SINGLE_READINGS:
        return Blocks(np.arange(n), tuple(f"row {row}" for row in recording.row), "rows")
    label = np.arange(n) * _PART_COUNT // n
    ends = [recording.row[label == i][[0, -1]] for i in range(_PART_COUNT)]
    return Blocks(label, tuple(f"rows {first} to {last}" for first, last in ends), "parts")


def _drop_unusable_rows(blocks: Blocks, usable: np.ndarray) -> Blocks:
    """Return the blocks without unusable rows and without empty blocks."""
    label = np.where(usable, blocks.label, -1)
    nonempty = np.unique(label[label >= 0])
    new_index = np.full(len(blocks) + 1, -1)
    new_index[nonempty] = np.arange(len(nonempty))
    return Blocks(new_index[label], tuple(blocks.names[i] for i in nonempty), blocks.kind)


def _find_constant_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Return the first row, and the row after the last, of each sequence of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(values)], strict=True))
