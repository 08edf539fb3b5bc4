"""Figures of a posterior on a phone: narrow, with readable text that fits."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.infer.fitting.determination import NOT_DETERMINED
from pamjax.view.figures.posterior import MAX_NARROW_PANELS, plot_corner
from pamjax.view.figures.posterior_checks import plot_profiles, plot_traces
from pamjax.view.theme import SINGLE_COLUMN

NAMES = tuple(f"braid_friction.number_{k}" for k in range(6))


def posterior(mean=0.0, sd=1.0):
    """Return a posterior of six parameters, of which the last two are correlated."""
    draws = np.random.default_rng(2).normal(size=(300, 8, 6))
    draws[..., 4] = draws[..., 5] + 0.1 * draws[..., 4]
    draws = mean + sd * draws
    flat = draws.reshape(-1, 6)
    profile = SimpleNamespace(values=np.linspace(-2, 2, 7), rise=np.linspace(-2, 2, 7) ** 2)
    return SimpleNamespace(
        names=NAMES,
        fit=SimpleNamespace(estimates=dict.fromkeys(NAMES)),
        find_units=lambda name: (1.0, "mm"),
        thin_draws=lambda count: flat[:count],
        flat=flat,
        draws=draws,
        correlation=np.corrcoef(flat.T),
        verdicts={name: SimpleNamespace(kind=NOT_DETERMINED, profile=profile) for name in NAMES},
        convergence=SimpleNamespace(rhat=np.full(6, 1.01), ess=np.full(6, 400.0)),
        converged=True,
    )


@pytest.mark.parametrize("plot", [plot_corner, plot_profiles, plot_traces])
def test_narrow_screen_has_its_own_figure(plot):
    wide, narrow = (plot(posterior(), n) for n in (False, True))
    assert wide.get_figwidth() > 1.8 * SINGLE_COLUMN
    assert narrow.get_figwidth() == SINGLE_COLUMN
    narrow.draw_without_rendering()
    texts = [
        text for panel in narrow.axes for text in (panel._left_title, panel.xaxis.label, panel.yaxis.label)
    ]
    titles = [narrow._suptitle] if narrow._suptitle else []
    for text in [*texts, *titles]:
        box = text.get_window_extent()
        assert not text.get_text() or (box.x0 >= 0 and box.x1 <= narrow.bbox.x1), text
    sizes = [text.get_fontsize() for text in texts if text.get_text()]
    assert min(sizes) >= 6


def test_narrow_corner_plot_shows_the_most_correlated_parameters():
    figure = plot_corner(posterior(), narrow=True)
    assert len(figure.axes) == MAX_NARROW_PANELS**2
    labels = [panel.get_xlabel() for panel in figure.axes[-MAX_NARROW_PANELS:]]
    assert labels[-2:] == ["braid_\nfriction.\nnumber_4\n[mm]", "braid_\nfriction.\nnumber_5\n[mm]"]
    assert " ".join(figure.get_suptitle().split()).endswith("; 4 of 6 parameters")


@pytest.mark.parametrize("narrow", [False, True])
def test_labels_of_the_corner_plot_do_not_overlap(narrow):
    """Values such as 214.12 with a small spread have no offset, and labels end at their panels."""
    figure = plot_corner(posterior(mean=214.12, sd=2e-3), narrow)
    figure.draw_without_rendering()
    count = MAX_NARROW_PANELS if narrow else len(NAMES)
    bottom, left = figure.axes[-count:], figure.axes[count::count]
    boxes = [panel.xaxis.label.get_window_extent() for panel in bottom]
    assert all(first.x1 <= second.x0 for first, second in pairwise(boxes))
    boxes = [panel.yaxis.label.get_window_extent() for panel in left]
    assert all(upper.y0 >= lower.y1 for upper, lower in pairwise(boxes))
    assert not any(panel.xaxis.get_offset_text().get_text() for panel in bottom)
    assert not any(panel.yaxis.get_offset_text().get_text() for panel in left)


def test_numbers_at_the_narrow_corner_plot_do_not_overlap():
    figure = plot_corner(posterior(mean=0.214, sd=2e-5), narrow=True)
    figure.draw_without_rendering()
    for panel in figure.axes[-MAX_NARROW_PANELS:]:
        low, high = panel.get_xlim()
        labels = [
            label.get_window_extent()
            for place, label in zip(panel.get_xticks(), panel.get_xticklabels(), strict=True)
            if low <= place <= high
        ]
        assert len(labels) >= 2
        assert all(left.x1 < right.x0 for left, right in pairwise(labels))
