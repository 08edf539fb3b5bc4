"""Blocks to hold out: complete blocks inside the range of a recording."""

import numpy as np
import pytest

from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.crossval.held_out_errors import build_held_out_mask
from pamjax.records.blocks import Blocks, find_blocks


@pytest.mark.parametrize(("many", "out"), [(1, 0), (2, 0), (3, 1), (4, 1), (6, 1), (10, 2)])
def test_complete_blocks_inside_the_range_are_held_out(many, out):
    blocks = Blocks(np.repeat(np.arange(many), 7), tuple(f"b{k}" for k in range(many)), "isobars")
    rows = build_held_out_mask(blocks)
    labels = set(blocks.label[rows].tolist())
    assert len(labels) == out
    assert not labels & {0, many - 1}
    assert rows.sum() == 7 * out


def test_simulated_protocol_has_blocks_to_hold_out():
    assert build_held_out_mask(find_blocks(build_reference_setup().plan)).any()
