"""Style of every figure: sizes, fonts, colours, and the writing of files.

Every figure is a separate `matplotlib.figure.Figure`, without pyplot. Settings apply inside a `with` block
only, so they do not change a user's own plots.

Colours: Okabe & Ito's eight for categories (Color Universal Design, 2008). Pressure has the green-to-blue
part of viridis, dark for high pressure. The light end has too little contrast on paper.
"""

from __future__ import annotations

import io
import re
import string
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter

from pamjax.records.files import write_atomically

#: Widths of one and of two columns of a journal, inches.
SINGLE_COLUMN, DOUBLE_COLUMN = 3.5, 7.2

#: Dots per inch of a figure in a notebook.
_NOTEBOOK_DPI = 110

#: Colours of categories, with Okabe and Ito's names.
OKABE_ITO = {
    "black": "#000000",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "green": "#009E73",
    "yellow": "#F0E442",
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "purple": "#CC79A7",
}

#: Colour of references, limits and alternatives, less prominent than data and model.
REFERENCE_COLOUR = "#6E6E6E"

#: Letter of a panel, in bold.
_LETTER_PATTERN = re.compile(r"\$\\bf\{\([a-l]\)\}\$ ")

_SETTINGS: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Arial", "Helvetica", "Liberation Sans", "DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.titlelocation": "left",
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "figure.titlesize": 9,
    "figure.dpi": 100,
    "axes.prop_cycle": cycler(color=[c for n, c in OKABE_ITO.items() if n != "yellow"]),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.grid": False,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    # Embed TrueType fonts, so that text in the PDF can be searched and edited.
    "pdf.fonttype": 42,
    "savefig.facecolor": "white",
    # As `save_png`: a figure of one column has 700 pixels.
    "savefig.dpi": 200,
}


@contextmanager
def apply_theme() -> Iterator[None]:
    """Apply pamjax's figure style inside the block only.

    >>> before = matplotlib.rcParams["font.size"]
    >>> with apply_theme():
    ...     matplotlib.rcParams["font.size"]
    8.0
    >>> matplotlib.rcParams["font.size"] == before
    True
    """
    with matplotlib.rc_context(_SETTINGS):
        yield


class ThemedFigure(Figure):
    """A figure in pamjax's style, which a notebook shows without further settings."""

    def savefig(self, *args: Any, **kwargs: Any) -> None:
        """Write the figure in pamjax's style; the arguments are those of `Figure.savefig`."""
        with apply_theme():
            super().savefig(*args, **kwargs)

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        self.savefig(image, format="png", dpi=_NOTEBOOK_DPI)
        return image.getvalue()


def create_figure(width: float = SINGLE_COLUMN, height: float = 2.6) -> ThemedFigure:
    """Return an empty figure of a size in inches with constrained layout."""
    return ThemedFigure(figsize=(width, height), layout="constrained")


def separate_panels(figure: Figure) -> None:
    """Widen the space between panels, so that the labels at the ends of their axes do not overlap."""
    engine = figure.get_layout_engine()
    assert isinstance(engine, ConstrainedLayoutEngine)
    engine.set(wspace=0.08)


def build_shades(count: int) -> np.ndarray:
    """Return colours from light to dark, (count, 4), with contrast to white of 3:1 or more (WCAG 1.4.11)."""
    return matplotlib.colormaps["viridis_r"](np.linspace(0.4, 1.0, count))


def build_pressure_colours(levels: Sequence[float]) -> tuple[Colormap, BoundaryNorm]:
    """Return a colour map and norm with a colour for each isobar, light for low and dark for high.

    Args:
        levels: increasing pressures, in the display unit.
    """
    half = np.diff(levels) / 2 if len(levels) > 1 else np.array([0.5])
    edges = [levels[0] - half[0], *(np.asarray(levels[:-1]) + half), levels[-1] + half[-1]]
    return ListedColormap(build_shades(len(levels)), name="pressure"), BoundaryNorm(edges, len(levels))


def add_pressure_bar(axes: Axes | Sequence[Axes], levels: Sequence[float], unit: str = "kPa") -> Colorbar:
    """Add one colour bar next to all of `axes`, with the pressure of each isobar."""
    colours, norm = build_pressure_colours(levels)
    first = axes if isinstance(axes, Axes) else axes[0]
    parent = first.get_figure(root=True)
    assert isinstance(parent, Figure)
    bar = parent.colorbar(ScalarMappable(norm, colours), ax=axes, ticks=levels, aspect=30, pad=0.02)
    bar.ax.set_yticklabels([f"{level:.0f}" for level in levels])
    bar.minorticks_off()
    bar.ax.tick_params(length=0)
    bar.outline.set_visible(False)
    bar.set_label(f"pressure [{unit}]")
    return bar


def add_panel_letters(axes: Sequence[Axes]) -> None:
    """Add (a), (b), ... before the titles of panels."""
    for name, panel in zip(string.ascii_lowercase, axes, strict=False):
        panel.set_title(rf"$\bf{{({name})}}$ {panel.get_title('left')}", loc="left")


def escape_names(figure: Figure) -> None:
    """Escape the dollar signs of names in a figure: between two of them, matplotlib reads a formula.

    The letters of panels and the labels of logarithmic axes are formulas and stay as they are.
    """
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_text(_escape_dollars(text.get_text()))
    for panel in figure.axes:
        for axis in (panel.xaxis, panel.yaxis):
            formatter = axis.get_major_formatter()
            # Matplotlib writes the names at ticks again at each drawing.
            if isinstance(formatter, FuncFormatter):
                axis.set_major_formatter(FuncFormatter(partial(_format_name, formatter)))


def _format_name(formatter: FuncFormatter, value: float, position: int | None = None) -> str:
    return _escape_dollars(formatter(value, position))


def _escape_dollars(text: str) -> str:
    """Return a text with a backslash before each dollar sign outside the formulas of this module.

    >>> _escape_dollars("math$_$"), _escape_dollars("math\\\\$")
    ('math\\\\$_\\\\$', 'math\\\\$')
    """
    if text.startswith(r"$\mathdefault{"):
        return text
    match = _LETTER_PATTERN.match(text)
    letter = match[0] if match else ""
    return letter + re.sub(r"(?<!\\)\$", r"\\$", text[len(letter) :])


def save_png(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG (200 dots per inch) and return its path.

    Args:
        figure: the figure.
        path: file without suffix; missing folders are created.
    """
    png = Path(path).with_name(f"{Path(path).name}.png")
    png.parent.mkdir(parents=True, exist_ok=True)
    escape_names(figure)
    with apply_theme(), write_atomically(png) as temporary:
        figure.savefig(temporary, format="png", dpi=200, metadata={"Software": None})
    return png


def save_figure(figure: Figure, path: str | Path) -> tuple[Path, Path]:
    """Write a figure as PNG (200 dots per inch) and as PDF; equal figures give equal bytes.

    Args:
        figure: the figure.
        path: file without suffix; missing folders are created.

    Returns:
        paths of the PNG and of the PDF.
    """
    png, pdf = save_png(figure, path), Path(path).with_name(f"{Path(path).name}.pdf")
    with apply_theme(), write_atomically(pdf) as temporary:
        figure.savefig(temporary, format="pdf", metadata={"CreationDate": None})
    return png, pdf
