"""The theme applies inside its block only, and saved figures are complete and reproducible."""

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from pamjax.view.reports.page import render_svg
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


def build_figure():
    with apply_theme():
        figure = create_figure(3.5, 2.5)
        panel = figure.subplots()
        panel.plot([0, 1], [0, 1])
        panel.set(xlabel="contraction [%]", ylabel="force [N]", title="rises")
        add_panel_letters([panel])
        add_pressure_bar(panel, [100, 200, 400])
    return figure


def settings():
    """Return all settings except the backend, because reading it selects one."""
    return {name: matplotlib.rcParams[name] for name in matplotlib.rcParams if name != "backend"}


def luminance(colour):
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def test_settings_are_restored_after_the_block():
    before = settings()
    build_figure()
    assert settings() == before


def test_settings_are_restored_after_an_error():
    before = settings()
    with pytest.raises(ZeroDivisionError), apply_theme():
        _ = 1 / 0
    assert settings() == before


def test_figure_is_saved_completely_as_png_and_pdf(tmp_path):
    png, pdf = save_figure(build_figure(), tmp_path / "new" / "fig.1")
    assert (png.name, pdf.name) == ("fig.1.png", "fig.1.pdf")
    assert png.read_bytes()[:4] == b"\x89PNG"
    assert pdf.read_bytes()[:4] == b"%PDF"
    assert sorted(p.name for p in png.parent.iterdir()) == ["fig.1.pdf", "fig.1.png"]


def test_same_figure_gives_the_same_bytes(tmp_path):
    first, second = save_figure(build_figure(), tmp_path / "a"), save_figure(build_figure(), tmp_path / "b")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


@pytest.mark.parametrize("levels", [[300.0], [100.0, 200.0, 400.0], list(np.arange(69.0, 700.0, 69.0))])
def test_isobars_are_darker_at_higher_pressure(levels):
    colours, norm = build_pressure_colours(levels)
    shades = [luminance(colours(norm(level))) for level in levels]
    assert len(set(shades)) == len(levels)
    assert shades == sorted(shades, reverse=True)
    assert max(shades) < 0.7, "the lightest colour must be visible on paper"


def test_colours_agree_with_the_published_palette():
    assert OKABE_ITO["blue"] == "#0072B2"
    assert len(set(OKABE_ITO.values())) == 8
    assert 0.05 < luminance(REFERENCE_COLOUR) < 0.3


def test_every_isobar_contrasts_with_white():
    # WCAG 2.2, 1.4.11: contrast 1.05 / (L + 0.05) to white is at least 3, with relative luminance L.
    colours = build_shades(10)[:, :3]
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    contrast = 1.05 / (linear @ [0.2126, 0.7152, 0.0722] + 0.05)
    assert contrast.min() > 2.99
    assert np.all(np.diff(contrast) > 0)


HOSTILE_NAMES = ["math$_$", "$\\frac{$", "a$b", "$x^2$", "$$", "\\$5", "\n$_$"]


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_name_with_dollar_signs_is_no_formula(name, tmp_path):
    with apply_theme():
        figure = create_figure(3.5, 2.5)
        panel = figure.subplots()
        panel.plot([1, 10], [1, 2], label=name)
        panel.set(xlabel=name, title=name, xscale="log")
        panel.set_yticks([1, 2], [name, "plain"])
        panel.legend()
        add_panel_letters([panel])
    shown = name.strip().replace("\\$", "$")
    assert f">{shown}</text>" in render_svg(figure, "names", "")
    save_figure(figure, tmp_path / "figure")
    escaped = name.replace("\\$", "$").replace("$", "\\$")
    assert panel.get_xlabel() == escaped
    assert panel.get_title("left") == rf"$\bf{{(a)}}$ {escaped}"
    assert [label.get_text() for label in panel.get_yticklabels()] == [escaped, "plain"]
    assert any("mathdefault" in label.get_text() for label in panel.get_xticklabels())


def test_unescaped_name_is_an_error_of_matplotlib(tmp_path):
    figure = create_figure(3.5, 2.5)
    figure.subplots().set_title("math$_$")
    with pytest.raises(ValueError, match="Expected"):
        figure.savefig(tmp_path / "figure.png")
