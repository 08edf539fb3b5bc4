"""`pamjax explain`: describe a parameter or a mechanism."""

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
    """Describe a parameter or a mechanism; without a name, list all of them.

    For a parameter the command prints meaning, unit, limits and source. For a mechanism it prints the
    equation, its effect on a recording, what it neglects, similar mechanisms, and its parameters.

    Args:
        name: a parameter as in reports, for instance thread.modulus, or a mechanism, for instance
            braid_friction.
        figure: PNG file to write, with the effect of the mechanism on force and diameter.
        json: print one JSON document.
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
        print_text("\n".join(_explain_parameter(name)))


def _write_figure(name: str | None, file: Path) -> None:
    """Write the figure of a mechanism."""
    from pamjax.model.registry import find_mechanism, list_mechanisms

    if name is None or "." in name:
        remedy = f"Name one of {', '.join(list_mechanisms())}."
        raise refuse("`--figure` needs the name of a mechanism", name or "no name", remedy=remedy)
    if file.suffix != ".png":
        raise refuse(
            "`--figure` must be a PNG file", str(file), remedy=f"Name it {file.with_suffix('.png')}."
        )
    kind = find_mechanism(name)
    check_writable(file.parent, "the folder of `--figure`")
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.view.figures.mechanism import plot_mechanism
    from pamjax.view.theme import save_png

    keep_compiled()
    print_written_files([save_png(plot_mechanism(kind), file.with_suffix(""))])


def _build_document(name: str | None) -> dict[str, Any]:
    """Return parameters (SI) and mechanisms by name: all of them, or one."""
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import list_mechanisms

    parameters, mechanisms = list_parameters(), list_mechanisms()
    if name is not None:
        if name not in parameters and name not in mechanisms:
            raise _build_unknown_error(name)
        parameters = {
            item_name: item
            for item_name, item in parameters.items()
            if item_name == name or item_name.startswith(f"{name}.")
        }
        mechanisms = {item_name: kind for item_name, kind in mechanisms.items() if item_name == name}
    return {
        "numbers": {item_name: asdict(item) for item_name, item in parameters.items()},
        "mechanisms": {item_name: asdict(kind.about) for item_name, kind in mechanisms.items()},
    }


def _build_unknown_error(name: str) -> BadInput:
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import list_mechanisms

    hint = suggest_word(name, [*list_parameters(), *list_mechanisms()], listing="pamjax explain")
    return refuse(f"unknown parameter or mechanism {name!r}", remedy=hint)


def _list_everything() -> Iterator[str]:
    from pamjax.model.parameters import list_parameters
    from pamjax.model.registry import ALTERNATIVES, MECHANISMS

    parameters = list_parameters()
    yield "Parameters of a muscle:"
    yield from _format_lines(
        {
            parameter_name: parameters[parameter_name]
            for parameter_name in sorted(parameters)
            if parameter_name.startswith(("muscle.", "thread."))
        },
        "  ",
    )
    yield "Mechanisms that a model can include, with their parameters:"
    for kind in MECHANISMS:
        yield from _list_mechanism(kind)
    yield "Alternative equations from textbooks, for comparison:"
    for kind in ALTERNATIVES:
        yield from _list_mechanism(kind)


def _list_mechanism(kind) -> Iterator[str]:
    yield f"  {kind.id}: {kind.about.title}"
    yield from _format_lines(_select_own_parameters(kind), "    ")


def _select_own_parameters(kind) -> dict[str, Meaning]:
    """Return the parameters of a mechanism by name."""
    from pamjax.model.parameters import list_parameters

    return {n: meaning for n, meaning in list_parameters().items() if n.startswith(f"{kind.id}.")}


def _format_lines(parameters: Mapping[str, Meaning], indent: str) -> Iterator[str]:
    """Return lines with name, unit and meaning in aligned columns."""
    name_width, unit_width = (
        max(map(len, texts), default=0) for texts in (parameters, (m.show for m in parameters.values()))
    )
    for n, meaning in parameters.items():
        yield f"{indent}{n:<{name_width}}  {meaning.show:<{unit_width}}  {meaning.about}"


def _explain_parameter(name: str) -> Iterator[str]:
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
    # The meaning of a parameter can depend on the law.
    for (first_line, *lines), laws in laws_by_meaning.items():
        yield f"{name} (law {' or '.join(laws)}): {first_line}"
        yield from lines


def _format_meaning(meaning) -> Iterator[str]:
    """Return the meaning of a parameter, then unit, limits, source and neutral value."""
    from pamjax.units import compute_si_factor

    scale = compute_si_factor(meaning.show)
    yield meaning.about
    yield (
        f"  unit      {meaning.show} (stored in {meaning.unit})"
        if meaning.show != meaning.unit
        else f"  unit      {meaning.unit}"
    )
    limits = f"{meaning.low / scale:g} to {meaning.high / scale:g}"
    yield f"  limits    {limits}, fitted on a {meaning.scale} scale"
    yield f"  source    {meaning.source}"
    if meaning.neutral is not None:
        yield f"  neutral   {meaning.neutral / scale:g}: the value without effect"
    if meaning.is_refinement:
        yield "  in a fit  fixed at its default; `diagnose` may estimate it"


def _explain_mechanism(kind) -> Iterator[str]:
    about = kind.about
    yield f"{kind.id}: {about.title}"
    yield from textwrap.indent(about.equation, "    ").splitlines()
    for label, text in {
        "signature": about.signature,
        "neglects": about.neglects,
        "confused with": ", ".join(about.confusable) or "nothing in the library",
        "distinguished by": about.experiment,
        "source": about.source,
    }.items():
        yield from textwrap.wrap(
            text, LINE_WIDTH, initial_indent=f"  {label:<18}", subsequent_indent=" " * 20
        )
    yield "  parameters"
    yield from _format_lines(_select_own_parameters(kind), "    ")
