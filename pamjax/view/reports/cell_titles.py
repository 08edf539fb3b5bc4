"""Titles of the cells of a map: a browser shows them under the pointer, without a script."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np
from markupsafe import escape
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

#: Group id of the meshes that get titles.
_TITLED_GID = "misfit"
_GROUP_PATTERN = re.compile(rf'(<g class="{_TITLED_GID}">)(.*?)(</g>)', re.DOTALL)
_PATH_PATTERN = re.compile(r"(<path [^>]*?)/>", re.DOTALL)


def add_cell_titles(svg: str, figure: Figure) -> str:
    """Return the SVG of a figure with a title in each cell of its maps.

    Args:
        svg: elements of the figure, with the group id of a mesh as class.
        figure: the drawn figure; a map without its path for each cell is not changed.
    """
    titles = iter([list(_list_titles(mesh, panel)) for panel in figure.axes for mesh in _list_meshes(panel)])

    def add_titles(match: re.Match[str]) -> str:
        texts = next(titles, [])
        if len(_PATH_PATTERN.findall(match[2])) != len(texts):
            return match[0]
        remaining = iter(texts)

        def add_title(path: re.Match[str]) -> str:
            return f"{path[1]}><title>{escape(next(remaining))}</title></path>"

        inner = _PATH_PATTERN.sub(add_title, match[2])
        return match[1] + inner + match[3]

    return _GROUP_PATTERN.sub(add_titles, svg)


def _list_meshes(panel: Axes) -> list[QuadMesh]:
    return [m for m in panel.collections if isinstance(m, QuadMesh) and m.get_gid() == _TITLED_GID]


def _list_titles(mesh: QuadMesh, panel: Axes) -> Iterator[str]:
    """Yield the ranges and the value of each cell, row by row."""
    corners = np.asarray(mesh.get_coordinates())
    x, y = corners[0, :, 0], corners[:, 0, 1]
    values = np.ma.filled(np.ma.asarray(mesh.get_array(), dtype=float), np.nan)
    # An rms has no sign.
    sign = "+" if mesh.get_clim()[0] < 0 else ""
    for row, line in enumerate(values.reshape(y.size - 1, x.size - 1)):
        for column, value in enumerate(line):
            text = f"{value:{sign}.1f} sd" if np.isfinite(value) else "no measurement"
            ranges = (
                _format_range(panel, "x", x[column : column + 2]),
                _format_range(panel, "y", y[row : row + 2]),
            )
            yield f"{text}: {', '.join(ranges)}".replace("-", "\N{MINUS SIGN}")


def _format_range(panel: Axes, axis: str, ends: np.ndarray) -> str:
    """Return a range with the name and unit of its axis, as "contraction 5.6 to 6.7 %"."""
    shared = getattr(panel, f"get_shared_{axis}_axes")().get_siblings(panel)
    labels = [getattr(sibling, f"get_{axis}label")() for sibling in shared]
    name, _, unit = next((label for label in labels if label), "").partition(" [")
    decimals = max(0, 1 - math.floor(math.log10(ends[1] - ends[0])))
    return f"{name} {ends[0]:z.{decimals}f} to {ends[1]:z.{decimals}f} {unit.rstrip(']')}".strip()
