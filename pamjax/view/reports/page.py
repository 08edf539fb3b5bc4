"""Pages of reports: one offline HTML file for each result, with embedded figures and without scripts.

Templates are in `pages/`. Each extends `report.html.jinja`, which contains the styles for light and dark
screens, print and phones. Each figure is drawn in a wide and a narrow version, for screens and phones.
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
from pamjax.view.reports.cell_titles import add_cell_titles
from pamjax.view.theme import apply_theme, escape_names
from pamjax.view.wording import keep_units_with_numbers

#: Packages whose versions each page lists at its end.
_VERSIONED_PACKAGES = ("pamjax", "jax", "numpy", "scipy")

#: Largest ratio of a figure's width on a screen to its width on paper.
_SCREEN_SCALE = 1.15

#: A p-value in a sentence, such as p < 1e-12.
_P_VALUE_PATTERN = re.compile(r"\b(p [=<] \d+(?:\.\d+)?(?:e[+-]?\d+)?)")

_SVG_SETTINGS: dict[Any, Any] = {
    # Text is stored as text: small files, searchable, in the reader's sans-serif font.
    "svg.fonttype": "none",
    # Make the ids inside a figure reproducible.
    "svg.hashsalt": "pamjax",
}


@dataclass(frozen=True)
class Picture:
    """A figure on a page.

    Attributes:
        wide, narrow: SVG for a wide screen and for a phone.
        alt: alternative text, which states the finding.
    """

    wide: Markup
    narrow: Markup
    alt: str


def build_picture(plot: Callable[[bool], Figure | None], name: str, has_title: bool = True) -> Picture | None:
    """Return a figure drawn wide and narrow, or None if there is nothing to show.

    Args:
        plot: function that draws the figure; its argument is whether the figure is narrow.
        name: id of the figure, unique on its page.
        has_title: whether its main title is drawn; without it, the text beside the figure states the finding.
    """
    wide, narrow = plot(False), plot(True)
    if wide is None or narrow is None:
        return None
    alt = _format_figure_titles(wide)
    if not has_title:
        wide.suptitle("")
        narrow.suptitle("")
    return Picture(render_svg(wide, f"{name}-wide", alt), render_svg(narrow, f"{name}-narrow", alt), alt)


def _format_figure_titles(figure: Figure) -> str:
    """Return all titles of a figure in one line."""
    titles = [figure.get_suptitle(), *(axes.get_title("left") for axes in figure.axes)]
    return ". ".join(" ".join(title.split()).rstrip(".;") for title in titles if title) + "."


def render_svg(figure: Figure, name: str, alt: str) -> Markup:
    """Return a figure as an <svg> element that fills the available width.

    Args:
        figure: the figure.
        name: prefix of the ids inside it, which must be unique on a page.
        alt: alternative text.
    """
    escape_names(figure)
    text = io.StringIO()
    with apply_theme(), matplotlib.rc_context(_SVG_SETTINGS):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(text, format="svg", facecolor="none", metadata=metadata)
    inner = re.sub(r"\A.*?<svg[^>]*viewBox=\"([^\"]*)\"[^>]*>", "", text.getvalue(), flags=re.DOTALL)
    box = re.search(r'viewBox="([^"]*)"', text.getvalue())
    assert box is not None
    inner = re.sub(r"<metadata>.*?</metadata>|<style type.*?</style>", "", inner, flags=re.DOTALL)
    inner = add_cell_titles(_make_ids_unique(inner, name), figure)
    # Limit the figure's width, so that type is only slightly larger than on paper.
    width = _SCREEN_SCALE * 96 * figure.get_figwidth()
    style = f"max-width: {width:.0f}px"
    opening_tag = f'<svg viewBox="{box[1]}" role="img" aria-label="{escape(alt)}" style="{style}">'
    return Markup(opening_tag + inner.strip())


def _make_ids_unique(inner: str, name: str) -> str:
    """Return the SVG with a prefix on ids that are referenced; other ids become classes."""
    used_ids = set(re.findall(r'(?:href="#|url\(#)([^")]+)', inner))

    def rename_id(match: re.Match[str]) -> str:
        return f'id="{name}-{match[1]}"' if match[1] in used_ids else f'class="{match[1]}"'

    inner = re.sub(r'\bid="([^"]*)"', rename_id, inner)
    return re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", inner).replace("xlink:href", "href")


def _collect_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages in `_VERSIONED_PACKAGES`."""
    return {name: version(name) for name in _VERSIONED_PACKAGES} | {"Python": platform.python_version()}


def _add_line_breaks(name: str) -> Markup:
    """Return a name in which a line may break after each dot.

    >>> str(_add_line_breaks("muscle.thread_length, 0.5"))
    'muscle.<wbr>thread_length, 0.5'
    """
    return Markup(re.sub(r"\.(?=[a-z])", ".<wbr>", str(escape(name))))


def _keep_options_whole(command: str) -> Markup:
    """Return a command in which no line breaks inside an option, because browsers break after hyphens.

    >>> str(_keep_options_whole("pamjax fit mine --out next"))
    'pamjax fit mine <span class="whole">--out</span> next'
    """
    return Markup(re.sub(r"(?<!\S)--?[a-z-]+", r'<span class="whole">\g<0></span>', str(escape(command))))


def _format_code_spans(text: str) -> Markup:
    """Return a text with code between backticks, without line breaks within a p-value or before a unit.

    >>> str(_format_code_spans("use `plan`"))
    'use <code>plan</code>'
    >>> str(_format_code_spans("(p < 1e-12)."))
    '(<span class="whole">p &lt; 1e-12</span>).'
    >>> str(_format_code_spans("at 250 kPa")) == "at 250\\u00a0kPa"
    True
    """
    parts = re.split(r"`([^`]+)`", text)
    return Markup("").join(
        Markup("<code>{}</code>").format(_keep_options_whole(part)) if k % 2 else _keep_p_values_whole(part)
        for k, part in enumerate(parts)
    )


def _keep_p_values_whole(text: str) -> Markup:
    """Return a text in which no line breaks within a p-value: browsers break after its hyphen."""
    parts = _P_VALUE_PATTERN.split(text)
    span = Markup('<span class="whole">{}</span>')
    return Markup("").join(
        span.format(part) if k % 2 else escape(keep_units_with_numbers(part)) for k, part in enumerate(parts)
    )


def write_page(path: str | Path, template: str, **context: Any) -> Path:
    """Fill a template of `pages/`, write the page atomically and return its path.

    Args:
        path: the HTML file.
        template: file name, such as "diagnosis.html.jinja".
        context: values of the template's variables; a missing value raises an error.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pamjax.view", "pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _add_line_breaks
    environment.filters["command"] = _keep_options_whole
    environment.filters["code_spans"] = _format_code_spans
    text = environment.get_template(template).render(versions=_collect_versions(), **context)
    with write_atomically(path) as temporary:
        temporary.write_text(text, "utf-8")
    return Path(path)
