"""Pages: one offline HTML file a result, its figures inside it, readable without a script.

A template stands in `pages/`; each extends `report.html.jinja`, which has the look: light, dark, print and
phone. A figure is drawn twice, wide and narrow, and the width of the screen chooses.
"""

from __future__ import annotations

import io
import platform
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from pamjax.records.files import write_atomically
from pamjax.view.theme import apply_theme

#: What made a result: told at the end of each page.
VERSIONED_PACKAGES = ("pamjax", "jax", "numpy", "scipy")

#: How much larger a figure may be on a screen than on paper.
SCREEN_SCALE = 1.15

_SVG_SETTINGS: dict[Any, Any] = {
    # Text stays text: small, searchable, in the reader's own sans-serif.
    "svg.fonttype": "none",
    # The same figure gives the same names inside it.
    "svg.hashsalt": "pamjax",
}


@dataclass(frozen=True)
class Picture:
    """A figure on a page.

    Attributes:
        wide, narrow: SVG for a desk and for a phone.
        alt: its finding, for who does not see it.
    """

    wide: Markup
    narrow: Markup
    alt: str


def build_picture(plot: Callable[[bool], Figure | None], name: str) -> Picture | None:
    """Draw a figure wide and narrow.

    Args:
        plot: makes it; is told whether it must be narrow. None where there is nothing to show.
        name: unique on its page.
    """
    wide, narrow = plot(False), plot(True)
    if wide is None or narrow is None:
        return None
    alt = format_figure_titles(wide)
    return Picture(render_svg(wide, f"{name}-wide", alt), render_svg(narrow, f"{name}-narrow", alt), alt)


def format_figure_titles(figure: Figure) -> str:
    """All titles of a figure, in one line."""
    titles = [figure.get_suptitle(), *(axes.get_title("left") for axes in figure.axes)]
    return ". ".join(" ".join(title.split()).rstrip(".;") for title in titles if title) + "."


def render_svg(figure: Figure, name: str, alt: str) -> Markup:
    """A figure as an <svg> element that fills the width it is given.

    Args:
        figure: what to draw.
        name: put before the ids inside it: a page has several figures, and an id only once.
        alt: what it says.
    """
    text = io.StringIO()
    with apply_theme(), matplotlib.rc_context(_SVG_SETTINGS):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(text, format="svg", facecolor="none", metadata=metadata)
    inner = re.sub(r"\A.*?<svg[^>]*viewBox=\"([^\"]*)\"[^>]*>", "", text.getvalue(), flags=re.DOTALL)
    box = re.search(r'viewBox="([^"]*)"', text.getvalue())
    assert box is not None
    inner = re.sub(r"<metadata>.*?</metadata>|<style type.*?</style>", "", inner, flags=re.DOTALL)
    inner = _make_ids_unique(inner, name)
    # Type is a little larger than on paper, and no larger where a screen has more room.
    width = SCREEN_SCALE * 96 * figure.get_figwidth()
    style = f"max-width: {width:.0f}px"
    opening_tag = f'<svg viewBox="{box[1]}" role="img" aria-label="{escape(alt)}" style="{style}">'
    return Markup(opening_tag + inner.strip())


def _make_ids_unique(inner: str, name: str) -> str:
    """Ids that are pointed at, made unique on the page; the others, which may repeat, as classes."""
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', inner))

    def rename_id(match: re.Match[str]) -> str:
        return f'id="{name}-{match[1]}"' if match[1] in used else f'class="{match[1]}"'

    inner = re.sub(r'\bid="([^"]*)"', rename_id, inner)
    return re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", inner).replace("xlink:href", "href")


def collect_versions() -> dict[str, str]:
    """Of what a page was made with."""
    return {name: version(name) for name in VERSIONED_PACKAGES} | {"Python": platform.python_version()}


def add_line_breaks(name: str) -> Markup:
    """A name of a program that may go on in a next line after its dots.

    >>> str(add_line_breaks("muscle.thread_length, 0.5"))
    'muscle.<wbr>thread_length, 0.5'
    """
    return Markup(re.sub(r"\.(?=[a-z])", ".<wbr>", str(escape(name))))


def write_page(path: str | Path, template: str, **context: Any) -> Path:
    """Fill a template of `pages/` and write it beside, then rename.

    Args:
        path: the HTML file.
        template: as "diagnosis.html.jinja".
        context: what the template names; a name that it does not get is an error.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pamjax.view", "pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = add_line_breaks
    text = environment.get_template(template).render(versions=collect_versions(), **context)
    with write_atomically(path) as temporary:
        temporary.write_text(text, "utf-8")
    return Path(path)
