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

from pamjax.records.files import write_beside
from pamjax.view.theme import theme

#: What made a result: told at the end of each page.
MADE_WITH = ("pamjax", "jax", "numpy", "scipy")

#: How much larger a figure may be on a screen than on paper.
LARGER = 1.15

_SVG: dict[Any, Any] = {
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


def picture(draw: Callable[[bool], Figure | None], name: str) -> Picture | None:
    """Draw a figure wide and narrow.

    Args:
        draw: makes it; is told whether it must be narrow. None where there is nothing to show.
        name: unique on its page.
    """
    wide, narrow = draw(False), draw(True)
    if wide is None or narrow is None:
        return None
    alt = finding(wide)
    return Picture(svg(wide, f"{name}-wide", alt), svg(narrow, f"{name}-narrow", alt), alt)


def finding(figure: Figure) -> str:
    """All titles of a figure, in one line."""
    titles = [figure.get_suptitle(), *(axes.get_title("left") for axes in figure.axes)]
    return ". ".join(" ".join(title.split()).rstrip(".;") for title in titles if title) + "."


def svg(figure: Figure, name: str, alt: str) -> Markup:
    """A figure as an <svg> element that fills the width it is given.

    Args:
        figure: what to draw.
        name: put before the ids inside it: a page has several figures, and an id only once.
        alt: what it says.
    """
    text = io.StringIO()
    with theme(), matplotlib.rc_context(_SVG):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(text, format="svg", facecolor="none", metadata=metadata)
    inner = re.sub(r"\A.*?<svg[^>]*viewBox=\"([^\"]*)\"[^>]*>", "", text.getvalue(), flags=re.DOTALL)
    box = re.search(r'viewBox="([^"]*)"', text.getvalue())
    assert box is not None
    inner = re.sub(r"<metadata>.*?</metadata>|<style type.*?</style>", "", inner, flags=re.DOTALL)
    inner = _own_ids(inner, name)
    # Type is a little larger than on paper, and no larger where a screen has more room.
    width = LARGER * 96 * figure.get_figwidth()
    style = f"max-width: {width:.0f}px"
    head = f'<svg viewBox="{box[1]}" role="img" aria-label="{escape(alt)}" style="{style}">'
    return Markup(head + inner.strip())


def _own_ids(inner: str, name: str) -> str:
    """Ids that are pointed at, made unique on the page; the others, which may repeat, as classes."""
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', inner))

    def renamed(found: re.Match[str]) -> str:
        return f'id="{name}-{found[1]}"' if found[1] in used else f'class="{found[1]}"'

    inner = re.sub(r'\bid="([^"]*)"', renamed, inner)
    return re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", inner).replace("xlink:href", "href")


def versions() -> dict[str, str]:
    """Of what a page was made with."""
    return {name: version(name) for name in MADE_WITH} | {"Python": platform.python_version()}


def breakable(name: str) -> Markup:
    """A name of a program that may go on in a next line after its dots.

    >>> str(breakable("muscle.thread_length, 0.5"))
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
    look = jinja2.Environment(
        loader=jinja2.PackageLoader("pamjax.view", "pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    look.filters["breakable"] = breakable
    text = look.get_template(template).render(versions=versions(), **context)
    with write_beside(path) as beside:
        beside.write_text(text, "utf-8")
    return Path(path)
