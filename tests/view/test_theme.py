"""The look is applied inside its block only; a figure is written whole, and twice the same."""

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from pamjax.view.theme import (
    OKABE_ITO,
    REFERENCE_COLOUR,
    add_panel_letters,
    add_pressure_bar,
    apply_theme,
    build_pressure_colours,
    build_shades,
    create_figure,
    save_figure,
)


def drawn():
    with apply_theme():
        made = create_figure(3.5, 2.5)
        panel = made.subplots()
        panel.plot([0, 1], [0, 1])
        panel.set(xlabel="contraction [%]", ylabel="force [N]", title="rises")
        add_panel_letters([panel])
        add_pressure_bar(panel, [100, 200, 400])
    return made


def settings():
    """All but the backend, which the reading of it alone would settle."""
    return {name: matplotlib.rcParams[name] for name in matplotlib.rcParams if name != "backend"}


def luminance(colour):
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def test_no_setting_outlives_the_block():
    before = settings()
    drawn()
    assert settings() == before


def test_a_failure_inside_the_block_leaves_no_setting():
    before = settings()
    with pytest.raises(ZeroDivisionError), apply_theme():
        _ = 1 / 0
    assert settings() == before


def test_saved_whole_as_png_and_pdf(tmp_path):
    png, pdf = save_figure(drawn(), tmp_path / "new" / "fig.1")
    assert (png.name, pdf.name) == ("fig.1.png", "fig.1.pdf")
    assert png.read_bytes()[:4] == b"\x89PNG"
    assert pdf.read_bytes()[:4] == b"%PDF"
    assert sorted(p.name for p in png.parent.iterdir()) == ["fig.1.pdf", "fig.1.png"]


def test_same_figure_same_bytes(tmp_path):
    first, second = save_figure(drawn(), tmp_path / "a"), save_figure(drawn(), tmp_path / "b")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


@pytest.mark.parametrize("levels", [[300.0], [100.0, 200.0, 400.0], list(np.arange(69.0, 700.0, 69.0))])
def test_a_colour_for_each_isobar_darker_with_pressure(levels):
    colours, norm = build_pressure_colours(levels)
    shades = [luminance(colours(norm(level))) for level in levels]
    assert len(set(shades)) == len(levels)
    assert shades == sorted(shades, reverse=True)
    assert max(shades) < 0.7, "the lightest must still be seen on paper"


def test_colours_of_kinds_are_the_published_ones():
    assert OKABE_ITO["blue"] == "#0072B2"
    assert len(set(OKABE_ITO.values())) == 8
    assert 0.05 < luminance(REFERENCE_COLOUR) < 0.3


def test_every_isobar_stands_out_from_paper():
    # WCAG 2.2, 1.4.11: (1.05)/(L + 0.05) at least 3, L the relative luminance of white paper's other side.
    straight = build_shades(10)[:, :3]
    linear = np.where(straight <= 0.04045, straight / 12.92, ((straight + 0.055) / 1.055) ** 2.4)
    contrast = 1.05 / (linear @ [0.2126, 0.7152, 0.0722] + 0.05)
    assert contrast.min() > 2.99
    assert np.all(np.diff(contrast) > 0)
