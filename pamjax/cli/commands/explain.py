"""`pamjax explain`: what a number or a mechanism means."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pamjax.cli.options import Json
from pamjax.cli.screen import check_writable, print_json, print_text, print_written_files
from pamjax.errors import BadInput, refuse, suggest_word

if TYPE_CHECKING:
    from pamjax.model.parameters import Meaning

LINE_WIDTH = 96


def explain(
    name: str | None = None,
    /,
    *,
    figure: Path | None = None,
    json: Json = False,
) -> None:
    """Say what a number or a mechanism means; without a name, list them all.

    Args:
        name: a number as it stands in muscle.toml and in reports, for instance thread.modulus, or a
            mechanism, for instance braid_friction.
        figure: a PNG file to write: what the mechanism does to the force and diameter of a muscle.
        json: print for programs.
    """
    from pamjax.model.registry import list_mechanisms

    if figure is not None:
        _write_figure(name, figure)
    if json:
        print_json(_build_document(name))
    elif name is None:
        print_text("\n".join(_list_everything()))
    elif name in list_mechanisms():
        print_text("\n".join(_explain_mechanism(list_mechanisms()[name])))
    else:
        print_text("\n".join(_explain_number(name)))


def _write_figure(name: str | None, file: Path) -> None:
    """Write the figure of a mechanism."""
    from pamjax.model.registry import find_mechanism, list_mechanisms

    if name is None or "." in name:
        remedy = f"Name one of {', '.join(list_mechanisms())}."
        raise refuse("a figure is drawn of a mechanism", name or "no name", "--figure", remedy)
    if file.suffix != ".png":
        raise refuse("`--figure` is a PNG file", str(file), remedy=f"Name it {file.with_suffix('.png')}.")
    kind = find_mechanism(name)
    check_writable(file.parent, "what `--figure` lies in")
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.view.figures.mechanism import plot_mechanism
    from pamjax.view.theme import save_png

    keep_compiled()
    print_written_files([save_png(plot_mechanism(kind), file.with_suffix(""))])


def _build_document(name: str | None) -> dict[str, Any]:
    """Numbers (SI) and mechanisms by name: all of them, or one."""
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import list_mechanisms

    numbers, mechanisms = list_parameters(), list_mechanisms()
    if name is not None:
        if name not in numbers and name not in mechanisms:
            raise _build_unknown_error(name)
        numbers = {
            item_name: item
            for item_name, item in numbers.items()
            if item_name == name or item_name.startswith(f"{name}.")
        }
        mechanisms = {item_name: kind for item_name, kind in mechanisms.items() if item_name == name}
    return {
        "numbers": {item_name: asdict(item) for item_name, item in numbers.items()},
        "mechanisms": {item_name: asdict(kind.about) for item_name, kind in mechanisms.items()},
    }


def _build_unknown_error(name: str) -> BadInput:
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import list_mechanisms

    hint = suggest_word(name, [*list_parameters(), *list_mechanisms()], listing="pamjax explain")
    return refuse(f"{name!r} is no number and no mechanism pamjax knows", remedy=hint)


def _list_everything() -> Iterator[str]:
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import ALTERNATIVES, MECHANISMS

    numbers = list_parameters()
    yield "Numbers of a muscle:"
    yield from _format_lines(
        {
            number_name: numbers[number_name]
            for number_name in sorted(numbers)
            if number_name.startswith(("muscle.", "thread."))
        },
        "  ",
    )
    yield "Mechanisms, what a model may leave out:"
    for kind in MECHANISMS:
        yield from _list_mechanism(kind)
    yield "Textbook forms, to compare with:"
    for kind in ALTERNATIVES:
        yield from _list_mechanism(kind)


def _list_mechanism(kind) -> Iterator[str]:
    yield f"  {kind.id}: {kind.about.title}"
    yield from _format_lines(_select_own_numbers(kind), "    ")


def _select_own_numbers(kind) -> dict[str, Meaning]:
    """A mechanism's numbers by name."""
    from pamjax.model.parameters import list_parameters

    return {n: meaning for n, meaning in list_parameters().items() if n.startswith(f"{kind.id}.")}


def _format_lines(numbers: Mapping[str, Meaning], indent: str) -> Iterator[str]:
    """Name, unit and meaning in columns as wide as what stands in them."""
    name_width, unit_width = (
        max(map(len, texts), default=0) for texts in (numbers, (m.show for m in numbers.values()))
    )
    for n, meaning in numbers.items():
        yield f"{indent}{n:<{name_width}}  {meaning.show:<{unit_width}}  {meaning.about}"


def _explain_number(name: str) -> Iterator[str]:
    from pamjax.model.parameters import list_meanings_by_law, list_parameters

    meanings = list_parameters()
    if name not in meanings:
        raise _build_unknown_error(name)
    laws_by_meaning: dict[tuple[str, ...], list[str]] = {}
    for law, law_meaning in list_meanings_by_law(name).items():
        laws_by_meaning.setdefault(tuple(_format_meaning(law_meaning)), []).append(law)
    if len(laws_by_meaning) < 2:
        first_line, *lines = _format_meaning(meanings[name])
        yield f"{name}: {first_line}"
        yield from lines
        return
    # One number may mean something else to another law.
    for (first_line, *lines), laws in laws_by_meaning.items():
        yield f"{name} (law {' or '.join(laws)}): {first_line}"
        yield from lines


def _format_meaning(meaning) -> Iterator[str]:
    """What a number is, then unit, limits, source and neutral value."""
    from pamjax.units import compute_si_factor

    scale = compute_si_factor(meaning.show)
    yield meaning.about
    yield (
        f"  unit      {meaning.show} (kept in {meaning.unit})"
        if meaning.show != meaning.unit
        else f"  unit      {meaning.unit}"
    )
    yield f"  limits    {meaning.low / scale:g} to {meaning.high / scale:g}, moved on a {meaning.scale} scale"
    yield f"  source    {meaning.source}"
    if meaning.neutral is not None:
        yield f"  neutral   {meaning.neutral / scale:g}: there it has no effect"


def _explain_mechanism(kind) -> Iterator[str]:
    about = kind.about
    yield f"{kind.id}: {about.title}"
    yield from textwrap.indent(about.equation, "    ").splitlines()
    for word, text in {
        "shows": about.signature,
        "leaves out": about.leaves_out,
        "mistaken for": ", ".join(about.confusable) or "nothing in the library",
        "told apart by": about.experiment,
        "source": about.source,
    }.items():
        yield from textwrap.wrap(text, LINE_WIDTH, initial_indent=f"  {word:<14}", subsequent_indent=" " * 16)
    yield "  numbers"
    yield from _format_lines(_select_own_numbers(kind), "    ")
