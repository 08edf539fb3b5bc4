"""The band of a line: it covers the range on the way there and on the way back."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.view.figures.layout import Layout, draw_band, split_at_turns
from pamjax.view.theme import create_figure


@pytest.mark.parametrize(
    ("x", "parts"),
    [
        ([0, 1, 2, 3], [(0, 4)]),
        ([0, 1, 2, 1, 0], [(0, 3), (2, 5)]),
        ([3, 2, 2, 2, 4, 5, 1], [(0, 4), (3, 6), (5, 7)]),
        ([1, 1, 1], [(0, 3)]),
    ],
)
def test_line_is_divided_where_it_turns_back(x, parts):
    assert [(part.start, part.stop) for part in split_at_turns(np.array(x, dtype=float))] == parts


def compute_area(vertices):
    """Return the area of a polygon with these corners, without self-intersection."""
    x, y = vertices.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def test_band_of_a_closed_stroke_covers_both_ways():
    x = np.array([0.0, 5, 10, 5, 0])
    rows = np.ones(5, dtype=bool)
    layout = Layout(x, "contraction [%]", np.zeros(5, dtype=int), ("all",), ("#000000",), (), True)
    case = SimpleNamespace(
        recording=SimpleNamespace(time=np.arange(5.0), is_run_start=np.arange(5) == 0, n=5)
    )
    panel = create_figure().subplots()
    draw_band(panel, case, layout, 0, rows, np.full(5, 2.0), np.full(5, 3.0))
    (band,) = panel.collections
    # Bands of repeated strokes overlap. Transparent ones would show dark stripes there.
    assert band.get_alpha() is None
    assert band.get_facecolor()[:, 3].tolist() == [1.0]
    areas = [compute_area(path.vertices[:-1]) for path in band.get_paths()]
    assert areas == pytest.approx([10.0, 10.0])
    assert panel.get_xlim()[1] >= 10
    assert panel.get_ylim()[0] <= 2 < 3 <= panel.get_ylim()[1]
    # One polygon around the whole stroke has no area.
    outline = np.vstack([np.c_[x, np.full(5, 2.0)], np.c_[x, np.full(5, 3.0)][::-1]])
    assert compute_area(outline) == pytest.approx(0)
