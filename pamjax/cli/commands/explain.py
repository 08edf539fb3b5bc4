"""`pamjax explain`: what a number or a mechanism means."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pamjax.cli.options import Json
from pamjax.cli.screen import say, say_json, say_written, writable
from pamjax.errors import BadInput, nearest, refuse

if TYPE_CHECKING:
    from pamjax.model.parameters import Meaning

WIDTH = 96


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
    from pamjax.model.registry import library

    if figure is not None:
        _drawn(name, figure)
    if json:
        say_json(_document(name))
    elif name is None:
        say("\n".join(_everything()))
    elif name in library():
        say("\n".join(_mechanism(library()[name])))
    else:
        say("\n".join(_number(name)))


def _drawn(name: str | None, file: Path) -> None:
    """Write the figure of a mechanism."""
    from pamjax.model.registry import library, mechanism

    if name is None or "." in name:
        remedy = f"Name one of {', '.join(library())}."
        raise refuse("a figure is drawn of a mechanism", name or "no name", "--figure", remedy)
    if file.suffix != ".png":
        raise refuse("`--figure` is a PNG file", str(file), remedy=f"Name it {file.with_suffix('.png')}.")
    kind = mechanism(name)
    writable(file.parent, "what `--figure` lies in")
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.view.figures.mechanism import mechanism_figure
    from pamjax.view.theme import save_png

    keep_compiled()
    say_written([save_png(mechanism_figure(kind), file.with_suffix(""))])


def _document(name: str | None) -> dict[str, Any]:
    """Numbers (SI) and mechanisms by name: all of them, or one."""
    from pamjax.model.parameters import catalogue
    from pamjax.model.registry import library

    numbers, mechanisms = catalogue(), library()
    if name is not None:
        if name not in numbers and name not in mechanisms:
            raise _unknown(name)
        numbers = {n: m for n, m in numbers.items() if n == name or n.startswith(f"{name}.")}
        mechanisms = {n: kind for n, kind in mechanisms.items() if n == name}
    return {
        "numbers": {n: asdict(m) for n, m in numbers.items()},
        "mechanisms": {n: asdict(kind.about) for n, kind in mechanisms.items()},
    }


def _unknown(name: str) -> BadInput:
    from pamjax.model.parameters import catalogue
    from pamjax.model.registry import library

    hint = nearest(name, [*catalogue(), *library()], listing="pamjax explain")
    return refuse(f"{name!r} is no number and no mechanism pamjax knows", remedy=hint)


def _everything() -> Iterator[str]:
    from pamjax.model.parameters import catalogue
    from pamjax.model.registry import ALTERNATIVES, MECHANISMS

    numbers = catalogue()
    yield "Numbers of a muscle:"
    yield from _lines({n: numbers[n] for n in sorted(numbers) if n.startswith(("muscle.", "thread."))}, "  ")
    yield "Mechanisms, what a model may leave out:"
    for kind in MECHANISMS:
        yield from _listed(kind)
    yield "Textbook forms, to compare with:"
    for kind in ALTERNATIVES:
        yield from _listed(kind)


def _listed(kind) -> Iterator[str]:
    yield f"  {kind.id}: {kind.about.title}"
    yield from _lines(_own(kind), "    ")


def _own(kind) -> dict[str, Meaning]:
    """A mechanism's numbers by name."""
    from pamjax.model.parameters import catalogue

    return {n: meaning for n, meaning in catalogue().items() if n.startswith(f"{kind.id}.")}


def _lines(numbers: Mapping[str, Meaning], indent: str) -> Iterator[str]:
    """Name, unit and meaning in columns as wide as what stands in them."""
    name, unit = (max(map(len, texts), default=0) for texts in (numbers, (m.show for m in numbers.values())))
    for n, meaning in numbers.items():
        yield f"{indent}{n:<{name}}  {meaning.show:<{unit}}  {meaning.about}"


def _number(name: str) -> Iterator[str]:
    from pamjax.model.parameters import by_law, catalogue

    known = catalogue()
    if name not in known:
        raise _unknown(name)
    meant: dict[tuple[str, ...], list[str]] = {}
    for law, own in by_law(name).items():
        meant.setdefault(tuple(_meant(own)), []).append(law)
    if len(meant) < 2:
        about, *lines = _meant(known[name])
        yield f"{name}: {about}"
        yield from lines
        return
    # One number may mean something else to another law.
    for (about, *lines), laws in meant.items():
        yield f"{name} (law {' or '.join(laws)}): {about}"
        yield from lines


def _meant(found) -> Iterator[str]:
    """What a number is, then unit, limits, source and neutral value."""
    from pamjax.units import in_unit

    scale = in_unit(found.show)
    yield found.about
    yield (
        f"  unit      {found.show} (kept in {found.unit})"
        if found.show != found.unit
        else f"  unit      {found.unit}"
    )
    yield f"  limits    {found.low / scale:g} to {found.high / scale:g}, moved on a {found.scale} scale"
    yield f"  source    {found.source}"
    if found.neutral is not None:
        yield f"  neutral   {found.neutral / scale:g}: there it has no effect"


def _mechanism(kind) -> Iterator[str]:
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
        yield from textwrap.wrap(text, WIDTH, initial_indent=f"  {word:<14}", subsequent_indent=" " * 16)
    yield "  numbers"
    yield from _lines(_own(kind), "    ")
